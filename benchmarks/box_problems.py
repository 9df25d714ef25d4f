"""Planning problems of two arms face to face, with five to ten boxes between them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.core.errors import Failure, WorldError
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.planning.problem import PlanningProblem
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ArmSpec, ObjectSpec, TreeFile, WorldSpec
from bt_dualarm.spec.node_types import NodeSpec
from bt_dualarm.spec.values import PoseSpec

MARGIN_M = 0.045
DT = 0.004
ARMS = {"arm1": ("ur5", 0.0, 0.0), "arm2": ("panda", 1.0, 180.0)}


@dataclass(frozen=True)
class Box:
    """A box on the ground; lengths in m."""

    x: float
    y: float
    size: tuple[float, float, float]

    def spec(self) -> ObjectSpec:
        """The box as in a tree file."""
        pose = PoseSpec(xyz=(self.x, self.y, self.size[2] / 2))
        return ObjectSpec(shape="box", size=self.size, mass=1.0, fixed=True, pose=pose)

    def is_apart(self, other: Box) -> bool:
        """Whether there are 20 mm between two boxes."""
        offsets = zip((self.x - other.x, self.y - other.y), self.size, other.size, strict=False)
        return any(abs(offset) > (one + two) / 2 + 0.02 for offset, one, two in offsets)


def boxes(rng: np.random.Generator) -> list[Box]:
    """Five to ten boxes, the first one a plate; none near an arm's base."""
    found: list[Box] = []
    count = int(rng.integers(5, 11))
    while len(found) < count:
        sides = rng.uniform(0.06, 0.16, 2) if found else rng.permutation((0.01, 0.3))
        box = Box(
            float(rng.uniform(0.22, 0.78)),
            float(rng.uniform(-0.5, 0.5)),
            (float(sides[0]), float(sides[1]), float(rng.uniform(0.08, 0.4))),
        )
        near = min(np.hypot(box.x - x, box.y) for _, x, _ in ARMS.values())
        if near > 0.28 and all(box.is_apart(other) for other in found):
            found.append(box)
    return found


def world_of(obstacles: list[Box]) -> World:
    """A world with two arms and the boxes."""
    tree = NodeSpec(kind="succeed", name="succeed", ports={})
    arms = {
        name: ArmSpec(robot=robot, base=PoseSpec(xyz=(x, 0.0, 0.0), rpy=(0.0, 0.0, yaw)), tree=tree)
        for name, (robot, x, yaw) in ARMS.items()
    }
    objects = {f"box{i}": box.spec() for i, box in enumerate(obstacles)}
    file = TreeFile(
        name="planning",
        world=WorldSpec(scene="empty"),
        objects=objects,
        arms=arms,
        path=Path("planning.yaml"),
    )
    return World(file)


def end(
    rng: np.random.Generator,
    obstacles: list[Box],
    kinematics: Kinematics,
    checker: CollisionChecker,
) -> Vector | None:
    """A free configuration with the tool down, above or between boxes; None after 60 tries."""
    for _ in range(60):
        if rng.random() < 0.6:
            box = obstacles[rng.integers(len(obstacles))]
            place = (box.x, box.y, box.size[2] + rng.uniform(0.01, 0.05))
        else:
            place = (rng.uniform(0.25, 0.75), rng.uniform(-0.45, 0.45), rng.uniform(0.03, 0.1))
        pose = Pose.from_rpy(place, (np.pi, 0.0, rng.uniform(-np.pi, np.pi)))
        try:
            answers = kinematics.solutions(pose, checker.present)
        except Failure:
            continue
        for q in answers:
            if checker.free(q):
                return q
    return None


def problems(seed: int) -> Iterator[tuple[World, str, PlanningProblem]]:
    """An infinite series of worlds, arms and problems, for both arms alternately."""
    rng = np.random.default_rng(seed)
    names = list(ARMS)
    while True:
        obstacles = boxes(rng)
        world = world_of(obstacles)
        name = names[0]
        checker = CollisionChecker(world, name, MARGIN_M)
        body = world.arms[name]
        kinematics = Kinematics(body.robot, body.base)
        try:
            world.refuse_overlaps()
        except WorldError:
            continue
        start = end(rng, obstacles, kinematics, checker)
        goal = end(rng, obstacles, kinematics, checker)
        if start is None or goal is None:
            continue
        names.reverse()
        yield world, name, PlanningProblem(checker, start, (goal,), body.robot.limits, DT)
