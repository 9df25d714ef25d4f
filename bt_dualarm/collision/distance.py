"""How near an arm comes to others and to obstacles, with bounds from spheres around its links."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import ModuleType

import mujoco
import numpy as np

from bt_dualarm.collision.checker import Marks, ScratchModel, last_joint, stretched
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.sim.composition import name_of_geom
from bt_dualarm.sim.world import World

# An arm, and what it holds, wrapped in spheres: quick bounds on how near it is, and gets.


_FINER = 2.0  # spheres along a shape's longest edge for each time that it is longer than the next
_MOST = 8  # spheres for one shape


class BoundingSpheres:
    """Spheres around all shapes of one arm; to be made anew after a recompilation.

    Args:
        world: World that the arm is in.
        arm: Name of the arm.

    Attributes:
        span: Largest distance of any point from the first joint, in meters, however the arm stands.
        spans: Largest distance from each joint of any point that it moves, likewise, (dof,).
        ball: Sphere that no point can leave: around the first joint, of shape (1, 4), m.
    """

    def __init__(self, world: World, arm: str) -> None:
        model = world.model
        body = world.arms[arm]
        held = [world.object_geom(name) for name in world.attachments.attached_to(arm)]
        self._world = world
        self._shapes = np.array(sorted((*body.geom_ids, *held)))
        self._bounds = model.geom_rbound[self._shapes]
        self._joints = model.dof_jntid[body.dof_ids].astype(np.int64)
        links = model.jnt_bodyid[self._joints].tolist()
        bodies = model.geom_bodyid[self._shapes].tolist()
        last = [last_joint(model, links, body) for body in bodies]
        self._turned = np.array([_turning(joint, len(links)) for joint in last])
        pieces = [_spheres(model, geom) for geom in self._shapes]
        repeats = [len(piece) for piece in pieces]
        self._of_sphere = np.repeat(self._shapes, repeats).astype(np.int64)
        self._moved = np.repeat(self._turned, repeats, axis=0)
        self._placed = np.vstack(pieces)
        self._slides = np.repeat([_way_of_its_own(model, body) for body in bodies], repeats)
        data = world.sensed
        # Views: looking a field up costs as much as a product of matrices.
        self._places = data.geom_xpos
        self._frames = data.geom_xmat
        self._anchors = data.xanchor
        self._axes = data.xaxis
        self.span, self.spans = self._reach(
            [joint for joint, count in zip(last, repeats, strict=True) for _ in range(count)]
        )
        self.ball = np.array(((*self._anchors[self._joints[0]], self.span),))

    def spheres(self) -> Matrix:
        """Centers and radii now, of shape (n, 4), m."""
        # what it says is up to date
        spheres = np.empty_like(self._placed)
        _ = self._world.sensed
        kernels().place(self._placed, self._of_sphere, self._places, self._frames, spheres)
        return spheres

    def levers(self, spheres: Matrix) -> Matrix:
        """Farthest distance of a sphere's points from each joint's axis, of shape (n, dof), m.

        Zero where the joint does not move it.
        """
        levers = np.empty_like(self._moved)
        kernels().lever(spheres, self._joints, self._anchors, self._axes, self._moved, levers)
        return levers

    def reach(self, levers: Matrix, way: Vector) -> float:
        """How far any point gets, in m, when the joints turn by no more than ``way``.

        Args:
            levers: Distances of the spheres as they are now, of shape (n, dof), m.
            way: Most that each joint turns, of shape (dof,), rad.
        """
        return float(kernels().reach(levers, np.ascontiguousarray(way), self.span))

    def centers(self, data: mujoco.MjData) -> Matrix:
        """Of the shapes, of shape (m, 3), in a state of the model."""
        centers: Matrix = data.geom_xpos[self._shapes]
        return centers

    def moved(self, first: Matrix, second: Matrix, turn: Vector) -> float:
        """How far any point has moved at most, in m, on a short way.

        Args:
            first: ``centers`` before it.
            second: ``centers`` after it.
            turn: Turn of each joint, of shape (dof,), rad.
        """
        return float(kernels().moved(first, second, self._bounds, self._turned, turn))

    def _reach(self, last: list[int | None]) -> tuple[float, Vector]:
        """Span and spans, from the last joint that moves each sphere, None for the base's."""
        anchors = self._anchors[self._joints]
        spheres = self.spheres()
        spheres[:, 3] += self._slides
        moved = np.array([joint is not None for joint in last])
        joints = [joint for joint in last if joint is not None]
        spans = stretched(anchors, joints, spheres[moved, :3], spheres[moved, 3])
        base = spheres[~moved]
        around = np.linalg.norm(base[:, :3] - anchors[0], axis=1) + base[:, 3]
        return max(float(spans[0]), float(around.max(initial=0.0))), spans


