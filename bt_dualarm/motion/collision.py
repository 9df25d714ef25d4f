"""Would an arm touch something in a configuration? MuJoCo's shapes, without moving the world."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.errors import Failure
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
    new checker when the world has gone on.

    Args:
        world: Looked at now, and never changed.
        arm: Name of the arm.
        margin: Distance in metres that other arms must keep from this one.
        ignore: Objects that may be touched.
    """

    def __init__(
        self, world: World, arm: str, margin: float = 0.0, ignore: frozenset[str] = frozenset()
    ) -> None:
        self.world, self.arm = world, arm
        self.body = world.arms[arm]
        self._model = copy.copy(world.model)
        self._data = mujoco.MjData(self._model)
        self._data.qpos[:] = world.data.qpos
        self._held = [_Held.find(world, held) for held in world.attachments if held.arm == arm]
        self.moving = np.zeros(self._model.ngeom, dtype=bool)
        self.moving[[*self.body.geom_ids, *(held.geom for held in self._held)]] = True
        self._other_arm = np.zeros(self._model.ngeom, dtype=bool)
        for name, body in world.arms.items():
            self._other_arm[list(body.geom_ids)] = name != arm
        self._margin = margin
        self._leave_out({world.object_geom(name) for name in ignore if name in world.objects})
        self._widen(margin)
        self._standing: dict[frozenset[int], float] = {}
        self._standing = self._standing_contacts(self.body.q)

    def contact(self, q: Vector) -> Contact | None:
        """The deepest contact that the arm would have at ``q``, of shape (dof,), if any."""
        self._place(q)
        if self._data.ncon == 0:
            return None
        geoms, distance = self._data.contact.geom, self._data.contact.dist
        excess = self._allowed(geoms) - distance
        worst = int(np.argmax(excess))
        if excess[worst] <= 0.0:
            return None
        return self._described(geoms[worst], float(-distance[worst]))

    def free(self, q: Vector) -> bool:
        """Whether the arm touches nothing at ``q``, of shape (dof,)."""
        return self.contact(q) is None

    def first_contact(self, rows: Matrix) -> tuple[int, Contact] | None:
        """The first of several configurations, of shape (n, dof), that touches, and its contact."""
        for i, q in enumerate(rows):
            contact = self.contact(q)
            if contact is not None:
                return i, contact
        return None

    def _place(self, q: Vector) -> None:
        """Let MuJoCo find what touches at ``q``."""
        data = self._data
        data.qpos[self.body.qpos_ids] = q
        mujoco.mj_kinematics(self._model, data)
        if self._held:
            self._carry()
            mujoco.mj_kinematics(self._model, data)
        mujoco.mj_collision(self._model, data)

    def _allowed(self, geoms: npt.NDArray[np.int32]) -> Vector:
        """Distance that each pair of shapes, of shape (n, 2), must keep, of shape (n,)."""
        allowed = np.where(self._other_arm[geoms].any(axis=1), self._margin, -TOUCH)
        allowed[self._touching_by_design(geoms)] = -np.inf
        if self._standing:
            for i, pair in enumerate(geoms.tolist()):
                allowed[i] = min(allowed[i], self._standing.get(frozenset(pair), np.inf))
        return allowed

    def _standing_contacts(self, q: Vector) -> dict[frozenset[int], float]:
        """Pairs that touch now, one of them held or of the tool, and the distance to keep."""
        self._place(q)
        gripping = self.body.tool_geom_ids | {held.geom for held in self._held}
        contacts = zip(self._data.contact.geom.tolist(), self._data.contact.dist, strict=True)
        return {
            frozenset(pair): float(distance) - TOUCH
            for pair, distance in contacts
            if gripping & set(pair) and -STANDING < distance <= 0.0
        }

    def _carry(self) -> None:
        """Put what the arm holds where its tool link now is."""
        data, link = self._data, self.body.tool_body
        place = Pose(data.xpos[link].copy(), data.xquat[link].copy())
        for held in self._held:
            pose = place @ held.relative
            data.qpos[held.address : held.address + 3] = pose.position
            data.qpos[held.address + 3 : held.address + 7] = pose.quaternion

    def _touching_by_design(self, geoms: npt.NDArray[np.int32]) -> npt.NDArray[np.bool_]:
        """Contacts of what is held with the tool that holds it, and among things held."""
        held = np.zeros(self._model.ngeom, dtype=bool)
        held[[one.geom for one in self._held]] = True
        tool = held.copy()
        tool[list(self.body.tool_geom_ids)] = True
        return np.logical_and(held[geoms].any(axis=1), tool[geoms].all(axis=1))

    def _leave_out(self, ignored: set[int]) -> None:
        """Let MuJoCo look only at pairs in which this arm, or what it holds, takes part."""
        model = self._model
        solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        model.geom_contype[:] = solid & self.moving
        model.geom_conaffinity[:] = solid
        for geom in ignored:
            model.geom_contype[geom] = model.geom_conaffinity[geom] = 0

    def _widen(self, margin: float) -> None:
        """Make MuJoCo report gaps to other arms up to the margin."""
        model = self._model
        model.geom_margin[self._other_arm] = margin
        model.body_margin[np.unique(model.geom_bodyid[self._other_arm])] = margin

    def _described(self, geoms: npt.NDArray[np.int32], depth: float) -> Contact:
        first, second = sorted(geoms.tolist(), key=lambda geom: not self.moving[geom])
        return Contact(self._body_name(first), self._body_name(second), depth)

    def _body_name(self, geom: int) -> str:
        name = self._model.body(self._model.geom_bodyid[geom]).name
        if name in ("", "world"):
            name = self._model.geom(geom).name
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
