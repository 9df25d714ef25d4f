"""Distances of an arm to other arms and to obstacles, and bounds from spheres around its links.

- `ArmDistance` computes exact distances between arms in any configurations.
- `Clearance` slows down an arm whose links come close to the scene.
- `BoundingSpheres` gives quick bounds of distances and of motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import ModuleType
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.collision.checker import Marks, ScratchModel, last_joint, stretched
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.sim.composition import name_of_geom
from bt_dualarm.sim.world import World

HORIZON = 0.10
"""Default upper limit of computed distances, m."""

# Collision bits: what is to keep away from links and tools, and what from held objects.
_LINKS = 1
_HELD = 2

NEAR_M = 0.02
"""Distance below which an arm that approaches an obstacle moves at half speed, m."""

_NEARER_M = 0.001
"""Minimum decrease of a distance since the motion began that counts as an approach, m: a link that
turns next to its pedestal does not approach it."""

_FINER = 2.0
"""Spheres per ratio of a shape's longest edge to its second longest."""

_MOST = 8
"""Largest number of spheres for one shape."""


@dataclass(frozen=True)
class Gap:
    """Smallest distance between an arm and another one.

    Attributes:
        meters: Distance that counts; infinite beyond the horizon.
        first: Name of the arm's body, or of an object that it holds.
        second: Name of the other arm's body, or of an object that it holds.
        added: What this pair need not keep, and is counted in ``meters``, see `added_distances`, m.
    """

    meters: float = float("inf")
    first: str = ""
    second: str = ""
    added: float = 0.0

    @property
    def true_meters(self) -> float:
        """Distance between the two bodies; infinite beyond the horizon."""
        return self.meters - self.added


_NO_GAP: Final = Gap()


