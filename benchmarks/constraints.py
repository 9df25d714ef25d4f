"""An arm carries an object upright past boxes: success rate and largest tilt.

    python -m benchmarks.constraints [--carries 200] [--upright 5] [--reality lab] [--seed 0]

The worlds, starts and goals are those of `benchmarks.planning`: alternately a UR5 and a Panda among
five to ten boxes, with the tool pointing down. The arm reaches the start by any path, and then the
goal with `keep: {upright: ...}`.

The tilt is that of the simulated tool, relative to the start of the second leaf, in every physics
step. A carry without a path counts as solvable if the planner finds one from the same configuration
with ten times as many poses. Goals: no tilt more than 0.5° beyond the limit, no leaf that ends with
`KEEP_VIOLATED`, and 98 % of the solvable carries solved; exits with code 1 if one is missed.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import Any

import numpy as np

import bt_dualarm as bt
from benchmarks.box_problems import ARMS, problems
from benchmarks.campaign import Campaign, Drawn, add_options
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.planning.path_constraints import POSES, Cone, ConstrainedProblem, PathConstraint
from bt_dualarm.planning.problem import PlanningProblem, admitted
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.sim.world import World

BEYOND_RAD = np.radians(0.5)
SOLVED = 0.98
UP = np.array((0.0, 0.0, 1.0))


@dataclass
class TrueTilt(IdleObserver):
    """Largest true tilt of a tool while a leaf runs.

    Attributes:
        world: World of the run.
        arm: Name of the arm.
        leaf: Path of the leaf.
        most: Largest tilt so far, rad.
        start: Joint positions by the sensors when the leaf begins, of shape (dof,), rad.
    """

    world: World
    arm: str
    leaf: str
    most: float = 0.0
    start: Vector | None = None
    _up: Vector | None = field(default=None)
    _runs: bool = False

    def on_event(self, change: Any) -> None:
        """Record when the leaf begins and ends."""
        if change.path == self.leaf:
            self._runs = change.new == "RUNNING"
            if self._runs:
                self.start = self.world.hardware[self.arm].q.copy()

    def after_step(self, time: float) -> None:  # noqa: ARG002 - declared by the base class
        """Measure the tilt."""
        if not self._runs:
            return
        tool = self.world.arms[self.arm].tool_pose
        if self._up is None:
            self._up = tool.inverse.turn(UP)
        self.most = max(self.most, float(np.arccos(min(1.0, tool.turn(self._up) @ UP))))


def task(world: World, arm: str, poses: tuple[Pose, Pose], upright: float, reality: str) -> Any:
    """The tree file of one carry."""
    start, goal = (
        {"xyz": pose.position.tolist(), "quat": pose.quaternion.tolist()} for pose in poses
    )
    robot, x, yaw = ARMS[arm]
    tree = [
        {"reach_to_pose": {"to": start}},
        {"reach_to_pose": {"to": goal, "keep": {"upright": upright}}},
    ]
    return {
        "bt_dualarm": 1,
        "name": "upright",
        "world": {"scene": "empty", "reality": reality},
        "objects": {name: one.model_dump(mode="json") for name, one in world.objects.items()},
        "arms": {
            arm: {
                "robot": robot,
                "base": {"xyz": [x, 0, 0], "rpy": [0, 0, yaw]},
                "tree": {"sequence": tree},
            }
        },
    }


def is_solvable(world: World, arm: str, problem: PlanningProblem, upright: float) -> bool:
    """Whether ten times as many poses find a path."""
    body = world.arms[arm]
    kinematics = Kinematics(body.robot, body.base)
    axis = kinematics.forward(problem.start).inverse.turn(UP)
    cone = Cone("upright", axis, np.radians(upright), UP)
    keep = PathConstraint(body.robot, body.base, Pose.identity(), (cone,))
    try:
        ConstrainedProblem(admitted(problem), keep, 10 * POSES).motion()
    except Failure:
        return False
    return True


@cache
def _problems(seed: int) -> Drawn[tuple[World, str, PlanningProblem]]:
    return Drawn(partial(problems, seed))


def carry(seed: int, number: int, upright: float, reality: str) -> dict[str, Any]:
    """Outcome of a carry, its largest tilt in rad, and whether a path was missed."""
    world, arm, problem = _problems(seed)[number]
    body = world.arms[arm]
    kinematics = Kinematics(body.robot, body.base)
    poses = kinematics.forward(problem.start), kinematics.forward(problem.goals[0])
    with bt.open(task(world, arm, poses, upright, reality), seed=seed) as run:
        tilt = TrueTilt(run.world, arm, "sequence/reach_to_pose#2")
        run.watch(tilt)
        result = run.finish()
    *_, last = result.arms[arm].runs
    code = "start not reached" if last.path != tilt.leaf else last.code or str(last.status)
    return {
        "outcome": "SUCCESS" if code == "SUCCESS" else "FAILURE",
        "code": code,
        "arm": arm,
        "tilt": tilt.most,
        "unsolved": code in ("NO_PLAN", "IN_COLLISION")
        and tilt.start is not None
        and is_solvable(world, arm, replace(problem, start=tilt.start), upright),
    }


def main() -> int:
    """Print the counts and the largest tilt; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--carries", type=int, default=200)
    parser.add_argument("--upright", type=float, default=5.0, help="largest tilt, degrees")
    parser.add_argument("--reality", default="lab")
    parser.add_argument("--seed", type=int, default=0)
    add_options(parser)
    options = parser.parse_args()
    outcomes: Counter[str] = Counter()
    worst = 0.0
    unsolved = 0
    settings = {name: getattr(options, name) for name in ("seed", "upright", "reality")}
    cases = [{"number": number, **settings} for number in range(options.carries)]
    with Campaign(options) as campaign:
        for _, found in campaign.run(carry, cases):
            outcomes[found["code"]] += 1
            worst = max(worst, found["tilt"])
            unsolved += found["unsolved"]
            tilt_deg = np.degrees(found["tilt"])
            print(f"{found['arm']}: {found['code']}, tilt {tilt_deg:.2f}°", flush=True)
        solved = outcomes["SUCCESS"] / max(outcomes["SUCCESS"] + unsolved, 1)
        print(", ".join(f"{count} {code}" for code, count in outcomes.most_common()))
        print(
            f"{100 * solved:.1f} % of the solvable carries; largest tilt {np.degrees(worst):.2f}°"
        )
        kept = worst <= np.radians(options.upright) + BEYOND_RAD and not outcomes["KEEP_VIOLATED"]
        return 0 if kept and solved >= SOLVED else 1


if __name__ == "__main__":
    sys.exit(main())