def apart(first: Matrix, second: Matrix) -> float:
    """The least distance in m of two sets of spheres, of shape (n, 4) and (m, 4)."""
    return float(kernels().nearest(first, second))


@cache
def kernels() -> ModuleType:
    """The kernels: an import statement costs as much as they do."""
    from bt_dualarm.collision import sphere_kernels

    return sphere_kernels


def warm_up_spheres() -> None:
    """Have all kernels of spheres compiled."""
    spheres = np.ones((1, 4))
    one = np.zeros(1, np.int64)
    kernels().place(spheres, one, np.ones((1, 3)), np.ones((1, 9)), spheres)
    kernels().lever(
        spheres, one, np.ones((1, 3)), np.ones((1, 3)), np.ones((1, 1)), np.ones((1, 1))
    )
    kernels().farthest(np.ones((1, 1)), np.ones(1))
    kernels().reach(np.ones((1, 1)), np.ones(1), 1.0)
    kernels().nearest(spheres, spheres)
    places = np.ones((1, 3))
    kernels().moved(places, places, np.ones(1), np.ones((1, 1)), np.ones(1))


def _spheres(model: mujoco.MjModel, geom: int) -> Matrix:
    """Around a shape's box, in its frame, of shape (n, 4)."""
    center = model.geom_aabb[geom, :3]
    half = model.geom_aabb[geom, 3:].copy()
    longest = int(np.argmax(half))
    slender = half[longest] / max(float(np.sort(half)[1]), 1e-6)
    count = min(int(np.ceil(_FINER * slender)), _MOST) if slender > 1.2 else 1
    half[longest] /= count
    spheres = np.empty((count, 4))
    spheres[:, :3] = center
    spheres[:, longest] += half[longest] * (2.0 * np.arange(count) + 1.0 - count)
    spheres[:, 3] = np.linalg.norm(half)
    return spheres


def _way_of_its_own(model: mujoco.MjModel, body: int) -> float:
    """How far a body slides in what carries it, in m: a finger from closed to open."""
    joint = int(model.body_jntadr[body])
    if joint < 0 or model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_SLIDE:
        return 0.0
    return float(np.ptp(model.jnt_range[joint]))


def _turning(last: int | None, dof: int) -> list[float]:
    """For each joint whether it moves a shape whose last joint is given, 1 or 0."""
    count = 0 if last is None else last + 1
    return [1.0] * count + [0.0] * (dof - count)


# How far an arm is from other arms, now or in configurations that they may come to.


HORIZON = 0.10
"""Farthest distance in meters that is measured unless asked for: beyond it, nothing is near."""

# bits: what may not come near a link, and what may not come near a thing held
_LINKS = 1
_HELD = 2


@dataclass(frozen=True)
class Gap:
    """The smallest distance found.

    Attributes:
        meters: Distance; infinite beyond the horizon.
        first: Name of the arm's body, or of what it holds.
        second: Name of the other arm's.
    """

    meters: float = float("inf")
    first: str = ""
    second: str = ""