class ArmDistance:
    """Distances of one arm and its payload to the other arms and their payloads.

    Distances between an object and the tools of arms that hold it together, or that have consented
    to that (`Attachments.consent`), do not count; between the hands of these arms, the distance
    that they need not keep is added. Must be rebuilt after the world is recompiled.

    Args:
        world: World whose current state counts; never changed.
        arm: Name of the arm.
        tool_avoids_payloads: Whether distances between its tool and another arm's payload count,
            with `PAYLOAD_APART_M`. They must not if the tool takes something from there, or puts
            something there.
    """

    def __init__(self, world: World, arm: str, *, tool_avoids_payloads: bool = False) -> None:
        self._world = world
        self._scratch = ScratchModel(world, world.arms)
        self._others = [name for name in world.arms if name != arm]
        own = list(world.arms[arm].geom_ids)
        # A pair counts if a type bit of the own geom is among the affinities of the other's: tools
        # that may touch payloads of other arms lack the bit that these answer to.
        types, affinities = np.zeros((2, world.model.ngeom), dtype=np.int32)
        types[own] = _LINKS | _HELD
        if not tool_avoids_payloads:
            types[list(world.arms[arm].tool_geom_ids)] = _LINKS
        self._owner = np.full(world.model.ngeom, -1)  # index of the other arm, -1 for none
        for index, name in enumerate(self._others):
            geoms = list(world.arms[name].geom_ids)
            affinities[geoms] = _LINKS
            self._owner[geoms] = index
        for held in world.attachments:
            geoms = list(world.payload_geoms(held.object))
            if held.arm == arm:
                types[geoms] = _LINKS | _HELD
            else:
                affinities[geoms] = _HELD
                self._owner[geoms] = self._others.index(held.arm)
        self._added = added_distances(world, arm, tool_avoids_payloads=tool_avoids_payloads)
        self._scratch.compare(types, affinities)
        model = self._scratch.model
        self._is_box = is_box = self._scratch.boxes
        # An object that both arms hold has types and affinities.
        is_pair = (types[:, None] & affinities != 0) & (
            model.geom_bodyid[:, None] != model.geom_bodyid
        )
        self._boxes = np.argwhere(is_pair & is_box[:, None] & is_box)
        bounds = model.geom_rbound
        self._box_reach = bounds[self._boxes].sum(axis=1)
        if self._added is not None:
            self._box_reach -= self._added[self._boxes[:, 0], self._boxes[:, 1]]
        self._horizons = dict.fromkeys(self._others, 0.0)

    @property
    def data(self) -> mujoco.MjData:
        """State of the scratch model, in which distances were computed last."""
        return self._scratch.data

    def gap(self, configurations: Mapping[str, Vector], horizon: float = HORIZON) -> Gap:
        """Smallest distance to any other arm; arguments as in `gaps`."""
        gaps = self.gaps(configurations, dict.fromkeys(self._others, horizon))
        return min(gaps.values(), key=lambda gap: gap.meters, default=Gap())

    def gaps(
        self, configurations: Mapping[str, Vector], horizons: Mapping[str, float]
    ) -> dict[str, Gap]:
        """Smallest distance to each of some other arms.

        Args:
            configurations: Configurations by arm, of shape (dof,), rad; arms that are not named
                stay where they are.
            horizons: Upper limit of the distance by other arm, m; a larger one costs more.
        """
        world = self._world
        data = self.data
        # Margins stay in the model from call to call.
        for name, horizon in horizons.items():
            if horizon != self._horizons[name]:
                self._horizons[name] = horizon
                self._scratch.report_gaps(self._owner == self._others.index(name), horizon)
        data.qpos[:] = world.sensed.qpos
        for name, q in configurations.items():
            data.qpos[world.arms[name].qpos_ids] = q
        self._scratch.settle()
        gaps = dict.fromkeys(horizons, _NO_GAP)
        if data.ncon:
            geoms = data.contact.geom
            distances = data.contact.dist
            if self._added is not None:
                distances = distances + self._added[geoms[:, 0], geoms[:, 1]]
            owners = np.maximum(self._owner[geoms[:, 0]], self._owner[geoms[:, 1]])
            for name in horizons:
                gaps[name] = self._nearest(distances, owners == self._others.index(name))
        if len(self._boxes):
            self._measure_boxes(gaps, horizons)
        return gaps

    def _nearest(self, distances: Vector, contacts: Marks) -> Gap:
        """Smallest of the contacts' distances, of shape (ncon,), m, among selected contacts.

        Those of boxes that are apart are left out, see `_measure_boxes`.
        """
        contact = self.data.contact
        boxes_apart = self._is_box[contact.geom].all(axis=1) & (contact.dist > 0.0)
        candidates = np.flatnonzero(contacts & ~boxes_apart)
        if not len(candidates):
            return Gap()
        nearest = int(candidates[distances[candidates].argmin()])
        return self._between(contact.geom[nearest].tolist(), float(contact.dist[nearest]))

    def _measure_boxes(self, gaps: dict[str, Gap], horizons: Mapping[str, float]) -> None:
        """Replace gaps to other arms by those of two boxes, such as fingers, that are nearer.

        Contacts do not tell, see `ScratchModel.apart`.
        """
        least = np.sqrt(self._scratch.squared_between(*self._boxes.T)) - self._box_reach
        if not np.count_nonzero(least < max(horizons.values())):
            return
        owners = self._owner[self._boxes[:, 1]]
        for name, horizon in horizons.items():
            mine = np.flatnonzero((owners == self._others.index(name)) & (least < horizon))
            for pair in mine[np.argsort(least[mine], kind="stable")].tolist():
                nearest = gaps[name].meters
                if least[pair] >= min(nearest, horizon):
                    break
                first, second = self._boxes[pair].tolist()
                added = self._added_between(first, second)
                meters = self._scratch.apart(first, second, horizon - added)
                if meters + added < min(nearest, horizon):
                    gaps[name] = self._between([first, second], meters)

    def _added_between(self, first: int, second: int) -> float:
        """What is added to the distance of two geoms, m."""
        return 0.0 if self._added is None else float(self._added[first, second])

    def _between(self, pair: list[int], meters: float) -> Gap:
        """Gap between two geoms at a distance in m, of which one is the arm's own."""
        added = self._added_between(*pair)
        # The arm's own geoms have owner -1, and sort first.
        pair.sort(key=lambda geom: int(self._owner[geom]))
        first, second = (name_of_geom(self._scratch.model, geom) for geom in pair)
        return Gap(meters + added, first, second, added)


HANDS_APART_M = 0.03
"""Distance that hands keep from each other where they share no object, m: `guard.CLEAR_M`."""


HANDS_M = 0.006
"""Distance that two hands keep from each other while both are at one object, m, and that each of
them keeps from what else the other one holds: other arms keep 0.03 m. Control errors are less than
2 mm."""

