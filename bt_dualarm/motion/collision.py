"""Would an arm touch something in a configuration? MuJoCo's shapes, without moving the world."""

from __future__ import annotations

import copy
import functools
from collections.abc import Iterable, Set
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.errors import Failure
from bt_dualarm.motion.sweep import sweep_radii
from bt_dualarm.pose import Matrix, Pose, Vector
from bt_dualarm.world.attachments import Attachment
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
        depth: How deep the shapes are in each other in metres; negative for a gap.
    """

    first: str
    second: str
    depth: float

    def failure(self) -> Failure:
        """This contact as the reason of a refusal."""
        how = f"{1e3 * self.depth:.1f} mm deep in" if self.depth > 0.0 else "too close to"
        return Failure(
            "IN_COLLISION",
            f"{self.first} would be {how} {self.second}",
            first=self.first,
            second=self.second,
            depth_m=self.depth,
        )


class CollisionChecker:
    """Configurations of one arm against the world as it is at this moment.

    What the arm holds moves with it. What its tool and what it holds touch now, they may go on
    touching as deep as now. Everything else, other arms too, stays where it is now: make a
    new checker when the world has gone on. It can be pickled, and checks alike in any process.

    Args:
        world: Looked at now, and never changed.
        arm: Name of the arm.
        margin: Distance in metres that other arms must keep from this one.
        ignore: Objects that may be touched.

    Attributes:
        joints: Names of the arm's, base to tip; ``joint_ids``, their numbers in ``model``.
        present: Where they are now, of shape (dof,), rad.
        moving: Which shapes move with the arm, of shape (ngeom,); ``held``, those that it holds.
    """

    def __init__(
        self, world: World, arm: str, margin: float = 0.0, ignore: frozenset[str] = frozenset()
    ) -> None:
        body = world.arms[arm]
        self.joints = body.robot.joints
        self.joint_ids = world.model.dof_jntid[body.dof_ids]
        self.present = body.q
        self.model = copy.copy(world.model)
        self._positions = world.data.qpos.copy()
        self._addresses, self._tool_body = body.qpos_ids, body.tool_body
        self._held = [_Held.find(world, held) for held in world.attachments if held.arm == arm]
        self.held = frozenset(held.geom for held in self._held)
        self.moving = self._marked(body.geom_ids | self.held)
        others = (other.geom_ids for name, other in world.arms.items() if name != arm)
        other_arm = self._marked(frozenset().union(*others))
        self._leave_out({world.object_geom(name) for name in ignore if name in world.objects})
        self._widen(margin, other_arm)
        self._least = np.where(other_arm[:, None] | other_arm, margin, -TOUCH)
        self._least[self._touching_by_design(body.tool_geom_ids)] = -np.inf
        self.data = self._fresh_data()
        self._let_stand(body.tool_geom_ids)

    def __getstate__(self) -> dict[str, Any]:
        """All but what MuJoCo computes from the rest: what another process needs to check, too."""
        return {name: value for name, value in vars(self).items() if name != "data"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """The same checker in another process."""
        vars(self).update(state)
        self.data = self._fresh_data()

    @functools.cached_property
    def radii(self) -> Vector:
        """Metres that a point of the arm moves at most per radian of a joint, of shape (dof,)."""
        self.place(self.present)  # the last digits hang on where the arm is
        moving = np.flatnonzero(self.moving).tolist()
        return sweep_radii(self.model, self.data, self.joint_ids, moving, self.held)

    def keeping_off(self, ends: Iterable[Vector]) -> CollisionChecker:
        """The same, but what touches at none of these ends may not touch at all in between.

        Between two samples of a way a touch that is just allowed may be one that is not.

        Args:
            ends: Configurations, each of shape (dof,).
        """
        strict = copy.copy(self)
        strict._least = np.where(self._least == -TOUCH, 0.0, self._least)
        for q in ends:
            self.place(q)
            for first, second in self.data.contact.geom.tolist():
                strict._least[first, second] = self._least[first, second]
                strict._least[second, first] = self._least[second, first]
        return strict

    def contact(self, q: Vector) -> Contact | None:
        """The deepest contact that the arm would have at ``q``, of shape (dof,), if any."""
        worst = self._deepest(q)
        if worst is None:
            return None
        return self._described(self.data.contact.geom[worst], float(-self.data.contact.dist[worst]))

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
        model, data = self.model, self.data
        data.qpos[self._addresses] = q
        mujoco.mj_kinematics(model, data)
        if self._held:
            self._carry()
            mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)

    def _deepest(self, q: Vector) -> int | None:
        """Which of MuJoCo's contacts at ``q`` is the one that is too close by most, if any is."""
        self.place(q)
        if self.data.ncon == 0:
            return None
        pairs = self.data.contact.geom
        excess = self._least[pairs[:, 0], pairs[:, 1]] - self.data.contact.dist
        worst = int(excess.argmax())
        return worst if excess[worst] > 0.0 else None

    def _fresh_data(self) -> Any:
        data = mujoco.MjData(self.model)
        data.qpos[:] = self._positions
        return data

    def _marked(self, geoms: Set[int]) -> npt.NDArray[np.bool_]:
        """Which of all shapes are these, of shape (ngeom,)."""
        marks = np.zeros(self.model.ngeom, dtype=bool)
        marks[list(geoms)] = True
        return marks

    def _touching_by_design(self, tool_geoms: frozenset[int]) -> npt.NDArray[np.bool_]:
        """Pairs of something held with the tool or another thing held, of shape (ngeom, ngeom)."""
        held, gripping = self._marked(self.held), self._marked(tool_geoms | self.held)
        pairs: npt.NDArray[np.bool_] = (held[:, None] | held) & (gripping[:, None] & gripping)
        return pairs

    def _let_stand(self, tool_geoms: frozenset[int]) -> None:
        """What touches now, and is held or of the tool, may go on touching as deep as now."""
        self.place(self.present)
        gripping = tool_geoms | self.held
        contacts = zip(self.data.contact.geom.tolist(), self.data.contact.dist, strict=True)
        for (first, second), distance in contacts:
            if {first, second} & gripping and -STANDING < distance <= 0.0:
                least = min(self._least[first, second], float(distance) - TOUCH)
                self._least[first, second] = self._least[second, first] = least

    def _carry(self) -> None:
        """Put what the arm holds where its tool link now is."""
        data, link = self.data, self._tool_body
        place = Pose(data.xpos[link].copy(), data.xquat[link].copy())
        for held in self._held:
            pose = place @ held.relative
            data.qpos[held.address : held.address + 3] = pose.position
            data.qpos[held.address + 3 : held.address + 7] = pose.quaternion

    def _leave_out(self, ignored: set[int]) -> None:
        """Let MuJoCo look only at pairs in which this arm, or what it holds, takes part."""
        model = self.model
        solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        model.geom_contype[:] = solid & self.moving
        model.geom_conaffinity[:] = solid
        for geom in ignored:
            model.geom_contype[geom] = model.geom_conaffinity[geom] = 0

    def _widen(self, margin: float, geoms: npt.NDArray[np.bool_]) -> None:
        """Make MuJoCo report gaps to these shapes up to the margin."""
        model = self.model
        model.geom_margin[geoms] = margin
        model.body_margin[np.unique(model.geom_bodyid[geoms])] = margin

    def _described(self, geoms: npt.NDArray[np.int32], depth: float) -> Contact:
        first, second = sorted(geoms.tolist(), key=lambda geom: not self.moving[geom])
        return Contact(self._body_name(first), self._body_name(second), depth)

    def _body_name(self, geom: int) -> str:
        name = self.model.body(self.model.geom_bodyid[geom]).name
        if name in ("", "world"):
            name = self.model.geom(geom).name
        return str(name or "the scene")


@dataclass(frozen=True, eq=False)
class _Held:
    """An object that moves with the arm: its shape, address of its pose, place in the tool link."""

    geom: int
    address: int
    relative: Pose

    @classmethod
    def find(cls, world: World, attachment: Attachment) -> _Held:
        joint = world.model.body_jntadr[world.object_body(attachment.object)]
        return cls(
            geom=world.object_geom(attachment.object),
            address=int(world.model.jnt_qposadr[joint]),
            relative=attachment.relative,
        )
