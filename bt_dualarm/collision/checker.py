"""Collision checks of an arm with MuJoCo's geoms, now or in other configurations.

- `CollisionChecker` checks configurations of an arm in a scratch copy of the world.
- `LinkContacts` and `OutsideContacts` report current contacts of an arm.
- `ScratchModel` is the copy in which distances and contacts are computed: the world itself stays
  as it is.
"""

from __future__ import annotations

import copy
import functools
import weakref
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, TypedDict

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.errors import CollisionFailure, TouchFailure
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.robots.gripper import FINGERS
from bt_dualarm.sim.composition import name_of_geom
from bt_dualarm.sim.world import World

FINE = 0.008
"""Largest motion of a point of the arm between two checks of a result, m: together with the
thickness of a link, too little to miss a wall of 10 mm."""


def last_joint(model: mujoco.MjModel, links: Sequence[int], body: int) -> int | None:
    """Index of the last joint of an arm that moves a body; None for the base, which is fixed.

    Args:
        model: Model with the arm in it.
        links: Ids of the bodies that the arm's joints move, base to tip.
        body: Id of a body of the arm, or of an object that it holds: the last joint's.
    """
    if model.body_rootid[body] != model.body_rootid[links[0]]:
        return len(links) - 1
    while body not in links and body != 0:
        body = int(model.body_parentid[body])
    return links.index(body) if body else None


def stretched(anchors: Matrix, last: Sequence[int], centers: Matrix, bounds: Vector) -> Vector:
    """Largest distance of any moved point from each joint, of shape (dof,), m.

    The length of the stretched chain from a joint over all further joints to the farthest ball: an
    upper bound in every configuration.

    Args:
        anchors: Points on the joints' axes, base to tip, of shape (dof, 3), m, in any
            configuration of the arm.
        last: Index of the last joint that moves each ball.
        centers: Centers of balls around all points, in the same configuration, of shape (n, 3), m.
        bounds: Radii of the balls, of shape (n,), m.
    """
    radii = np.zeros(len(anchors))
    np.maximum.at(radii, last, np.linalg.norm(centers - anchors[last], axis=1) + bounds)
    for i in range(len(anchors) - 2, -1, -1):
        onwards = np.linalg.norm(anchors[i + 1] - anchors[i]) + radii[i + 1]
        radii[i] = max(radii[i], onwards)
    return radii


def interpolated(start: Vector, end: Vector, radii: Vector, step: float) -> Matrix:
    """Configurations on a straight line between which no point of the arm moves more than a step.

    Args:
        start: Configuration of shape (dof,), rad.
        end: Configuration of shape (dof,), rad.
        radii: Largest motion of the arm per radian of each joint, of shape (dof,), m/rad.
        step: Largest motion between two rows, m.

    Returns:
        Rows of shape (n, dof), rad; both ends are exact, so that pieces of a path meet.
    """
    distance = float(np.abs(end - start) @ radii)
    share = np.linspace(0.0, 1.0, max(int(np.ceil(distance / step)), 1) + 1)
    rows: Matrix = start + share[:, None] * (end - start)
    rows[-1] = end
    return rows


# Copies of a world's model are reused: creating one takes 0.8 ms.

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


class ScratchCopy(NamedTuple):
    """Copy of a model with a state.

    Attributes:
        model: Copy of a world's model.
        data: State of the copy.
    """

    model: mujoco.MjModel
    data: mujoco.MjData


class _Idle:
    """Unused copies of one model."""

    def __init__(self, original: mujoco.MjModel) -> None:
        self.original = original
        self.copies: list[ScratchCopy] = []


_idle: weakref.WeakKeyDictionary[World, _Idle] = weakref.WeakKeyDictionary()


def scratch_copy(world: World, owner: object) -> ScratchCopy:
    """Copy of a world's current model for the lifetime of its owner.

    Args:
        world: World to copy.
        owner: Object with exclusive use of the copy; it is reused once the owner is collected.
    """
    idle = _idle.get(world)
    if idle is None or idle.original is not world.model:  # recompiled
        idle = _idle[world] = _Idle(world.model)
    lent = _unmarked(idle) if idle.copies else _made(world.model)
    weakref.finalize(owner, idle.copies.append, lent).atexit = False
    return lent


def _unmarked(idle: _Idle) -> ScratchCopy:
    """Reused copy with its changeable fields restored."""
    lent = idle.copies.pop()
    for field in _MARKED:
        getattr(lent.model, field)[:] = getattr(idle.original, field)
    return lent