PLANNING_MARGIN_M = 0.045
"""Distance that plans keep from other arms, m: more than the guard keeps."""

RESTING_MARGIN_M = 0.034
"""Distance that plans keep from arms whose trees have ended, m: these do not move."""

PAYLOAD_APART_M = 0.002
"""Distance that a tool keeps from what another arm holds, m: planned motions keep no more from
objects."""


def added_distances(world: World, arm: str, *, tool_avoids_payloads: bool) -> Matrix | None:
    """What is added to the distances of pairs of geoms of one arm and others, m.

    It is infinite between an object that arms hold together and the links of these arms: it is a
    part of each of them, and only their plans keep it from these links. It is infinite as well
    between an object that they may hold together and the partner's tool, and what that holds: they
    may touch. Between their tools it is what `HANDS_APART_M` exceeds the distance that they keep,
    and between each tool and what else the other arm holds what it exceeds `HANDS_M`: a peg ends
    near the fingers that hold the part with its hole.
    It is infinite as well between an object and what it was taken from, or is placed on, a tray in
    another arm's hand. Between the arm's tool and the payloads of others it is what
    `HANDS_APART_M` exceeds `PAYLOAD_APART_M`.

    Args:
        world: World whose current state counts.
        arm: Name of the arm.
        tool_avoids_payloads: As for `ArmDistance`.

    Returns:
        Symmetric matrix, of shape (ngeom, ngeom); None if nothing is added.
    """
    attachments = world.attachments
    shared = {(one.partner, one.object): one.hands_m for one in attachments.shared_grasps(arm)}
    own = list(world.arms[arm].tool_geom_ids)
    pairs: list[tuple[list[int], list[int], float]] = []
    for obj in attachments.attached_to(arm):
        for other in attachments.holders(obj):
            if other != arm:  # whatever they have consented to, it is in both hands
                shared.setdefault((other, obj), HANDS_APART_M)
                links = [*world.arms[arm].geom_ids, *world.arms[other].geom_ids]
                pairs.append((list(world.payload_geoms(obj)), links, np.inf))
    for (partner, obj), hands_m in shared.items():
        if partner not in world.arms or obj not in world.objects:
            continue
        its = list(world.arms[partner].tool_geom_ids)
        geoms = list(world.payload_geoms(obj))
        ours, theirs = (
            [geom for one in attachments.attached_to(holder) for geom in world.payload_geoms(one)]
            for holder in (arm, partner)
        )
        pairs += [
            (own, its, HANDS_APART_M - hands_m),
            (geoms, its, np.inf),
            (geoms, own, np.inf),
            (geoms, geoms, np.inf),  # what rides on the object
            (geoms, ours + theirs, np.inf),
            (ours, its, HANDS_APART_M - HANDS_M),
            (theirs, own, HANDS_APART_M - HANDS_M),
        ]
    for obj, carrier in attachments.on_carriers(arm):
        pairs.append((list(world.payload_geoms(obj)), list(world.payload_geoms(carrier)), np.inf))
    if tool_avoids_payloads:
        more = HANDS_APART_M - PAYLOAD_APART_M
        pairs += [
            (own, list(world.payload_geoms(held.object)), more)
            for held in attachments
            if held.arm != arm
        ]
    if not pairs:
        return None
    added = np.zeros((world.model.ngeom, world.model.ngeom))
    for first, second, more in pairs:
        rows = np.ix_(first, second)
        added[rows] = np.maximum(added[rows], more)
        added[np.ix_(second, first)] = added[rows].T
    return added


