"""A copy of a world's model to try configurations in: the world itself stays as it is.

Whoever asks for distances or contacts that are not those of now asks here: which shapes are
compared, up to which gap they are reported, and where what an arm holds goes with it.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypedDict

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.motion.collision.scratch_copies import scratch_copy
from bt_dualarm.pose import Pose, Vector

if TYPE_CHECKING:
    from bt_dualarm.world.world import World

Marks = npt.NDArray[np.bool_]
"""Which of all shapes of a model are meant, of shape (ngeom,)."""

Bits = npt.NDArray[np.int32] | npt.NDArray[np.bool_]
"""Bits of each shape of a model, of shape (ngeom,)."""


@dataclass(frozen=True, eq=False)
class Carried:
    """An object that goes with a link.

    Attributes:
        address: First of the seven entries of ``qpos`` that are the object's pose.
        link: Id of the body that carries it.
        relative: Pose of the object in that body.
    """

    address: int
    link: int
    relative: Pose


class _State(TypedDict):
    """What another process needs for the same scratch model."""

    model: mujoco.MjModel
    positions: Vector
    carried: tuple[Carried, ...]


class ScratchModel:
    """Model and state of their own, as the world was when this was made.

    It can be pickled, and measures alike in any process. To be made anew after a recompilation.

    Args:
        world: World to copy; never changed.
        holders: Names of the arms whose held objects go with them; all others stay where they are.

    Attributes:
        model: Copy of the world's model, free to be marked.
        data: State of the copy; positions are set by whoever asks, then `settle` is called.
    """

    def __init__(self, world: World, holders: Collection[str] = ()) -> None:
        self.model, self.data = scratch_copy(world, self)
        self._positions: Vector = world.sensed.qpos.copy()
        self._carried = tuple(
            Carried(world.pose_address(held.object), world.arms[held.arm].tool_body, held.relative)
            for held in world.attachments
            if held.arm in holders
        )
        self._begin()

    def __getstate__(self) -> _State:
        """All but what MuJoCo computes from the rest."""
        return {"model": self.model, "positions": self._positions, "carried": self._carried}

    def __setstate__(self, state: _State) -> None:
        """The same scratch model in another process."""
        self.model, self._positions = state["model"], state["positions"]
        self._carried = state["carried"]
        self.data = mujoco.MjData(self.model)
        self._begin()

    @property
    def solid(self) -> Marks:
        """Shapes that can touch something, as the marks stand now."""
        solid: Marks = (self.model.geom_contype != 0) | (self.model.geom_conaffinity != 0)
        return solid

    def marks(self, geoms: Collection[int]) -> Marks:
        """Marks of these shapes."""
        marks = np.zeros(self.model.ngeom, dtype=bool)
        marks[list(geoms)] = True
        return marks

    def compare(self, these: Bits, those: Bits) -> None:
        """Compare only shapes of which one asks by a bit that the other one answers to.

        Args:
            these: Bits by which each shape asks.
            those: Bits to which each shape answers.
        """
        model = self.model
        model.geom_contype[:] = these
        model.geom_conaffinity[:] = those
        # A body has the bits of its shapes: who has none is not even sought for in space.
        model.body_contype[:] = model.body_conaffinity[:] = 0
        np.bitwise_or.at(model.body_contype, model.geom_bodyid, model.geom_contype)
        np.bitwise_or.at(model.body_conaffinity, model.geom_bodyid, model.geom_conaffinity)

    def report_gaps(self, marks: Marks, distance: float) -> None:
        """Report what is nearer to these shapes than a distance in m, not only what touches."""
        model = self.model
        model.geom_margin[marks] = distance
        model.body_margin[np.unique(model.geom_bodyid[marks])] = distance

    def settle(self) -> None:
        """Find where everything is at the positions that ``data`` has, and what is near what."""
        model, data = self.model, self.data
        mujoco.mj_kinematics(model, data)
        if self._carried:
            self._carry()
            mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)

    def _carry(self) -> None:
        """Put what arms hold where their tool links now are."""
        for place, turn, *link, relative in self._views:
            mujoco.mju_mulPose(place, turn, *link, relative.position, relative.quaternion)

    def _begin(self) -> None:
        """Put everything where it was when this was made."""
        data = self.data
        data.qpos[:] = self._positions
        # Place and turn of what is held and of the link, as views: looking a field up costs more.
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
