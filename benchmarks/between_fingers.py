"""Planning with an object between the fingers: python -m benchmarks.between_fingers [--problems N].

Pre-grasp problems like those of MotionBenchMaker (RA-L 2022): posts of 25 to 60 mm stand around a
Panda with its stock hand, and at the goal the open fingers surround the top of one of them. Prints
how many problems are admitted, and how many of these are solved: with the fingers locked as in the
robot description, and with `locked` opening them.
"""

from __future__ import annotations

import argparse
import contextlib
from collections import Counter
from collections.abc import Iterator, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.campaign import Campaign, Drawn, add_options
from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.planning.problem import PlanningProblem, admitted, motion_around, straight_motion
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ArmSpec, ObjectSpec, TreeFile, WorldSpec
from bt_dualarm.spec.node_types import NodeSpec
from bt_dualarm.spec.values import PoseSpec

OPEN: Final[Mapping[str, float]] = {"panda_finger_joint1": 0.04}
SHUT: Final[Mapping[str, float]] = {}

_DEPTH_M: Final = 0.02
"""Depth of the top of a post between the fingers, m."""

_DT: Final = 0.004


def finger_problems(seed: int, locked: Mapping[str, float]) -> Iterator[PlanningProblem]:
    """An infinite series of problems, which does not depend on the locked joints.

    Args:
        seed: Seed of posts and goals.
        locked: Positions of the locked joints of the arm, rad or m.
    """
    rng = np.random.default_rng(seed)
    while True:
        posts = [_post(rng) for _ in range(int(rng.integers(1, 4)))]
        tall, _, place, yaw = posts[0]
        world = _world(posts, locked)
        if any(True for _ in world.overlaps()):
            continue
        robot = world.arms["arm1"].robot
        # Fingers open along the hand's y axis: with the yaw of the post they open across it.
        pose = Pose.from_rpy((*place, tall - _DEPTH_M), (np.pi, 0.0, yaw))
        checker = CollisionChecker(world, "arm1")
        try:
            goals = Kinematics(robot, Pose.identity()).solutions(pose, checker.present)
        except Failure:
            continue
        start = robot.postures["home"]
        yield PlanningProblem(checker, start, tuple(goals), robot.limits, _DT)


def _post(rng: np.random.Generator) -> tuple[float, float, tuple[float, float], float]:
    """Height and width in m, position on the floor in m, and yaw in rad."""
    distance = rng.uniform(0.4, 0.65)
    side = rng.uniform(-0.9, 0.9)
    place = (float(distance * np.cos(side)), float(distance * np.sin(side)))
    return rng.uniform(0.1, 0.3), rng.uniform(0.025, 0.06), place, rng.uniform(-0.7, 0.7)


def _world(
    posts: list[tuple[float, float, tuple[float, float], float]], locked: Mapping[str, float]
) -> World:
    tree = NodeSpec(kind="succeed", name="succeed", ports={})
    objects = {
        f"post{i}": ObjectSpec(
            shape="box",
            size=(width, width, tall),
            mass=1.0,
            fixed=True,
            pose=PoseSpec(xyz=(*place, tall / 2 + 0.002), rpy=(0.0, 0.0, float(np.rad2deg(yaw)))),
        )
        for i, (tall, width, place, yaw) in enumerate(posts)
    }
    arm = ArmSpec(robot="panda", locked=dict(locked), tree=tree)
    return World(
        TreeFile(
            name="between_fingers",
            world=WorldSpec(scene="empty"),
            objects=objects,
            arms={"arm1": arm},
            path=Path("between_fingers.yaml"),
        )
    )


def admits(problem: PlanningProblem) -> bool:
    """Whether the start and a goal are admissible."""
    try:
        admitted(problem)
    except Failure:
        return False
    return True


def solves(problem: PlanningProblem) -> bool:
    """Whether a path is found."""
    with contextlib.suppress(Failure):
        ready = admitted(problem)
        return (straight_motion(ready) or motion_around(ready)) is not None
    return False


@cache
def _problems(seed: int, *, is_open: bool) -> Drawn[PlanningProblem]:
    return Drawn(partial(finger_problems, seed, OPEN if is_open else SHUT))


def try_problem(seed: int, number: int, *, is_open: bool) -> dict[str, Any]:
    """Whether a problem is admitted, and whether it is solved."""
    problem = _problems(seed, is_open=is_open)[number]
    if not admits(problem):
        return {"outcome": "SKIPPED"}
    return {"outcome": "SUCCESS" if solves(problem) else "FAILURE"}


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    add_options(parser)
    arguments = parser.parse_args()
    count = arguments.problems
    with Campaign(arguments) as campaign:
        for name, is_open in (("locked as described", False), ("open", True)):
            settings = {"seed": arguments.seed, "is_open": is_open}
            cases = [{"number": number, **settings} for number in range(count)]
            outcomes = Counter(found["outcome"] for _, found in campaign.run(try_problem, cases))
            admitted_count = count - outcomes["SKIPPED"]
            solved = outcomes["SUCCESS"]
            print(
                f"fingers {name}: {admitted_count} of {count} admitted, {solved} solved", flush=True
            )


if __name__ == "__main__":
    main()
