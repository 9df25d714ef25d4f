"""Would an arm touch something in a configuration? MuJoCo's shapes, without moving the world."""

from __future__ import annotations

import copy
import functools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.errors import CollisionFailure
from bt_dualarm.motion.collision.scratch_model import Marks, ScratchModel
from bt_dualarm.motion.collision.sweep import last_joint, stretched
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.names import name_of_geom

if TYPE_CHECKING:
    from bt_dualarm.world.world import World

TOUCH = 5e-4
"""Depth in metres up to which things touch and do not collide: objects at rest sink in as much."""


STANDING = 3e-3
"""Depth in metres up to which a touch that is there already may go on: tool and held objects are
pressed against things when they take and leave them."""


@dataclass(frozen=True)
class Contact:
    """Two bodies closer than they may be.

    Attributes:
        first: Name of the arm's link, or of what it holds.
        second: Name of what it touches.
        depth: Depth of the shapes in each other in metres; negative for a gap.
    """

    first: str
    second: str
    depth: float

    def failure(self) -> CollisionFailure:
        """This contact as the reason of a refusal."""
        how = f"{1e3 * self.depth:.1f} mm deep in" if self.depth > 0.0 else "too close to"
        reason = f"{self.first} would be {how} {self.second}"
        return CollisionFailure(reason, self.first, self.second, depth_m=self.depth)


class CollisionChecker:
    """Configurations of one arm against the world as it is at this moment.

    What the arm holds moves with it. What its tool and what it holds touch now, they may go on
    touching as deep as now. Everything else, other arms too, stays where it is now: make a
    new checker when the world has gone on. It can be pickled, and checks alike in any process.

    Args:
        world: World that is looked at now, and never changed.
        arm: Name of the arm.
        margin: Distance in metres that other arms must keep from this one: the same for all of
            them, or by their names; one without a name there must not touch.
        ignore: Objects that may be touched.

    Attributes:
        joints: Names of the arm's joints, base to tip.
        present: Positions of the joints now, of shape (dof,), rad.
        moving: Shapes that move with the arm, those that it holds included.
        joint_ids: Ids of the joints in the model, base to tip.
        least: Distances that shapes keep from one another, negative where they may be in one
            another, of shape (ngeom, ngeom), m.
    """

    def __init__(
        self,
        world: World,
        arm: str,
        margin: float | Mapping[str, float] = 0.0,
        ignore: frozenset[str] = frozenset(),
    ) -> None:
        body = world.arms[arm]
        self.joints = body.robot.joints
        self.present = world.hardware[arm].q
        self._addresses = body.qpos_ids
        self.joint_ids = world.model.dof_jntid[body.dof_ids]
        self._scratch = scratch = ScratchModel(world, (arm,))
        held = {world.object_geom(name) for name in world.attachments.attached_to(arm)}
        self.moving = scratch.marks(body.geom_ids | held)
        ignored = {world.object_geom(name) for name in ignore if name in world.objects}
        asked = scratch.solid & ~scratch.marks(ignored)
        scratch.compare(asked & self.moving, asked)
        least = np.full(scratch.model.ngeom, -TOUCH)
        for name, other in world.arms.items():
            if name != arm:
                kept = margin.get(name, 0.0) if isinstance(margin, Mapping) else margin
                marks = scratch.marks(other.geom_ids)
                scratch.report_gaps(marks, kept)
                least[marks] = kept
        self.least = np.maximum(least[:, None], least)
        gripping = scratch.marks(body.tool_geom_ids | held)
        self.least[_touching_by_design(scratch.marks(held), gripping)] = -np.inf
        self._let_stand(gripping)

    @property
    def model(self) -> mujoco.MjModel:
        """The model in which configurations are tried."""
        return self._scratch.model

    @property
    def data(self) -> mujoco.MjData:
        """Everything as it is in the configuration that was tried last."""
        return self._scratch.data

    @functools.cached_property
    def radii(self) -> Vector:
        """Metres that a point of the arm moves at most per radian of a joint, of shape (dof,)."""
        self.place(self.present)  # the last digits hang on where the arm is
        model, data = self.model, self.data
        links = model.jnt_bodyid[self.joint_ids].tolist()
        moved = {
            geom: last
            for geom in np.flatnonzero(self.moving).tolist()
            if (last := last_joint(model, links, int(model.geom_bodyid[geom]))) is not None
        }
        geoms = list(moved)
        return stretched(
            data.xanchor[self.joint_ids],
            list(moved.values()),
            data.geom_xpos[geoms],
            model.geom_rbound[geoms],
        )

    def keeping_off(self, ends: Iterable[Vector]) -> CollisionChecker:
        """The same, but what touches at none of these ends may not touch at all in between.

        Between two samples of a path a touch that is just allowed may be one that is not.

        Args:
            ends: Configurations, each of shape (dof,), rad.
        """
        strict = copy.copy(self)
        strict.least = np.where(self.least == -TOUCH, 0.0, self.least)
        for q in ends:
            self.place(q)
            for first, second in self.data.contact.geom.tolist():
                strict.least[first, second] = self.least[first, second]
                strict.least[second, first] = self.least[second, first]
        return strict

    def contact(self, q: Vector) -> Contact | None:
        """The deepest contact that the arm would have at ``q``, of shape (dof,), if any."""
        worst = self._deepest(q)
        if worst is None:
            return None
        found = self.data.contact
        first, second = sorted(found.geom[worst].tolist(), key=lambda geom: not self.moving[geom])
        names = name_of_geom(self.model, first), name_of_geom(self.model, second)
        if self.moving[second] and "/" not in names[1]:  # what it holds is no obstacle to itself
            names = names[::-1]
        return Contact(*names, float(-found.dist[worst]))

    def free(self, q: Vector) -> bool:
        """Whether the arm touches nothing at ``q``, of shape (dof,)."""
        return self._deepest(q) is None

    def first_contact(self, rows: Matrix) -> tuple[int, Contact] | None:
        """The first of several configurations, of shape (n, dof), that touches, and its contact."""
        for i, q in enumerate(rows):
            contact = self.contact(q)
            if contact is not None:
                return i, contact
        return None

    def place(self, q: Vector) -> None:
        """Let MuJoCo find where everything is, and what touches, at ``q``, of shape (dof,)."""
        self._scratch.data.qpos[self._addresses] = q
        self._scratch.settle()

    def _deepest(self, q: Vector) -> int | None:
        """Which of MuJoCo's contacts at ``q`` is the one that is too close by most, if any is."""
        self.place(q)
        data = self._scratch.data
        if data.ncon == 0:
            return None
        found = data.contact
        first, second = found.geom.T
        excess = self.least[first, second] - found.dist
        worst = int(excess.argmax())
        return worst if excess[worst] > 0.0 else None

    def _let_stand(self, gripping: Marks) -> None:
        """What touches now, and is held or of the tool, may go on touching as deep as now."""
        self.place(self.present)
        contacts = zip(self.data.contact.geom.tolist(), self.data.contact.dist, strict=True)
        for (first, second), distance in contacts:
            if (gripping[first] or gripping[second]) and -STANDING < distance <= 0.0:
                least = min(self.least[first, second], float(distance) - TOUCH)
                self.least[first, second] = self.least[second, first] = least


def _touching_by_design(held: Marks, gripping: Marks) -> npt.NDArray[np.bool_]:
    """Pairs of something held with the tool or another thing held, of shape (ngeom, ngeom)."""
    pairs: npt.NDArray[np.bool_] = (held[:, None] | held) & (gripping[:, None] & gripping)
    return pairs
