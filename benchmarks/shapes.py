"""Accuracy of the collision shapes of meshes: python -m benchmarks.shapes [--count N].

Each arm of the catalog is checked for self-collision in random configurations. The reference is
coal, which comes with PlaCo: triangles against triangles of the URDF's own meshes. A false alarm is
a free configuration that is refused; a miss is one in contact that is not refused, because a mesh
may protrude from its hulls by 2 mm. Also prints the number of convex parts of the meshes, their
volume relative to that of one hull per mesh, and the CPU time of a check near home and anywhere.
"""

from __future__ import annotations

import argparse
import itertools
import time
from pathlib import Path

import coal
import numpy as np
from scipy.spatial import ConvexHull

from benchmarks.measured_robots import MEASURED
from bt_dualarm.collision.checker import TOUCH, CollisionChecker
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.robots.meshes import as_stl, mesh_shapes, stl_triangles
from bt_dualarm.robots.robot import Robot
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ArmSpec, TreeFile, WorldSpec
from bt_dualarm.spec.node_types import NodeSpec
from bt_dualarm.spec.values import PoseSpec

COUNT = 2000
NEAR_RAD = 0.25
"""Standard deviation of the joint positions near home."""


def world_of(robot: str) -> World:
    """A world with one arm on the ground."""
    idle = NodeSpec(kind="succeed", name="succeed", ports={})
    arm = ArmSpec(robot=robot, base=PoseSpec(xyz=(0.0, 0.0, 0.0)), tree=idle)
    file = TreeFile(name="shapes", world=WorldSpec(scene="empty"), objects={}, arms={"arm1": arm})
    return World(file)


def exact(triangles: Matrix) -> coal.CollisionGeometry:
    """The exact mesh of triangles of shape (n, 3, 3), not its hull."""
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(triangles), 3 * len(triangles))
    for corners in triangles:
        model.addTriangle(*corners)
    model.endModel()
    return model


class Judge:
    """Whether the meshes of an arm touch one another.

    Args:
        world: World of the arm.
    """

    def __init__(self, world: World) -> None:
        model = world.model
        robot = world.robots["arm1"]
        excluded = {(int(pair) >> 16, int(pair) & 0xFFFF) for pair in model.exclude_signature}
        excluded |= {(second, first) for first, second in excluded}
        self._meshes = {
            int(model.body(f"arm1/{link}").id): meshes
            for link in robot.model.links
            if (meshes := _meshes(robot, link))
        }
        self._pairs = [
            (first, second)
            for first, second in itertools.combinations(self._meshes, 2)
            if (first, second) not in excluded
            and first not in (second, model.body_parentid[second])
            and second != model.body_parentid[first]
            and model.body_weldid[first] != model.body_weldid[second]
        ]

    def free(self, checker: CollisionChecker) -> bool:
        """Whether the arm is free of self-contact in the configuration of the checker."""
        data = checker.data
        poses = {
            body: coal.Transform3s(data.xmat[body].reshape(3, 3), data.xpos[body])
            for body in self._meshes
        }
        request = coal.CollisionRequest()
        return not any(
            coal.collide(one, poses[first], other, poses[second], request, coal.CollisionResult())
            for first, second in self._pairs
            for one in self._meshes[first]
            for other in self._meshes[second]
        )


def _meshes(robot: Robot, link: str) -> list[coal.CollisionGeometry]:
    return [
        exact(shape.pose.apply(_corners(shape.mesh, shape.size)).reshape(-1, 3, 3))
        for shape in robot.model.shapes(link, "collision")
        if shape.mesh is not None
    ]


def _corners(mesh: Path, scale: tuple[float, ...]) -> Matrix:
    corners: Matrix = (stl_triangles(as_stl(mesh)) * np.asarray(scale)).reshape(-1, 3)
    return corners


def parts_of(robot: Robot) -> tuple[int, int, float]:
    """Numbers of meshes and parts, and the volume of the parts relative to that of the outlines."""
    shapes = [
        mesh_shapes(shape.mesh, shape.size)
        for link in robot.model.links
        for shape in robot.model.shapes(link, "collision")
        if shape.mesh is not None
    ]
    parts = [part for one in shapes for part in one.parts]
    inside = sum(float(ConvexHull(part.vertices).volume) for part in parts)
    whole = sum(float(ConvexHull(one.outline.vertices).volume) for one in shapes)
    return len(shapes), len(parts), inside / whole


def touches_itself(checker: CollisionChecker, q: Vector) -> bool:
    """Whether links overlap by more than the tolerance; the ground does not count."""
    checker.place(q)
    found = checker.data.contact
    own = checker.moving[found.geom].all(axis=1) if len(found.geom) else np.zeros(0, bool)
    return bool((own & (found.dist < -TOUCH)).any())


def main() -> None:
    """Print a line for each robot."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=COUNT, help="configurations for each robot")
    count = parser.parse_args().count
    for name in MEASURED:
        world = world_of(name)
        robot = world.robots["arm1"]
        rng = np.random.default_rng(0)
        lower = np.maximum(robot.limits.lower, -np.pi)
        upper = np.minimum(robot.limits.upper, np.pi)
        anywhere = rng.uniform(lower, upper, (count, robot.dof))
        near = np.clip(world.arms["arm1"].q + rng.normal(0, NEAR_RAD, anywhere.shape), lower, upper)
        checker = CollisionChecker(world, "arm1")
        judge = Judge(world)
        ours, true = np.zeros((2, count), dtype=bool)
        for row, q in enumerate(anywhere):
            ours[row] = not touches_itself(checker, q)
            true[row] = judge.free(checker)
        costs = []
        for rows in (near, anywhere):
            start = time.process_time()
            for q in rows:
                checker.free(q)
            costs.append(1e6 * (time.process_time() - start) / count)
        meshes, parts, volume = parts_of(robot)
        print(
            f"{name:6} {meshes} meshes, {parts:2} parts of {volume:.2f} of the volume; "
            f"free {true.mean():.3f}, false alarms {(true & ~ours).sum() / true.sum():.4f}, "
            f"missed {(ours & ~true).sum()} of {(~true).sum()}; "
            f"a check {costs[0]:.1f} us near home, {costs[1]:.1f} anywhere"
        )


if __name__ == "__main__":
    main()
