"""Scratch copy of the world in which configurations of arms are tried.

Distances and contacts are computed in a `ScratchModel`: the world itself stays as it is. Copies of
a world's model are pooled, since creating one takes 0.8 ms.
"""

from __future__ import annotations

import copy
import weakref
from collections.abc import Collection
from dataclasses import dataclass
from typing import Final, NamedTuple, TypedDict

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.sim.world import World

_MARKED: Final = (
    "geom_contype",
    "geom_conaffinity",
    "geom_margin",
    "body_contype",
    "body_conaffinity",
    "body_margin",
)
"""Fields of a copy that its owner may change."""

_ONE_CONTACT: Final = mujoco.mjtDisableBit.mjDSBL_MULTICCD
"""Only the deepest contact of two convex geoms is needed; the others, which a simulation step needs
so that objects lie flat, cost a tenth of a check."""

Marks = npt.NDArray[np.bool_]
"""Selection among all geoms of a model, of shape (ngeom,)."""

Bits = npt.NDArray[np.int32] | npt.NDArray[np.bool_]
"""Collision bits of each geom of a model, of shape (ngeom,)."""


@dataclass(frozen=True, eq=False)
class Carried:
    """Object that moves with a link.

    Attributes:
        address: First of the seven elements of ``qpos`` that are the object's pose.
        link: Id of the body that carries it.
        relative: Pose of the object in that body.
    """

    address: int
    link: int
    relative: Pose


class _State(TypedDict):
    """Pickled state of a scratch model."""

    model: mujoco.MjModel
    positions: Vector
    carried: tuple[Carried, ...]


class ScratchModel:
    """Copy of a world's model and state, in which configurations are tried.

    Can be pickled, and measures the same in any process. To be rebuilt after the world is
    recompiled.

    Args:
        world: World to copy; never changed.
        holders: Names of the arms whose held objects move with them; all others stay in place.

    Attributes:
        model: Copy of the world's model, whose collision bits and margins may be changed.
        data: State of the copy; the caller sets positions, then calls `settle`.
    """

    def __init__(self, world: World, holders: Collection[str] = ()) -> None:
        self.model, self.data = scratch_copy(world, self)
        self._positions: Vector = world.sensed.qpos.copy()
        # No dynamics are simulated here that would hold an object: it follows its tool rigidly.
        self._carried = tuple(
            Carried(world.pose_address(held.object), world.arms[held.arm].tool_body, held.relative)
            for held in world.attachments
            if held.arm in holders
        )
        self._begin()

    def __getstate__(self) -> _State:
        """State without what MuJoCo computes from the rest."""
        return {"model": self.model, "positions": self._positions, "carried": self._carried}

    def __setstate__(self, state: _State) -> None:
        """Restore the scratch model, in another process."""
        self.model = state["model"]
        self._positions = state["positions"]
        self._carried = state["carried"]
        # A copy of its own, outside the pool: another process has no world to lend from.
        self.data = mujoco.MjData(self.model)
        self._begin()

    @property
    def solid(self) -> Marks:
        """Geoms that can collide, by their current collision bits."""
        solid: Marks = (self.model.geom_contype != 0) | (self.model.geom_conaffinity != 0)
        return solid

    def marks(self, geoms: Collection[int]) -> Marks:
        """Selection of these geoms."""
        marks = np.zeros(self.model.ngeom, dtype=bool)
        marks[list(geoms)] = True
        return marks

    def compare(self, types: Bits, affinities: Bits) -> None:
        """Check only pairs of geoms of which one has a type bit in the other's affinity bits.

        Args:
            types: Type bits of each geom (``contype``).
            affinities: Affinity bits of each geom (``conaffinity``).
        """
        model = self.model
        model.geom_contype[:] = types
        model.geom_conaffinity[:] = affinities
        # A body has the bits of its geoms: one without bits is skipped in the broad phase.
        model.body_contype[:] = model.body_conaffinity[:] = 0
        np.bitwise_or.at(model.body_contype, model.geom_bodyid, model.geom_contype)
        np.bitwise_or.at(model.body_conaffinity, model.geom_bodyid, model.geom_conaffinity)

    def report_gaps(self, marks: Marks, distance: float) -> None:
        """Report geoms nearer to the selected ones than a distance in m, not only contacts."""
        model = self.model
        model.geom_margin[marks] = distance
        model.body_margin[np.unique(model.geom_bodyid[marks])] = distance

    def settle(self) -> None:
        """Compute kinematics and contacts at the positions in ``data``."""
        model = self.model
        data = self.data
        mujoco.mj_kinematics(model, data)
        if self._carried:
            # Held objects follow the tools, whose poses are known only after the first pass.
            for position, quaternion, *link, relative in self._views:
                mujoco.mju_mulPose(
                    position, quaternion, *link, relative.position, relative.quaternion
                )
            mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)

    def _begin(self) -> None:
        """Set the initial positions."""
        data = self.data
        data.qpos[:] = self._positions
        # Poses of held objects and their links as views: looking up a field costs more.
        self._views = [
            (
                data.qpos[held.address : held.address + 3],
                data.qpos[held.address + 3 : held.address + 7],
                data.xpos[held.link],
                data.xquat[held.link],
                held.relative,
            )
            for held in self._carried
        ]


class ScratchCopy(NamedTuple):
    """Copy of a model with a state.

    Attributes:
        model: Copy of a world's model.
        data: State of the copy.
    """

    model: mujoco.MjModel
    data: mujoco.MjData


class _Pool:
    """Unused copies of one model."""

    def __init__(self, original: mujoco.MjModel) -> None:
        self.original = original
        self.copies: list[ScratchCopy] = []


_pools: weakref.WeakKeyDictionary[World, _Pool] = weakref.WeakKeyDictionary()


def scratch_copy(world: World, owner: object) -> ScratchCopy:
    """Copy of a world's current model for the lifetime of its owner.

    Args:
        world: World to copy.
        owner: Object with exclusive use of the copy; it is reused once the owner is collected.
    """
    pool = _pools.get(world)
    if pool is None or pool.original is not world.model:  # the world was recompiled
        pool = _pools[world] = _Pool(world.model)
    if pool.copies:
        lent = pool.copies.pop()
        # Its state is whatever it was: the owner sets all positions.
        for field in _MARKED:
            getattr(lent.model, field)[:] = getattr(pool.original, field)
    else:
        model = copy.copy(world.model)
        model.opt.disableflags |= _ONE_CONTACT
        lent = ScratchCopy(model, mujoco.MjData(model))
    # Not at exit, when nobody reuses the copy.
    weakref.finalize(owner, pool.copies.append, lent).atexit = False
    return lent
