"""Collision checks of one arm, in its current configuration or in any other.

- `CollisionChecker` checks configurations of an arm without moving the world.
- `LinkContacts` and `OutsideContacts` report the current contacts of an arm.
- `interpolated` samples a straight path by the largest motion of the arm.
- `ScratchModel` is the copy of the world in which configurations are tried. Copies are pooled,
  since creating one takes 0.8 ms.
"""

from __future__ import annotations

import copy
import functools
import itertools
import weakref
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, TypeAlias, TypedDict

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.errors import CollisionFailure, TouchFailure
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.robots.gripper import FINGERS
from bt_dualarm.sim.composition import ArmBody, name_of_geom
from bt_dualarm.sim.grippers import SharedGrasp
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

_Geoms: TypeAlias = int | npt.NDArray[np.int64]
"""Index of a geom, or indices of several."""

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


def carried_on(world: World, obj: str, link: int, relative: Pose) -> Iterator[Carried]:
    """An object that moves with a link, and its passengers where they are on it now.

    Args:
        world: World in its current state.
        obj: Name of the object.
        link: Id of the body that carries it.
        relative: Pose of the object in that body.
    """
    yield Carried(world.pose_address(obj), link, relative)
    passengers = world.passengers_of(obj)
    if passengers:
        to_object = _sensed_pose(world, obj).inverse
        for one in passengers:
            place = to_object @ _sensed_pose(world, one.object)
            yield Carried(world.pose_address(one.object), link, relative @ place)


def _sensed_pose(world: World, obj: str) -> Pose:
    address = world.pose_address(obj)
    pose = world.sensed.qpos[address : address + 7]
    return Pose(pose[:3].copy(), pose[3:].copy())


class Violation(NamedTuple):
    """Two geoms that are closer than allowed.

    Attributes:
        geoms: Their indices.
        distance: Their distance, m; negative for penetration.
        excess: What the distance lacks, m.
    """

    geoms: tuple[int, int]
    distance: float
    excess: float


class BoxPairs(NamedTuple):
    """Pairs of boxes of which contacts do not tell the distance, see `ScratchModel.apart`.

    Attributes:
        first: Index of the first geom of each pair, of shape (n,).
        second: Index of the second one.
        reach_squared: Square of the distance of their centers beyond which they keep their minimum
            distance for certain, of shape (n,), m².
    """

    first: npt.NDArray[np.int64]
    second: npt.NDArray[np.int64]
    reach_squared: Vector


class _State(TypedDict):
    """Pickled state of a scratch model."""

    model: mujoco.MjModel
    positions: Vector
    carried: tuple[Carried, ...]