def _made(original: mujoco.MjModel) -> ScratchCopy:
    model = copy.copy(original)
    model.opt.disableflags |= _ONE_CONTACT
    return ScratchCopy(model, mujoco.MjData(model))


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

    def compare(self, these: Bits, those: Bits) -> None:
        """Check only pairs of geoms of which one has a type bit in the other's affinity bits.

        Args:
            these: Type bits of each geom (``contype``).
            those: Affinity bits of each geom (``conaffinity``).
        """
        model = self.model
        model.geom_contype[:] = these
        model.geom_conaffinity[:] = those
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
            self._carry()
            mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)

    def _carry(self) -> None:
        """Move held objects with the tool links."""
        for position, quaternion, *link, relative in self._views:
            mujoco.mju_mulPose(position, quaternion, *link, relative.position, relative.quaternion)

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


_DEPTH = 5e-4
"""Penetration up to which a contact of a link is tolerated, m."""


class LinkContacts:
    """Current contacts of an arm's links other than its tool.

    To be rebuilt after the world is recompiled.

    Args:
        world: World that contains the arm.
        arm: Name of the arm.
    """

    def __init__(self, world: World, arm: str) -> None:
        self._world = world
        body = world.arms[arm]
        self._mine = np.zeros(world.model.ngeom, dtype=bool)
        self._mine[list(body.geom_ids)] = True
        self._links = self._mine.copy()
        self._links[list(body.tool_geom_ids)] = False

    def unwanted(self) -> TouchFailure | None:
        """Failure ``IN_COLLISION`` if a link penetrates something else than this arm, else None."""
        data = self._world.data
        if data.ncon == 0 or data.contact.dist.min() >= -_DEPTH:
            return None
        geoms = data.contact.geom
        links = self._links[geoms]
        hits = np.flatnonzero((links[:, 0] != links[:, 1]) & ~self._mine[geoms].all(axis=1))
        for i in hits.tolist():
            depth = -float(data.contact.dist[i])
            if depth > _DEPTH:
                return self._failure_of(geoms[i].tolist(), depth)
        return None

    def _failure_of(self, geoms: list[int], depth: float) -> TouchFailure:
        model = self._world.model
        pair = sorted(geoms, key=lambda geom: not self._links[geom])
        first, second = (name_of_geom(model, geom) for geom in pair)
        return TouchFailure(f"{first} touches {second}", first, second, depth_m=depth)


class OutsideContacts:
    """Current contacts of an arm and its payload with everything else.

    Reports contact as a switch does, not its force. To be rebuilt after the world is recompiled.

    Args:
        world: World that contains the arm.
        arm: Name of the arm.
    """

    def __init__(self, world: World, arm: str) -> None:
        self._world = world
        self._arm = arm
        self._mine = np.zeros(world.model.ngeom, dtype=bool)
        self._mine[list(world.arms[arm].geom_ids)] = True
        for name in world.attachments.attached_to(arm):
            self._mine[world.object_geom(name)] = True

    def deepest(self) -> tuple[str, str] | None:
        """Names of both bodies of the deepest contact, own one first; None without contact."""
        data = self._world.data
        if not data.ncon:
            return None
        geoms = data.contact.geom
        depths = -data.contact.dist
        mine = self._mine[geoms]
        outside = np.flatnonzero((mine[:, 0] != mine[:, 1]) & (depths > 0.0))
        for i in outside[np.argsort(-depths[outside])].tolist():
            pair = sorted(geoms[i].tolist(), key=lambda geom: not self._mine[geom])
            first, second = (name_of_geom(self._world.model, geom) for geom in pair)
            if second.partition("/")[0] != self._arm:  # the arm's pedestal has its name
                return first, second
        return None


TOUCH = 5e-4
"""Penetration up to which bodies touch without colliding, m: objects at rest sink in as much."""

STANDING = 3e-3
"""Penetration up to which an existing contact may continue, m: tool and held objects are pressed
against others when picking and placing."""


@dataclass(frozen=True)
class Contact:
    """Two bodies that are closer than allowed.

    Attributes:
        first: Name of the arm's link, or of the object that it holds.
        second: Name of the other body.
        depth: Penetration, m; negative for a gap.
    """

    first: str
    second: str
    depth: float

    def failure(self) -> CollisionFailure:
        """Failure for a motion that would cause this contact."""
        how = f"{1e3 * self.depth:.1f} mm deep in" if self.depth > 0.0 else "too close to"
        reason = f"{self.first} would be {how} {self.second}"
        return CollisionFailure(reason, self.first, self.second, depth_m=self.depth)