class Clearance:
    """Distances of an arm's links to the scene and to objects.

    Tool and held objects do not count: they are meant to touch objects. Neither do other arms,
    which `FailSafeCheck` keeps apart. Must be rebuilt after the world is recompiled.

    Args:
        world: World that contains the arm.
        arm: Name of the arm.

    Attributes:
        nearest: Last computed smallest distance, m; infinite above ``NEAR_M``.
    """

    def __init__(self, world: World, arm: str) -> None:
        self.nearest = float("inf")
        self._world = world
        self._scratch = scratch = ScratchModel(world)
        self._begun: dict[tuple[int, int], float] = {}
        body = world.arms[arm]
        arms = set[int]().union(
            *(world.payload_geoms(attached.object) for attached in world.attachments),
            *(other.geom_ids for other in world.arms.values()),
        )
        others = scratch.solid & ~scratch.marks(arms)
        scratch.compare(scratch.marks(body.geom_ids - body.tool_geom_ids), others)
        scratch.report_gaps(others, NEAR_M)

    def begin(self) -> None:
        """Record the distances at the beginning of a motion."""
        self._begun = self._gaps()

    @property
    def time_scale(self) -> tuple[float, str]:
        """Time scale for the arm in the world's current state, and the reason if it is below 1."""
        gaps = self._gaps()
        self.nearest = min(gaps.values(), default=float("inf"))
        for pair, gap in gaps.items():
            if gap < self._begun.get(pair, np.inf) - _NEARER_M:
                first, second = (name_of_geom(self._scratch.model, geom) for geom in pair)
                return 0.5, f"{first} is {1e3 * max(gap, 0.0):.0f} mm from {second}"
        return 1.0, ""

    def _gaps(self) -> dict[tuple[int, int], float]:
        """Distances in m of the pairs of a link and another geom that are near."""
        # The contacts of this state have no other reader: they may be overwritten without a copy.
        data = self._world.sensed
        mujoco.mj_collision(self._scratch.model, data)
        gaps: dict[tuple[int, int], float] = {}
        if data.ncon:
            for pair, gap in zip(data.contact.geom.tolist(), data.contact.dist, strict=True):
                key = (pair[0], pair[1])  # a pair may have several contacts
                gaps[key] = min(gaps.get(key, np.inf), float(gap))
        return gaps


class BoundingSpheres:
    """Spheres around all geoms of one arm and its payload.

    Must be rebuilt after the world is recompiled.

    Args:
        world: World that contains the arm.
        arm: Name of the arm.

    Attributes:
        span: Largest distance of any point from the first joint in any configuration, m.
        spans: Largest distance from each joint of any point that it moves in any configuration, of
            shape (dof,), m.
        ball: Sphere around the first joint that contains the arm in any configuration: center and
            radius, of shape (1, 4), m.
    """

    def __init__(self, world: World, arm: str) -> None:
        model = world.model
        body = world.arms[arm]
        held = [geom for name in world.carried_by(arm) for geom in world.object_geoms(name)]
        self._world = world
        self._shapes = np.array(sorted((*body.geom_ids, *held)))
        self._bounds = model.geom_rbound[self._shapes]
        self._joints = model.dof_jntid[body.dof_ids].astype(np.int64)
        links = model.jnt_bodyid[self._joints].tolist()
        bodies = model.geom_bodyid[self._shapes].tolist()
        last = [last_joint(model, links, body) for body in bodies]  # None: fixed to the base
        # 1 where a joint moves a shape, 0 elsewhere: a factor in the kernels.
        counts = np.array([0 if joint is None else joint + 1 for joint in last])
        self._turned = (np.arange(len(links)) < counts[:, None]).astype(np.float64)
        pieces = [_spheres_of_geom(model, geom) for geom in self._shapes]
        repeats = [len(piece) for piece in pieces]
        self._geoms = np.repeat(self._shapes, repeats).astype(np.int64)
        self._moved = np.repeat(self._turned, repeats, axis=0)
        self._local = np.vstack(pieces)
        self._slides = np.repeat([_slide_range(model, body) for body in bodies], repeats)
        data = world.sensed
        # Views: to look up a field costs as much as a product of matrices.
        self._positions = data.geom_xpos
        self._frames = data.geom_xmat
        self._anchors = data.xanchor
        self._axes = data.xaxis
        self.span, self.spans = self._reach(
            [joint for joint, count in zip(last, repeats, strict=True) for _ in range(count)]
        )
        self.ball = np.array(((*self._anchors[self._joints[0]], self.span),))

    def spheres(self) -> Matrix:
        """Current centers and radii in the world, of shape (n, 4), m."""
        spheres = np.empty_like(self._local)
        _ = self._world.sensed  # brings the views up to date
        kernels().place(self._local, self._geoms, self._positions, self._frames, spheres)
        return spheres

    def levers(self, spheres: Matrix) -> Matrix:
        """Largest distance of each sphere's points from each joint's axis, of shape (n, dof), m.

        Zero if the joint does not move the sphere.

        Args:
            spheres: Current spheres, as from `spheres`.
        """
        levers = np.empty_like(self._moved)
        kernels().lever(spheres, self._joints, self._anchors, self._axes, self._moved, levers)
        return levers

    def reach(self, levers: Matrix, turns: Vector) -> float:
        """Upper bound of any point's displacement for bounded turns of the joints, m.

        Args:
            levers: Current levers, as from `levers`, of shape (n, dof), m.
            turns: Largest turn of each joint, of shape (dof,), rad.
        """
        return float(kernels().reach(levers, np.ascontiguousarray(turns), self.span))

    def centers(self, data: mujoco.MjData) -> Matrix:
        """Centers of the geoms in a state of the model, of shape (m, 3), m."""
        centers: Matrix = data.geom_xpos[self._shapes]
        return centers

    def moved(self, first: Matrix, second: Matrix, turn: Vector) -> float:
        """Upper bound of any point's displacement between two states, m.

        Args:
            first: ``centers`` in the first state.
            second: ``centers`` in the second state.
            turn: Turn of each joint, of shape (dof,), rad.
        """
        return float(kernels().moved(first, second, self._bounds, self._turned, turn))

    def _reach(self, last: list[int | None]) -> tuple[float, Vector]:
        """`span` and `spans`, from the last joint that moves each sphere; None for the base."""
        anchors = self._anchors[self._joints]
        spheres = self.spheres()
        spheres[:, 3] += self._slides  # a finger may be anywhere in its range
        moved = np.array([joint is not None for joint in last])
        joints = [joint for joint in last if joint is not None]
        spans = stretched(anchors, joints, spheres[moved, :3], spheres[moved, 3])
        base = spheres[~moved]
        around = np.linalg.norm(base[:, :3] - anchors[0], axis=1) + base[:, 3]
        return max(float(spans[0]), float(around.max(initial=0.0))), spans