class ScratchModel:
    """Copy of a world's model and state, in which configurations are tried.

    Can be pickled, and measures the same in any process. Must be rebuilt after the world is
    recompiled.

    Args:
        world: World to copy; never changed.
        holders: Names of the arms whose held objects move with them; all others stay in place.
        carried: Objects that move with a link although no arm holds them yet, or as if they moved
            with that link only.

    Attributes:
        model: Copy of the world's model, whose collision bits and margins may be changed.
        data: State of the copy; the caller sets positions, then calls `settle`.
    """

    def __init__(
        self, world: World, holders: Collection[str] = (), carried: Sequence[Carried] = ()
    ) -> None:
        self.model, self.data = scratch_copy(world, self)
        self._positions: Vector = world.sensed.qpos.copy()
        # No dynamics are simulated here that would hold an object: it follows its tool rigidly.
        addresses = {one.address for one in carried}
        held = (
            one
            for held in world.attachments
            # What moves on a joint does not follow the arm: it stays where it is.
            if held.arm in holders and world.objects[held.object].joint is None
            for one in carried_on(world, held.object, world.arms[held.arm].tool_body, held.relative)
        )
        self._carried = (*carried, *(one for one in held if one.address not in addresses))
        self._begin()

    def worst_violation(self, least: Matrix, boxes: BoxPairs) -> Violation | None:
        """Pair of geoms that violates its minimum distance most; None if none does.

        Args:
            least: Minimum distances of all pairs of geoms, of shape (ngeom, ngeom), m.
            boxes: Pairs of boxes that `box_pairs` found, measured whether or not MuJoCo reports a
                contact.
        """
        worst = self._worst_contact(least)
        if not len(boxes.first):
            return worst
        near = self.squared_between(boxes.first, boxes.second) < boxes.reach_squared
        if np.count_nonzero(near):
            for index in np.flatnonzero(near).tolist():
                pair = int(boxes.first[index]), int(boxes.second[index])
                kept = float(least[pair])
                distance = self.apart(*pair, kept)
                if distance < kept and (worst is None or kept - distance > worst.excess):
                    worst = Violation(pair, distance, kept - distance)
        return worst

    def _worst_contact(self, least: Matrix) -> Violation | None:
        """Contact that violates its minimum distance most, as `worst_violation`."""
        if self.data.ncon == 0:
            return None
        found = self.data.contact
        first, second = found.geom.T
        # MuJoCo's distance of a contact is negative for penetration.
        excess = least[first, second] - found.dist
        worst = int(excess.argmax())
        while excess[worst] > 0.0:
            pair = int(first[worst]), int(second[worst])
            distance = float(found.dist[worst])
            most = float(least[pair])
            if distance > 0.0 and self.boxes[list(pair)].all():
                distance = self.apart(*pair, most)
            if distance < most:
                return Violation(pair, distance, most - distance)
            excess[worst] = 0.0
            worst = int(excess.argmax())
        return None

    def box_pairs(self, least: Matrix, moving: Marks) -> BoxPairs:
        """Pairs of boxes that have to keep a distance from each other, of which one moves.

        Args:
            least: Minimum distances of all pairs of geoms, of shape (ngeom, ngeom), m.
            moving: Geoms that move.
        """
        boxes = self.boxes & self.solid
        bodies = self.model.geom_bodyid
        wanted = (least > 0.0) & boxes[:, None] & boxes & (moving[:, None] | moving)
        wanted &= bodies[:, None] != bodies
        first, second = np.nonzero(np.triu(wanted))
        bounds = self.model.geom_rbound
        reach = bounds[first] + bounds[second] + least[first, second]
        return BoxPairs(first, second, reach**2)

    def squared_between(
        self, first: npt.NDArray[np.int64], second: npt.NDArray[np.int64]
    ) -> Vector:
        """Squares of the distances between the centers of pairs of geoms, of shape (n,), m²."""
        between = self._centers.take(first, 0) - self._centers.take(second, 0)
        squares: Vector = np.einsum("ij,ij->i", between, between)
        return squares

    def apart(self, first: int, second: int, most: float) -> float:
        """Distance of two geoms, at most ``most``, m.

        Contacts do not tell how far boxes are apart: of random ones at 20 to 45 mm, MuJoCo reports
        no contact in 18 % of cases, however large the margin, and in others a distance that is off
        by up to 20 mm.
        """
        return float(mujoco.mj_geomDistance(self.model, self.data, first, second, most, None))

    def __getstate__(self) -> _State:
        """State without what MuJoCo computes from the rest.

        The positions are the present ones: fingers and objects may have been moved.
        """
        return {"model": self.model, "positions": self.data.qpos.copy(), "carried": self._carried}

    def __setstate__(self, state: _State) -> None:
        """Restore the scratch model, in another process."""
        self.model = state["model"]
        self._positions = state["positions"]
        self._carried = state["carried"]
        # A copy of its own, outside the pool: another process has no world to lend from.
        self.data = mujoco.MjData(self.model)
        self._begin()

    @property
    def boxes(self) -> Marks:
        """Geoms that are boxes."""
        boxes: Marks = self.model.geom_type == mujoco.mjtGeom.mjGEOM_BOX
        return boxes

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

    def report_gaps(self, marks: Marks, distance: float | Vector) -> None:
        """Report geoms nearer to the selected ones than a distance, not only contacts.

        Args:
            marks: The selected geoms.
            distance: The distance in m: one for all, or one for each geom of the model.
        """
        model = self.model
        margins = np.broadcast_to(distance, len(marks))
        model.geom_margin[marks] = margins[marks]
        np.maximum.at(model.body_margin, model.geom_bodyid[marks], margins[marks])

    def settle(self, *, carrying: bool = True) -> None:
        """Compute kinematics and contacts at the positions in ``data``.

        Args:
            carrying: Whether carried objects follow their links, instead of staying in place.
        """
        model = self.model
        data = self.data
        mujoco.mj_kinematics(model, data)
        if self._carried and carrying:
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
        # Fields of the state as views: looking one up costs more.
        self._centers = data.geom_xpos
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


FINE = 0.008
"""Largest motion of a point of the arm between two checks of a result, m: together with the
thickness of a link, too little to miss a wall of 10 mm."""