class CollisionChecker:
    """Checks configurations of one arm against the world as it is at creation.

    Held objects move with the arm. Existing contacts of the tool and of held objects may continue
    at their depth. Everything else, including other arms, stays in place: create a new checker when
    the world has changed. Can be pickled, and checks the same in any process.

    Args:
        world: World to check against; never changed.
        arm: Name of the arm.
        margin: Distance to keep from other arms, m: one for all, or by name; arms that are not
            named must not be touched.
        ignore: Names of objects that may be touched.

    Attributes:
        joints: Names of the arm's joints, base to tip.
        present: Joint positions at creation, of shape (dof,), rad.
        moving: Geoms that move with the arm, including those of held objects.
        joint_ids: Ids of the joints in the model, base to tip.
        least: Least allowed distance of each pair of geoms, of shape (ngeom, ngeom), m; negative
            where penetration is allowed.
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
        self._fingers = _finger_addresses(world, arm)
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
        """Model in which configurations are tried."""
        return self._scratch.model

    @property
    def data(self) -> mujoco.MjData:
        """State in the configuration that was tried last."""
        return self._scratch.data

    @functools.cached_property
    def radii(self) -> Vector:
        """Largest motion of the arm per radian of each joint, of shape (dof,), m/rad."""
        # A defined configuration: rounding of the last digits depends on it.
        self.place(self.present)
        model = self.model
        data = self.data
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
        """Stricter checker for a path: pairs in contact at neither end must not touch in between.

        Between two samples of a path, a contact of tolerated depth may become deeper.

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
        """Deepest contact that the arm would have at ``q``, of shape (dof,), rad; None if free."""
        worst = self._deepest(q)
        if worst is None:
            return None
        found = self.data.contact
        first, second = sorted(found.geom[worst].tolist(), key=lambda geom: not self.moving[geom])
        names = name_of_geom(self.model, first), name_of_geom(self.model, second)
        if self.moving[second] and "/" not in names[1]:  # name the held object first
            names = names[::-1]
        return Contact(*names, float(-found.dist[worst]))

    def free(self, q: Vector) -> bool:
        """Whether the arm is free of collisions at ``q``, of shape (dof,), rad."""
        return self._deepest(q) is None

    def first_contact(self, rows: Matrix) -> tuple[int, Contact] | None:
        """Index and contact of the first configuration in contact, of rows (n, dof), rad."""
        for i, q in enumerate(rows):
            contact = self.contact(q)
            if contact is not None:
                return i, contact
        return None

    def open_fingers(self, width: float) -> None:
        """Set the gripper opening in m for all further configurations."""
        self._scratch.data.qpos[self._fingers] = 0.5 * width

    def place(self, q: Vector) -> None:
        """Compute kinematics and contacts at ``q``, of shape (dof,), rad."""
        self._scratch.data.qpos[self._addresses] = q
        self._scratch.settle()

    def _deepest(self, q: Vector) -> int | None:
        """Index of the contact at ``q`` that violates its least distance most; None if free."""
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
        """Allow existing contacts of tool and held objects to continue at their depth."""
        self.place(self.present)
        contacts = zip(self.data.contact.geom.tolist(), self.data.contact.dist, strict=True)
        for (first, second), distance in contacts:
            if (gripping[first] or gripping[second]) and -STANDING < distance <= 0.0:
                least = min(self.least[first, second], float(distance) - TOUCH)
                self.least[first, second] = self.least[second, first] = least


def _finger_addresses(world: World, arm: str) -> list[int]:
    """Addresses of an arm's finger joints in ``qpos``; empty if its gripper has no fingers."""
    gripper = world.grippers.get(arm)
    if gripper is None or not gripper.gripper.fingers:
        return []
    return [int(world.model.joint(f"{arm}/{finger}").qposadr[0]) for finger in FINGERS]


def _touching_by_design(held: Marks, gripping: Marks) -> npt.NDArray[np.bool_]:
    """Pairs of a held object with the tool or another held object, of shape (ngeom, ngeom)."""
    pairs: npt.NDArray[np.bool_] = (held[:, None] | held) & (gripping[:, None] & gripping)
    return pairs