def apart(first: Matrix, second: Matrix) -> float:
    """Smallest distance between two sets of spheres, of shape (n, 4) and (m, 4), m."""
    return float(kernels().sphere_distance(first, second))


@cache
def kernels() -> ModuleType:
    """Module of the kernels; cached, since an import statement takes as long as a kernel."""
    from bt_dualarm.collision import distance_kernels

    return distance_kernels


def warm_up_spheres() -> None:
    """Compile all kernels of bounding spheres."""
    spheres = np.ones((1, 4))
    one = np.zeros(1, np.int64)
    kernels().place(spheres, one, np.ones((1, 3)), np.ones((1, 9)), spheres)
    kernels().lever(
        spheres, one, np.ones((1, 3)), np.ones((1, 3)), np.ones((1, 1)), np.ones((1, 1))
    )
    kernels().farthest(np.ones((1, 1)), np.ones(1))
    kernels().reach(np.ones((1, 1)), np.ones(1), 1.0)
    kernels().sphere_distance(spheres, spheres)
    places = np.ones((1, 3))
    kernels().moved(places, places, np.ones(1), np.ones((1, 1)), np.ones(1))


def _spheres_of_geom(model: mujoco.MjModel, geom: int) -> Matrix:
    """Spheres around a geom's bounding box, in its frame, of shape (n, 4), m."""
    center = model.geom_aabb[geom, :3]
    half = model.geom_aabb[geom, 3:].copy()
    longest = int(np.argmax(half))
    slender = half[longest] / max(float(np.sort(half)[1]), 1e-6)
    count = min(int(np.ceil(_FINER * slender)), _MOST) if slender > 1.2 else 1
    # Equal boxes along the longest edge, each inside its circumscribed sphere.
    half[longest] /= count
    spheres = np.empty((count, 4))
    spheres[:, :3] = center
    spheres[:, longest] += half[longest] * (2.0 * np.arange(count) + 1.0 - count)
    spheres[:, 3] = np.linalg.norm(half)
    return spheres


def _slide_range(model: mujoco.MjModel, body: int) -> float:
    """Range of a body's own prismatic joint, m: that of a finger from closed to open; else 0."""
    joint = int(model.body_jntadr[body])
    if joint < 0 or model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_SLIDE:
        return 0.0
    return float(np.ptp(model.jnt_range[joint]))