TOUCH = 5e-4
"""Penetration up to which bodies touch without colliding, m: resting objects penetrate as much."""

STANDING = 3e-3
"""Penetration up to which an existing contact may continue, m: tool and held objects are pressed
against others when picking and placing."""

NARROW = 2e-3
"""Room up to which something is enclosed between two others, m: that of a peg in its hole."""

_OPPOSITE = -0.9
"""Cosine of the angle between two normals from which sides are opposite."""

_DEPTH_SHOWN = 5e-5
"""Penetration from which a message states it, m."""


@dataclass(frozen=True)
class Contact:
    """Two bodies that are closer than allowed.

    Attributes:
        first: Name of the arm's link, or of the object that it holds.
        second: Name of the other body.
        depth: Penetration, m; negative for a gap.
        at: Configuration in which they are, rad; none if several arms are involved.
    """

    first: str
    second: str
    depth: float
    at: tuple[float, ...] = ()

    def failure(self) -> CollisionFailure:
        """Failure for a motion that would cause this contact."""
        how = f"{1e3 * self.depth:.1f} mm deep in"
        if self.depth < _DEPTH_SHOWN:
            how = "touching" if self.depth > 0.0 else "too close to"
        reason = f"{self.first} would be {how} {self.second}"
        failure = CollisionFailure(reason, self.first, self.second, depth_m=self.depth)
        failure.at = self.at
        return failure


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
        ignore: Names of objects that may be touched, with what rides on one that the arm holds, and
            of arms that yield.
        sharing: Objects that others may hold together with this arm; by default those for which
            both have consented.
        tool_may_touch: Whether the tool and held objects may touch everything but the arm itself.

    Attributes:
        joints: Names of the arm's joints, base to tip.
        present: Joint positions at creation, of shape (dof,), rad.
        moving: Geoms that move with the arm, including those of held objects.
        joint_ids: Ids of the joints in the model, base to tip.
        least: Minimum allowed distance of each pair of geoms, of shape (ngeom, ngeom), m; negative
            where penetration is allowed.
    """

    def __init__(
        self,
        world: World,
        arm: str,
        margin: float | Mapping[str, float] = 0.0,
        ignore: frozenset[str] = frozenset(),
        *,
        tool_may_touch: bool = False,
        sharing: Sequence[SharedGrasp] | None = None,
    ) -> None:
        body = world.arms[arm]
        self.joints = body.robot.joints
        self.present = world.hardware[arm].q
        self._addresses = body.qpos_ids
        rules = _rules_of(world, arm, margin, ignore, tool_may_touch, sharing)
        self._fingers = rules.fingers
        self.joint_ids = rules.joint_ids
        self._scratch = scratch = ScratchModel(world, (arm,))
        for field, value in rules.marks.items():
            getattr(scratch.model, field)[:] = value
        self.moving = rules.moving
        self.least = rules.least.copy()
        self._tool = rules.tool
        self._gripping = rules.gripping
        self._boxes = rules.boxes
        self.let_stand(self.present)

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
        # The bound holds in any configuration, but its last digits depend on the one it is computed
        # in, and with them the samples of a path: always the same one.
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

    def without_new_contacts(
        self, ends: Iterable[Vector], start: Vector | None = None
    ) -> CollisionChecker:
        """Stricter checker for a path: pairs in contact at neither end must not touch in between.

        Between two samples of a path, a contact of tolerated depth may become deeper than that. A
        tool that touches an object at an end may graze it with any other of its parts: one of two
        closed fingertips often rests on an object while the other is a hair above it.

        Args:
            ends: Configurations, each of shape (dof,), rad.
            start: The one of them at which the arm may touch itself; by default at each. An arm
                that stays where it touches itself presses against itself.
        """
        strict = copy.copy(self)
        links = self.moving & ~self._gripping
        parts = links | self._tool
        strict.least = np.where(self.least == -TOUCH, 0.0, self.least)
        for q in ends:
            self.place(q)
            found = self.data.contact
            # Two boxes that touch have several contacts, of one pair of geoms.
            for pair in np.unique(found.geom[found.dist <= 0.0], axis=0).tolist():
                if start is not None and q is not start and parts[pair].all() and links[pair].any():
                    continue
                first, second = (self._parts_with(geom) for geom in pair)
                one, other = first[:, None], second
                strict.least[one, other] = self.least[one, other]
                strict.least[other, one] = self.least[other, one]
        return strict

    def _parts_with(self, geom: int) -> npt.NDArray[np.int64]:
        """Geoms of the same body, or of the whole tool."""
        bodies = self.model.geom_bodyid
        return np.flatnonzero(self._tool if self._tool[geom] else bodies == bodies[geom])

    def keeping(self, distance: float, ends: Iterable[Vector]) -> CollisionChecker:
        """Stricter checker for a path: keeps a distance in m from everything but the arm itself.

        What is nearer than that at an end may be as near on the whole path.

        Args:
            distance: The distance, m.
            ends: Configurations, each of shape (dof,), rad.
        """
        roomy = copy.copy(self)
        scratch = self._scratch
        scratch.report_gaps(self.moving, np.maximum(scratch.model.geom_margin, distance))
        wider = (self.moving[:, None] ^ self.moving) & np.isfinite(self.least)
        most = np.where(wider, distance, -np.inf)
        for q in ends:
            self.place(q)
            found = self.data.contact
            for (first, second), gap in zip(found.geom.tolist(), found.dist.tolist(), strict=True):
                most[first, second] = most[second, first] = min(most[first, second], gap - TOUCH)
        roomy.least = np.maximum(self.least, most)
        return roomy

    def let_stand(self, q: Vector, deepest: float = STANDING) -> None:
        """Allow the contacts of tool and held objects at ``q`` to continue at their depth.

        The rest of the tool may then touch the same object, see `without_new_contacts`.

        Args:
            q: Configuration, of shape (dof,), rad: where the arm is, or is commanded to be.
            deepest: Penetration in m of a contact that is not allowed.
        """
        gripping = self._gripping
        self.place(q)
        contacts = zip(self.data.contact.geom.tolist(), self.data.contact.dist, strict=True)
        for pair, distance in contacts:
            one, other = pair
            if not ((gripping[one] or gripping[other]) and -deepest < distance <= 0.0):
                continue
            # As deep as now, with the tolerance of any other contact on top.
            if distance - TOUCH < self.least[one, other]:
                self._allow(one, other, float(distance) - TOUCH)
                first, second = (self._parts_with(geom) for geom in pair)
                self._allow(first[:, None], second, -TOUCH)

    @property
    def is_touching(self) -> bool:
        """Whether the tool, or what it holds, touches something else where the arm is now."""
        gripping = self._gripping
        self.place(self.present)
        found = self.data.contact
        pairs = found.geom[found.dist <= 0.0]
        return bool((gripping[pairs[:, 0]] ^ gripping[pairs[:, 1]]).any())

    def enclosing(self, q: Vector) -> tuple[str, str, str] | None:
        """Names of the tool, or of a held object, and of two things that it is between at ``q``.

        Out of there leads a short straight line at most, which random samples hardly find. The
        checker reports gaps from then on; use another one for anything else.

        Args:
            q: Configuration, of shape (dof,), rad.

        Returns:
            Both things may be the same one, with a hole. None if there is more than `NARROW` to one
            of two opposite sides.
        """
        self._scratch.report_gaps(self._gripping, NARROW)
        self.place(q)
        found = self.data.contact
        sides: list[tuple[Vector, int, int]] = []
        for (first, second), frame in zip(found.geom.tolist(), found.frame, strict=True):
            if self._gripping[first] and not self.moving[second]:
                sides.append((frame[:3].copy(), first, second))
            elif self._gripping[second] and not self.moving[first]:
                sides.append((-frame[:3], second, first))
        for (normal, own, one), (opposite, _, other) in itertools.combinations(sides, 2):
            if normal @ opposite < _OPPOSITE:
                names = [name_of_geom(self.model, geom) for geom in (own, one, other)]
                return names[0], names[1], names[2]
        return None

    def contact(self, q: Vector) -> Contact | None:
        """Deepest contact that the arm would have at ``q``, of shape (dof,), rad; None if free."""
        worst = self._worst_at(q)
        if worst is None:
            return None
        first, second = sorted(worst.geoms, key=lambda geom: not self.moving[geom])
        names = name_of_geom(self.model, first), name_of_geom(self.model, second)
        if self.moving[second] and "/" not in names[1]:  # name the held object first
            names = names[::-1]
        return Contact(*names, -worst.distance, tuple(np.asarray(q).tolist()))

    def free(self, q: Vector) -> bool:
        """Whether the arm is free of collisions at ``q``, of shape (dof,), rad."""
        return self._worst_at(q) is None

    def first_contact(self, rows: Matrix) -> tuple[int, Contact] | None:
        """Index and contact of the first configuration in contact, of rows (n, dof), rad."""
        for i, q in enumerate(rows):
            contact = self.contact(q)
            if contact is not None:
                return i, contact
        return None

    def keep_clear(self, distance: float, *, itself: bool = False) -> None:
        """Keep a distance in m from everything but arms, for all further configurations.

        For configurations in which the arm stays: it sags by a fraction of a millimeter, and would
        press against what it touches then. What is nearer to the arm now may stay as near as it was
        allowed to be.

        Args:
            distance: The distance, m.
            itself: Whether other parts of the arm keep it, too.
        """
        self._scratch.report_gaps(self.moving, distance)
        self.place(self.present)
        pairs = np.bitwise_or if itself else np.bitwise_xor
        wider = pairs(self.moving[:, None], self.moving) & np.isfinite(self.least)
        for first, second in self.data.contact.geom.tolist():
            wider[first, second] = wider[second, first] = False
        self.least[wider] = np.maximum(self.least[wider], distance)

    def open_fingers(self, width: float) -> None:
        """Set the gripper opening in m for all further configurations."""
        # Both fingers move by half of the opening; the scratch state keeps it between checks.
        self._scratch.data.qpos[self._fingers] = 0.5 * width

    def move_joint(self, name: str, position: float) -> None:
        """Put an object that moves on a joint elsewhere, for all further configurations.

        Args:
            name: Name of the object.
            position: Position of its joint, rad or m.
        """
        model = self._scratch.model
        joint = model.body_jntadr[model.body(name).id]
        self._scratch.data.qpos[model.jnt_qposadr[joint]] = position

    def move_object(self, name: str, pose: Pose) -> None:
        """Put a free object elsewhere in the world, for all further configurations."""
        model = self._scratch.model
        address = model.jnt_qposadr[model.body_jntadr[model.body(name).id]]
        self._scratch.data.qpos[address : address + 7] = (*pose.position, *pose.quaternion)

    def move_other(self, arm: ArmBody, q: Vector) -> None:
        """Put another arm into a configuration, of shape (dof,), rad, for all further checks."""
        self._scratch.data.qpos[arm.qpos_ids] = q

    def place(self, q: Vector) -> None:
        """Compute kinematics and contacts at ``q``, of shape (dof,), rad."""
        self._scratch.data.qpos[self._addresses] = q
        self._scratch.settle()

    def _worst_at(self, q: Vector) -> Violation | None:
        """Pair that violates its minimum distance most at ``q``; None if the arm is free there."""
        self.place(q)
        return self._scratch.worst_violation(self.least, self._boxes)

    def _allow(self, first: _Geoms, second: _Geoms, distance: float) -> None:
        """Let two geoms, or all of two sets, come as near as a distance in m."""
        for one, other in ((first, second), (second, first)):
            self.least[one, other] = np.minimum(self.least[one, other], distance)


@dataclass(frozen=True, eq=False)
class _Rules:
    """What a checker allows, independent of the state of the world.

    Attributes:
        fingers: Addresses of the finger positions of the gripper.
        joint_ids: Ids of the arm's joints in the model, base to tip.
        marks: Fields of the scratch model's collision bits and margins, by name.
        moving: Geoms that move with the arm, including those of held objects.
        tool: Geoms of the tool.
        gripping: Geoms of the tool and of held objects.
        least: Minimum allowed distance of each pair of geoms, of shape (ngeom, ngeom), m.
        boxes: Boxes of different arms that have to keep a distance.
    """

    fingers: list[int]
    joint_ids: npt.NDArray[np.int32]
    marks: dict[str, npt.NDArray[np.generic]]
    moving: Marks
    tool: Marks
    gripping: Marks
    least: Matrix
    boxes: BoxPairs


class _KnownRules:
    """Rules of the checkers of one generation of a world: many checkers have the same ones."""

    def __init__(self, generation: int) -> None:
        self.generation = generation
        self.rules: dict[tuple[object, ...], _Rules] = {}


_known_rules: weakref.WeakKeyDictionary[World, _KnownRules] = weakref.WeakKeyDictionary()


def _rules_of(
    world: World,
    arm: str,
    margin: float | Mapping[str, float],
    ignore: frozenset[str],
    tool_may_touch: bool,
    sharing: Sequence[SharedGrasp] | None,
) -> _Rules:
    """Rules of a checker, arguments as `CollisionChecker`; made once per generation of the world.

    Attachments and consents, on which they depend, begin a new generation when they change.
    """
    known = _known_rules.get(world)
    if known is None or known.generation != world.generation:
        known = _known_rules[world] = _KnownRules(world.generation)
    margins = tuple(margin.items()) if isinstance(margin, Mapping) else margin
    shared = None if sharing is None else tuple(sharing)
    key = arm, margins, ignore, tool_may_touch, shared
    rules = known.rules.get(key)
    if rules is None:
        if sharing is None:
            sharing = world.attachments.shared_grasps(arm)
        rules = known.rules[key] = _new_rules(world, arm, margin, ignore, tool_may_touch, sharing)
    return rules


def _new_rules(
    world: World,
    arm: str,
    margin: float | Mapping[str, float],
    ignore: frozenset[str],
    tool_may_touch: bool,
    sharing: Sequence[SharedGrasp],
) -> _Rules:
    """Rules of a checker, arguments as `CollisionChecker`."""
    body = world.arms[arm]
    gripper = world.grippers.get(arm)
    fingers = FINGERS if gripper is not None and gripper.gripper.fingers else ()
    scratch = ScratchModel(world, (arm,))
    held = geoms_of(world, world.carried_by(arm))
    moving = scratch.marks(body.geom_ids | held)
    ignored = geoms_of(world, ignore & world.objects.keys())
    for name in ignore & set(world.attachments.attached_to(arm)):
        ignored |= world.payload_geoms(name)  # what rides on it would move with the hand
    for name in ignore & world.arms.keys():
        payloads = world.carried_by(name)
        ignored |= world.arms[name].geom_ids | geoms_of(world, payloads)
    checked = scratch.solid & ~scratch.marks(ignored)
    # Pairs with at least one geom that moves: two fixed bodies never need a check. Pairs within
    # the arm count; MuJoCo itself leaves out neighboring links.
    scratch.compare(checked & moving, checked)
    distances = np.full(scratch.model.ngeom, -TOUCH)
    carried = np.zeros(scratch.model.ngeom)  # distance to keep from what other arms hold
    for name, other in world.arms.items():
        if name != arm:
            kept = margin.get(name, 0.0) if isinstance(margin, Mapping) else margin
            marks = scratch.marks(other.geom_ids)
            scratch.report_gaps(marks, kept)
            distances[marks] = kept
            if kept > 0.0:
                marks = scratch.marks(geoms_of(world, world.carried_by(name)) - held)
                scratch.report_gaps(marks, kept)
                carried[marks] = kept
    # The larger value of the two geoms of a pair: a margin wins against the tolerance.
    least: Matrix = np.maximum(distances[:, None], distances)
    # The tolerance is for held objects, which may lie on others; an empty tool touches nothing.
    tool = scratch.marks(body.tool_geom_ids)
    objects = scratch.marks(geoms_of(world, world.objects) - held)
    apart = (tool[:, None] & objects) | (objects[:, None] & tool)
    least[apart] = np.maximum(least[apart], 0.0)
    # As the guard: links and held objects keep away from what other arms hold, and the tool, which
    # may be going to take it, only from contact. What arms share, others may come to as well.
    links = scratch.marks(body.geom_ids - body.tool_geom_ids)
    shared = _shared(world, arm, sharing)
    lent = scratch.marks(set[int]().union(*(world.payload_geoms(obj) for _, obj, _ in shared)))
    apart = links[:, None] | (scratch.marks(held) & ~lent)[:, None] & ~lent
    apart &= carried > 0.0
    keep = np.where(apart, carried, -np.inf)
    for obj, carrier in world.attachments.on_carriers(arm):
        rows = np.ix_(*(list(world.payload_geoms(one)) for one in (obj, carrier)))
        keep[rows] = keep.T[rows] = -np.inf
    least = np.maximum(least, np.maximum(keep, keep.T))
    # A held object touches the tool, and other held objects, by design.
    gripping = scratch.marks(body.tool_geom_ids | held)
    payload = scratch.marks(held)
    least[(payload[:, None] | payload) & gripping[:, None] & gripping] = -np.inf
    for partner, obj, hands_m in shared:
        hands = scratch.marks(world.arms[partner].tool_geom_ids)
        pairs = (hands[:, None] & gripping) | (gripping[:, None] & hands)
        least[pairs] = np.minimum(least[pairs], hands_m)
        if world.object_geom(obj) in held:
            its = scratch.marks(world.payload_geoms(obj))
            least[(hands[:, None] & its) | (its[:, None] & hands)] = -np.inf
    if tool_may_touch:
        outside = ~moving
        least[(gripping[:, None] & outside) | (outside[:, None] & gripping)] = -np.inf
    return _Rules(
        fingers=[int(world.model.joint(f"{arm}/{name}").qposadr[0]) for name in fingers],
        joint_ids=world.model.dof_jntid[body.dof_ids],
        marks={field: getattr(scratch.model, field).copy() for field in _MARKED},
        moving=moving,
        tool=tool,
        gripping=gripping,
        least=least,
        boxes=scratch.box_pairs(least, moving),
    )


def _shared(world: World, arm: str, sharing: Sequence[SharedGrasp]) -> list[tuple[str, str, float]]:
    """Partner, object and minimum distance of the hands, m, where two arms share an object."""
    found = [(one.partner, one.object, one.hands_m) for one in sharing]
    for obj in world.attachments.attached_to(arm):
        others = set(world.attachments.holders(obj)) - {arm}
        found += [(other, obj, np.inf) for other in sorted(others)]
    return [one for one in found if one[0] in world.arms and one[1] in world.objects]


class LinkContacts:
    """Current contacts of an arm's links other than its tool.

    Must be rebuilt after the world is recompiled.

    Args:
        world: World that contains the arm.
        arm: Name of the arm.
    """

    def __init__(self, world: World, arm: str) -> None:
        self._world = world
        body = world.arms[arm]
        self._own = np.zeros(world.model.ngeom, dtype=bool)
        self._own[list(body.geom_ids)] = True
        self._links = self._own.copy()
        self._links[list(body.tool_geom_ids)] = False

    def unwanted(self) -> TouchFailure | None:
        """Failure ``IN_COLLISION`` if a link penetrates something else than this arm, else None."""
        data = self._world.data
        # The common case, no penetration anywhere, returns first.
        if data.ncon == 0 or data.contact.dist.min() >= -TOUCH:
            return None
        geoms = data.contact.geom
        # Exactly one geom of the pair is a link, and the other is not the arm's own tool.
        links = self._links[geoms]
        candidates = np.flatnonzero((links[:, 0] != links[:, 1]) & ~self._own[geoms].all(axis=1))
        for i in candidates.tolist():
            depth = -float(data.contact.dist[i])
            if depth > TOUCH:
                model = self._world.model
                pair = sorted(geoms[i].tolist(), key=lambda geom: not self._links[geom])
                first, second = (name_of_geom(model, geom) for geom in pair)
                return TouchFailure(f"{first} touches {second}", first, second, depth_m=depth)
        return None


class OutsideContacts:
    """Current contacts of an arm and its payload with everything else.

    Reports contact as a switch does, not its force. Must be rebuilt after the world is recompiled.

    Args:
        world: World that contains the arm.
        arm: Name of the arm.
    """

    def __init__(self, world: World, arm: str) -> None:
        self._world = world
        self._arm = arm
        self._own = np.zeros(world.model.ngeom, dtype=bool)
        self._own[list(world.arms[arm].geom_ids)] = True
        for name in world.carried_by(arm):
            self._own[list(world.object_geoms(name))] = True

    def deepest(self) -> tuple[str, str] | None:
        """Names of both bodies of the deepest contact, own one first; None without contact."""
        data = self._world.data
        if not data.ncon:
            return None
        geoms = data.contact.geom
        depths = -data.contact.dist
        own = self._own[geoms]
        outside = np.flatnonzero((own[:, 0] != own[:, 1]) & (depths > 0.0))
        # Deepest first: the first one that is not with the arm's own pedestal counts.
        for i in outside[np.argsort(-depths[outside])].tolist():
            pair = sorted(geoms[i].tolist(), key=lambda geom: not self._own[geom])
            first, second = (name_of_geom(self._world.model, geom) for geom in pair)
            if second.partition("/")[0] != self._arm:  # the arm's pedestal has its name
                return first, second
        return None


def contact_of_links(
    world: World, arm: str, name: str, pose: Pose, rows: Matrix, room: float
) -> Contact | None:
    """First contact of an arm's links, but not its tool, with a free object that stays in place.

    For motions on which the tool may touch the object: plans leave out all of its contacts then.

    Args:
        world: World in its current state; never changed.
        arm: Name of the arm.
        name: Name of the object.
        pose: Its pose in the world.
        rows: Configurations, of shape (n, dof), rad.
        room: Distance to keep, m; less where the first configuration is nearer.
    """
    model = world.model
    body = world.arms[arm]
    bodies = model.geom_bodyid
    solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    own = np.flatnonzero(solid & (model.body_rootid[bodies] == model.body(name).rootid[0]))
    links = np.array([geom for geom in sorted(body.geom_ids - body.tool_geom_ids) if solid[geom]])
    scratch = ScratchModel(world, ())
    data = scratch.data
    address = world.pose_address(name)
    data.qpos[address : address + 7] = (*pose.position, *pose.quaternion)
    sizes = model.geom_rbound[links][:, None] + model.geom_rbound[own] + room
    for index, row in enumerate(rows):
        data.qpos[body.qpos_ids] = row
        mujoco.mj_kinematics(scratch.model, data)
        apart = np.linalg.norm(data.geom_xpos[links][:, None] - data.geom_xpos[own], axis=2)
        nearest: Contact | None = None
        for one, other in np.argwhere(apart < sizes).tolist():
            gap = scratch.apart(int(links[one]), int(own[other]), room)
            if gap < room and (nearest is None or -gap > nearest.depth):
                first = name_of_geom(model, int(links[one]))
                nearest = Contact(first, name, -gap, tuple(row.tolist()))
        if nearest is not None:
            if index > 0 or nearest.depth > 0.0:
                return nearest
            room = -nearest.depth
    return None


def overlap_with_fixed(world: World, name: str, pose: Pose) -> Contact | None:
    """Deepest overlap of a free object, at a pose in the world, with what never moves.

    With what may still move, and with the floor, there is none.

    Args:
        world: World in its current state; never changed.
        name: Name of the object.
        pose: Its pose in the world.
    """
    model = world.model
    bodies = model.geom_bodyid
    solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    own = solid & (model.body_rootid[bodies] == model.body(name).rootid[0])
    fixed = solid & (model.body_weldid[bodies] == 0)
    fixed &= model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE
    scratch = ScratchModel(world, ())
    data = scratch.data
    address = world.pose_address(name)
    data.qpos[address : address + 7] = (*pose.position, *pose.quaternion)
    mujoco.mj_kinematics(scratch.model, data)
    places = data.geom_xpos
    sizes = model.geom_rbound
    deepest: Contact | None = None
    for one, other in itertools.product(*(np.flatnonzero(each).tolist() for each in (own, fixed))):
        if np.linalg.norm(places[one] - places[other]) < sizes[one] + sizes[other]:
            depth = -scratch.apart(one, other, 0.0)
            if depth > TOUCH and (deepest is None or depth > deepest.depth):
                deepest = Contact(name, name_of_geom(model, other), depth)
    return deepest


def geoms_of(world: World, objects: Iterable[str]) -> set[int]:
    """Geoms of some objects that are present."""
    return {geom for name in objects for geom in world.object_geoms(name)}


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
    # No point moves farther than the sum of what each joint moves it (triangle inequality).
    distance = float(np.abs(end - start) @ radii)
    share = np.linspace(0.0, 1.0, max(int(np.ceil(distance / step)), 1) + 1)
    rows: Matrix = start + share[:, None] * (end - start)
    rows[-1] = end
    return rows


def stretched(anchors: Matrix, last: Sequence[int], centers: Matrix, bounds: Vector) -> Vector:
    """Largest distance of any moved point from each joint, of shape (dof,), m.

    The length of the stretched chain from a joint over all later joints to the farthest ball: an
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
    # Tip to base, so that the radius of the next joint is final when it is used.
    for i in range(len(anchors) - 2, -1, -1):
        stretched_out = np.linalg.norm(anchors[i + 1] - anchors[i]) + radii[i + 1]
        radii[i] = max(radii[i], stretched_out)
    return radii


def last_joint(model: mujoco.MjModel, links: Sequence[int], body: int) -> int | None:
    """Index of the last joint of an arm that moves a body; None for the base, which is fixed.

    Args:
        model: Model with the arm in it.
        links: Ids of the bodies that the arm's joints move, base to tip.
        body: Id of a body of the arm, or of an object that it holds: the last joint's.
    """
    # An object that the arm holds is a tree of its own in the model, and moves with the tool.
    if model.body_rootid[body] != model.body_rootid[links[0]]:
        return len(links) - 1
    while body not in links and body != 0:
        body = int(model.body_parentid[body])
    return links.index(body) if body else None
