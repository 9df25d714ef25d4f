"""An arm, and what it holds, wrapped in spheres: quick bounds on how near it is, and gets."""

from __future__ import annotations

from functools import cache
from types import ModuleType

import mujoco
import numpy as np

from bt_dualarm.motion.collision.sweep import last_joint, stretched
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.world import World

_FINER = 2.0  # spheres along a shape's longest edge for each time that it is longer than the next
_MOST = 8  # spheres for one shape


class BoundingSpheres:
    """Spheres around all shapes of one arm; to be made anew after a recompilation.

    Args:
        world: World that the arm is in.
        arm: Name of the arm.

    Attributes:
        span: Largest distance of any point from the first joint, in metres, however the arm stands.
        spans: Largest distance from each joint of any point that it moves, likewise, (dof,).
        ball: Sphere that no point can leave: around the first joint, of shape (1, 4), m.
    """

    def __init__(self, world: World, arm: str) -> None:
        model, body = world.model, world.arms[arm]
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
        self._places, self._frames = data.geom_xpos, data.geom_xmat
        self._anchors, self._axes = data.xanchor, data.xaxis
        self.span, self.spans = self._reach(
            [joint for joint, count in zip(last, repeats, strict=True) for _ in range(count)]
        )
        self.ball = np.array(((*self._anchors[self._joints[0]], self.span),))

    def spheres(self) -> Matrix:
        """Centres and radii now, of shape (n, 4), m."""
        spheres, _ = np.empty_like(self._placed), self._world.sensed  # what it says is up to date
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
        anchors, spheres = self._anchors[self._joints], self.spheres()
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
    from bt_dualarm.motion.collision import sphere_kernels

    return sphere_kernels


def bound_something() -> None:
    """Have all kernels of spheres compiled."""
    spheres, one = np.ones((1, 4)), np.zeros(1, np.int64)
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
    center, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:].copy()
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
