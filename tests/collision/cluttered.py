"""Arms of the catalog among objects of all shapes, and path searches among them.

As a program, it writes the pickled paths for the given seeds to standard output.
"""

from __future__ import annotations

import pickle
import sys
from typing import Any

import numpy as np

from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.collision.kernel_arrays import ConvexShapes, Joints, Pairs, SweptArm
from bt_dualarm.collision.swept import CompiledEdges
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.planning.path_search import CompiledRRTConnect
from bt_dualarm.robots.robot import JointLimits
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.values import PoseSpec
from tests.sim.worlds import arm, file_of

SHAPES: dict[str, tuple[Any, tuple[float, ...]]] = {
    "box": ("box", (0.1, 0.05, 0.4)),
    "plate": ("box", (0.01, 0.3, 0.3)),
    "can": ("cylinder", (0.06, 0.3)),
    "ball": ("sphere", (0.1,)),
}


RADII = np.full(2, 1.02)


def cluttered(robot: str, seed: int) -> World:
    """An arm, another one beside it, and objects around it."""
    rng = np.random.default_rng(seed)
    objects = {}
    for name, (shape, size) in SHAPES.items():
        place = rng.uniform((-0.6, -0.6, 0.2), (0.6, 0.6, 0.9))
        turn = rng.uniform(0.0, 360.0, 3)
        pose = PoseSpec(xyz=tuple(place.tolist()), rpy=tuple(turn.tolist()))
        objects[name] = ObjectSpec(shape=shape, size=size, mass=1.0, fixed=True, pose=pose)
    return World(file_of({"arm1": arm(robot), "arm2": arm("ur3", (0.9, 0.0, 0.4))}, objects))


def checker_in(robot: str, seed: int, margin: float = 0.045) -> CollisionChecker:
    """Collision checker of the first arm."""
    return CollisionChecker(cluttered(robot, seed), "arm1", margin)


def anywhere(world_limits: JointLimits, rng: np.random.Generator) -> Vector:
    """A random configuration within the limits and half a turn of each joint, rad."""
    lower = np.maximum(world_limits.lower, -np.pi)
    drawn: Vector = rng.uniform(lower, np.minimum(world_limits.upper, np.pi))
    return drawn


def small_search(seed: int) -> tuple[CompiledRRTConnect, CompiledEdges]:
    """Search for a rod that turns about two axes among three balls, small enough for Python."""
    rng = np.random.default_rng(seed)
    joints = Joints(np.zeros(2), np.zeros((2, 3)), np.array(((0.0, 0.0, 1.0), (0.0, 1.0, 0.0))))
    corners = np.array(((1.0, 0.0, 0.0), (0.2, 0.0, 0.0), (0.6, 0.1, 0.0), (0.6, 0.0, 0.1)))
    turns = np.array((1.2, 2.4, 4.2))[:, None] + rng.uniform(-0.2, 0.2, (3, 1))
    balls = 0.8 * np.hstack((np.cos(turns), np.sin(turns), rng.uniform(-0.3, 0.3, (3, 1))))
    places = np.vstack((corners, balls))
    shapes = ConvexShapes(
        corners=places,
        ranges=np.array(((0, 4, 2), (4, 5, 0), (5, 6, 0), (6, 7, 0))),
        radii=np.array((0.02, 0.2, 0.2, 0.2)),
        centers=np.vstack(((0.6, 0.0, 0.0), balls)),
        bounds=np.array((0.45, 0.2, 0.2, 0.2)),
        rotations=np.tile(np.eye(3), (4, 1, 1)),
        half_extents=np.array(((0.42, 0.12, 0.12), (0.2,) * 3, (0.2,) * 3, (0.2,) * 3)),
        normals=np.zeros((4, 3)),
        reaches=np.array(((1.02, 1.02), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0))),
    )
    apart = shapes.centers[0] - shapes.centers[1:]
    pairs = Pairs(np.zeros(3, np.int64), np.arange(1, 4), np.full(3, 0.01), apart)
    far = np.array((3.1, 1.2))
    limits = JointLimits(-far, far, *np.ones((4, 2)))
    edges = CompiledEdges(SweptArm(joints, shapes, pairs, 2.5e-3))
    start = np.array((0.3, 0.0))
    goal = np.array((-2.8, 0.1))
    return CompiledRRTConnect(edges, start, (goal,), limits, RADII, seed), edges


def found(seed: int) -> tuple[Matrix, int]:
    """Path of the small search, and the number of configurations that it checked."""
    search, edges = small_search(seed)
    path = search.path(2_000, lambda: False)
    assert path is not None
    assert edges.is_dense_path_free(path[[0, *np.repeat(np.arange(1, len(path)), 2)]], RADII)
    return path, edges.checked


if __name__ == "__main__":
    sys.stdout.buffer.write(pickle.dumps([found(int(seed)) for seed in sys.argv[1:]]))
