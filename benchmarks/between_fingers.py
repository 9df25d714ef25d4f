"""Planning with a thing between open fingers: python -m benchmarks.between_fingers [--problems N].

Problems near the taking of things, as those of MotionBenchMaker are (RA-L 2022): posts of 25 to
60 mm stand around a Panda with its stock hand, and the goal is its tool around the top of one of
them. Printed, with the fingers where the page locks them and with `locked` opening them: how many
problems are admitted, and how many of these solved.
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
"""How far the top of a post is between the fingers."""

_DT: Final = 0.004


def finger_problems(seed: int, locked: Mapping[str, float]) -> Iterator[PlanningProblem]:
    """Problems without an end; the same ones, wherever joints are locked.

    Args:
        seed: Draws posts and goals.
        locked: Where locked joints of the arm stand.
    """
    draw = np.random.default_rng(seed)
    while True:
        posts = [_post(draw) for _ in range(int(draw.integers(1, 4)))]
        tall, _, place, yaw = posts[0]
        world = _world(posts, locked)
        if any(True for _ in world.overlaps()):
            continue
        robot = world.arms["arm1"].robot
        # Fingers open along the hand's y axis: with the tool turned as the post is, across it.
        pose = Pose.from_rpy((*place, tall - _DEPTH_M), (np.pi, 0.0, yaw))
        checker = CollisionChecker(world, "arm1")
        try:
            goals = Kinematics(robot, Pose.identity()).solutions(pose, checker.present)
        except Failure:
            continue
        start = robot.postures["home"]
        yield PlanningProblem(checker, start, tuple(goals), robot.limits, _DT)


def _post(draw: np.random.Generator) -> tuple[float, float, tuple[float, float], float]:
    """Height and width in m, place on the floor, how it is turned in rad."""
    away = draw.uniform(0.4, 0.65)
    side = draw.uniform(-0.9, 0.9)
    place = (float(away * np.cos(side)), float(away * np.sin(side)))
    return draw.uniform(0.1, 0.3), draw.uniform(0.025, 0.06), place, draw.uniform(-0.7, 0.7)


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
    """Whether the arm can stand at both ends."""
    try:
        admitted(problem)
    except Failure:
        return False
    return True


def solves(problem: PlanningProblem) -> bool:
    """Whether a way between them is found."""
    with contextlib.suppress(Failure):
        ready = admitted(problem)
        return (straight_motion(ready) or motion_around(ready)) is not None
    return False


@cache
def _problems(seed: int, *, is_open: bool) -> Drawn[PlanningProblem]:
    return Drawn(partial(finger_problems, seed, OPEN if is_open else SHUT))


def tried(seed: int, number: int, *, is_open: bool) -> dict[str, Any]:
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
        for name, is_open in (("as the page locks them", False), ("open", True)):
            words = {"seed": arguments.seed, "is_open": is_open}
            cases = [{"number": number, **words} for number in range(count)]
            outcomes = Counter(found["outcome"] for _, found in campaign.run(tried, cases))
            can = count - outcomes["SKIPPED"]
            solved = outcomes["SUCCESS"]
            print(f"fingers {name}: {can} of {count} admitted, {solved} solved", flush=True)


if __name__ == "__main__":
    main()