class ArmDistance:
    """Distances of one arm, and what it holds, to the other arms and what they hold.

    Its tool may come near what another arm holds: that is how things are handed over.

    Args:
        world: World to look at when a distance is asked for; to be made anew after a
            recompilation.
        arm: Name of the arm.
    """

    def __init__(self, world: World, arm: str) -> None:
        self._world = world
        self._scratch = ScratchModel(world, world.arms)
        self._others = [name for name in world.arms if name != arm]
        own = list(world.arms[arm].geom_ids)
        asking, answering = np.zeros((2, world.model.ngeom), dtype=np.int32)
        asking[own] = _LINKS | _HELD
        asking[list(world.arms[arm].tool_geom_ids)] = _LINKS
        self._owner = np.full(world.model.ngeom, -1)  # index of the other arm, -1 for none
        for index, name in enumerate(self._others):
            geoms = list(world.arms[name].geom_ids)
            answering[geoms] = _LINKS
            self._owner[geoms] = index
        for held in world.attachments:
            geom = world.object_geom(held.object)
            if held.arm == arm:
                asking[geom] = _LINKS | _HELD
            else:
                answering[geom] = _HELD
                self._owner[geom] = self._others.index(held.arm)
        self._scratch.compare(asking, answering)
        self._horizons = dict.fromkeys(self._others, 0.0)

    @property
    def data(self) -> mujoco.MjData:
        """State of the world's model in which a gap was measured last."""
        return self._scratch.data

    def gap(self, configurations: Mapping[str, Vector], horizon: float = HORIZON) -> Gap:
        """The smallest distance to any other arm; arguments as in `gaps`."""
        gaps = self.gaps(configurations, dict.fromkeys(self._others, horizon))
        return min(gaps.values(), key=lambda gap: gap.meters, default=Gap())

    def gaps(
        self, configurations: Mapping[str, Vector], horizons: Mapping[str, float]
    ) -> dict[str, Gap]:
        """The smallest distance to each of some other arms.

        Args:
            configurations: Configurations by arm, of shape (dof,), rad; arms that are not named
                are where they are now.
            horizons: Farthest distance in meters that is measured, by other arm; farther ones cost
                more.
        """
        world = self._world
        data = self.data
        self._look_as_far_as(horizons)
        data.qpos[:] = world.sensed.qpos
        for name, q in configurations.items():
            data.qpos[world.arms[name].qpos_ids] = q
        self._scratch.settle()
        if data.ncon == 0:
            return dict.fromkeys(horizons, Gap())
        owners = self._owner[data.contact.geom].max(axis=1)
        return {name: self._nearest(owners == self._others.index(name)) for name in horizons}

    def _nearest(self, contacts: Marks) -> Gap:
        """The smallest distance among some of the contacts that MuJoCo reports."""
        candidates = np.flatnonzero(contacts)
        if not len(candidates):
            return Gap()
        contact = self.data.contact
        nearest = int(candidates[contact.dist[candidates].argmin()])
        pair = sorted(contact.geom[nearest].tolist(), key=lambda geom: int(self._owner[geom]))
        first, second = (name_of_geom(self._scratch.model, geom) for geom in pair)
        return Gap(float(contact.dist[nearest]), first, second)

    def _look_as_far_as(self, horizons: Mapping[str, float]) -> None:
        for name, horizon in horizons.items():
            if horizon != self._horizons[name]:
                self._horizons[name] = horizon
                self._scratch.report_gaps(self._owner == self._others.index(name), horizon)


# How near an arm's links come to things that are not meant to be touched.


NEAR_M = 0.02
"""Distance in meters below which an arm that comes nearer goes at half speed."""

_NEARER_M = 0.001  # than when the motion began: what turns beside its pedestal comes no nearer


class Clearance:
    """Distances of an arm's links to the scene and to objects; made anew after a recompilation.

    Tool and held objects are left out: they are there to touch things. So are the other arms, from
    which `FailSafeCheck` keeps clear.

    Args:
        world: World that the arm is in.
        arm: Name of the arm.

    Attributes:
        nearest: Smallest distance in m when it was looked at last, infinite above ``NEAR_M``.
    """

    def __init__(self, world: World, arm: str) -> None:
        self.nearest = float("inf")
        self._world = world
        self._scratch = scratch = ScratchModel(world)
        self._begun: dict[tuple[int, int], float] = {}
        body = world.arms[arm]
        held = {world.object_geom(one.object) for one in world.attachments}
        of_arms = held.union(*(other.geom_ids for other in world.arms.values()))
        others = scratch.solid & ~scratch.marks(of_arms)
        scratch.compare(scratch.marks(body.geom_ids - body.tool_geom_ids), others)
        scratch.report_gaps(others, NEAR_M)

    def begin(self) -> None:
        """Remember what is near at the beginning of a motion."""
        self._begun = self._gaps()

    @property
    def time_scale(self) -> tuple[float, str]:
        """That the arm should have, and why, if that is less than 1; looks at the world."""
        gaps = self._gaps()
        self.nearest = min(gaps.values(), default=float("inf"))
        for pair, gap in gaps.items():
            if gap < self._begun.get(pair, np.inf) - _NEARER_M:
                first, second = (name_of_geom(self._scratch.model, geom) for geom in pair)
                return 0.5, f"{first} is {1e3 * max(gap, 0.0):.0f} mm from {second}"
        return 1.0, ""

    def _gaps(self) -> dict[tuple[int, int], float]:
        """Of the pairs of a link and another thing that are near, in meters."""
        data = self._world.sensed  # of which nobody else wants contacts, so that no copy is needed
        mujoco.mj_collision(self._scratch.model, data)
        gaps: dict[tuple[int, int], float] = {}
        if data.ncon:
            for pair, gap in zip(data.contact.geom.tolist(), data.contact.dist, strict=True):
                key = (pair[0], pair[1])
                gaps[key] = min(gaps.get(key, np.inf), float(gap))
        return gaps
