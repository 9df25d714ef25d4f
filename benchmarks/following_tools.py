"""Accuracy with which an arm keeps its transform to another arm's tool that moves at full speed.

    python -m benchmarks.following_tools [--trials 60] [--seed 0] [--reality lab] [--speed 1.0]
    python -m benchmarks.following_tools --only 17

Two random robots face each other. The second one follows the tool of the first one, at the current
transform or at a random one, while the first one executes four random motions. The error is the
true deviation of the relative position from that at rest, after the arrival. Trials in which the
second arm cannot reach some pose (``UNREACHABLE``, ``INVALID_TARGET``, ``IN_COLLISION``,
``NO_PLAN``, ``SINGULAR``) or no motion of the first arm succeeds are counted separately. Exits with
code 1 if an error exceeds 1 mm or the transform is lost.
"""

from __future__ import annotations

import argparse
import itertools
import statistics
import sys
from collections import Counter
from typing import Any, Final

import numpy as np

from benchmarks.campaign import Campaign, add_options, registry
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.core.pose import Pose
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.world import World

ROBOTS: Final = ("ur5", "ur10", "panda", "xarm7", "ur3")
ALLOWED_M: Final = 1e-3
OUT_OF_REACH: Final = ("UNREACHABLE", "INVALID_TARGET", "IN_COLLISION", "NO_PLAN", "SINGULAR")
BEGIN_S: Final = 6.0
"""Time at which the first arm begins to move; the second one has arrived by then."""

Tree = dict[str, Any]


def generate(seed: int, reality: str, speed: float) -> Tree:
    """Tree file of a seed."""
    rng = np.random.default_rng(seed)
    leader, follower = (str(one) for one in rng.choice(ROBOTS, 2))
    distance = round(float(rng.uniform(1.0, 1.3)), 3)
    follow: Tree = {"arm": "arm1", "speed": 1.0}
    if rng.random() < 0.5:
        x, y = rng.uniform(-0.1, 0.1, 2).round(3).tolist()
        z = round(float(rng.uniform(0.15, 0.35)), 3)
        roll, pitch, yaw = rng.uniform(-25.0, 25.0, 3).round(1).tolist()
        follow["offset"] = {"xyz": [x, y, z], "rpy": [180.0 + roll, pitch, yaw]}
    motions = [_motion(rng, speed) for _ in range(4)]
    start: list[Tree] = [{"wait": {"seconds": BEGIN_S}}]
    attempts = [{"force_success": {"child": one}} for one in motions]
    return {
        "bt_dualarm": 1,
        "name": "following",
        "world": {"scene": "empty", "reality": reality, "seed": seed, "time_limit": 60.0},
        "arms": {
            "arm1": {"robot": leader, "tree": {"sequence": start + attempts}},
            "arm2": {
                "robot": follower,
                "base": {"xyz": [distance, 0.0, 0.0], "rpy": [0.0, 0.0, 180.0]},
                "tree": {"sequence": [{"follow_tool": follow}]},
            },
        },
    }


def _motion(rng: np.random.Generator, speed: float) -> Tree:
    xyz = rng.uniform(-0.15, 0.15, 3).round(3).tolist()
    rpy = rng.uniform(-20.0, 20.0, 3).round(1).tolist()
    kind = rng.choice(("line", "reach", "turn", "circle"))
    if kind == "line":
        return {"move_linear": {"offset": {"xyz": xyz}, "speed": speed}}
    if kind == "reach":
        return {"reach_to_pose": {"offset": {"xyz": xyz, "rpy": rpy}, "speed": speed}}
    if kind == "turn":
        angle = round(float(rng.uniform(-40.0, 40.0)), 1)
        return {"rotate_tool": {"angle": angle, "speed": speed}}
    radius = round(float(rng.uniform(0.03, 0.1)), 3)
    plane = str(rng.choice(("xy", "yz", "xz")))
    return {"circle": {"radius": radius, "plane": plane, "speed": speed}}


class TrueTransform(IdleObserver):
    """True pose of the second tool in the frame of the first one, at each step."""

    def __init__(self, world: World) -> None:
        self._world = world
        self.times: list[float] = []
        self.poses: list[Pose] = []

    def after_step(self, time: float) -> None:
        """Sample the transform."""
        arms = self._world.arms
        self.times.append(time)
        self.poses.append(arms["arm1"].tool_pose.inverse @ arms["arm2"].tool_pose)

    def errors_m(self, since: float, until: float) -> np.ndarray:
        """Distances from the position at the beginning of an interval, of shape (n,), m."""
        chosen = [
            pose.position
            for time, pose in zip(self.times, self.poses, strict=True)
            if since <= time <= until
        ]
        if not chosen:
            return np.zeros(0)
        return np.asarray(np.linalg.norm(np.array(chosen) - chosen[0], axis=1))


def run_trial(seed: int, reality: str, speed: float) -> dict[str, Any]:
    """Largest error of a trial, m, or why there is none, and the line to print."""
    file = generate(seed, reality, speed)
    skills = registry()
    with Run(load_tree_file(file, skills.kinds), skills, RunOptions(renderer="ray")) as run:
        transform = TrueTransform(run.world)
        run.watch(transform)
        result = run.finish()
    pair = f"{file['arms']['arm1']['robot']} leads {file['arms']['arm2']['robot']}"
    leaf = next(one for one in result.arms["arm2"].runs if one.skill == "follow_tool")
    moved = sum(one.status == "SUCCESS" and one.skill != "wait" for one in result.arms["arm1"].runs)
    head = f"{seed}: {pair}, {moved} motions"
    if leaf.code in OUT_OF_REACH or not moved:
        code = leaf.code or "no motion of the leader"
        line = f"{head}: left out: {leaf.code} {leaf.reason}"
        return {"outcome": "SKIPPED", "code": code, "message": line}
    if leaf.status != "SUCCESS":
        line = f"{head}: {leaf.code}: {leaf.reason}"
        return {"outcome": "FAILURE", "code": leaf.code, "message": line}
    errors = transform.errors_m(BEGIN_S - 0.1, leaf.ended_s or 0.0)
    largest = float(errors.max(initial=0.0))
    rms = float(np.sqrt(np.mean(errors**2)))
    line = f"{head}: {1e3 * largest:.2f} mm, rms {1e3 * rms:.2f} mm"
    return {"outcome": "SUCCESS", "largest_m": largest, "message": line}


def main() -> int:
    """Run the trials; returns the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--trials", type=int, default=60, help="number of trials that count")
    parser.add_argument("--seed", type=int, default=0, help="the first seed")
    parser.add_argument("--reality", default="lab", choices=("ideal", "lab", "rough"))
    parser.add_argument("--speed", type=float, default=1.0, help="speed of the first arm")
    parser.add_argument("--only", type=int, help="run only this seed")
    add_options(parser)
    options = parser.parse_args()
    only = options.only
    seeds = itertools.count(options.seed) if only is None else iter([only])
    settings = {"reality": options.reality, "speed": options.speed}
    cases = ({"seed": seed, **settings} for seed in seeds)
    largest: list[float] = []
    left_out = Counter[str]()
    lost = 0
    with Campaign(options) as campaign:
        for _, found in campaign.run(run_trial, cases, options.trials if only is None else 1):
            print(found["message"], flush=True)
            if found["outcome"] == "SKIPPED":
                left_out[found["code"]] += 1
            elif found["outcome"] == "FAILURE":
                lost += 1
            else:
                largest.append(found["largest_m"])
        print(f"{len(largest) + lost} trials, {lost} lost; left out: {dict(left_out)}")
        if largest:
            print(
                f"  largest error per trial: median {1e3 * statistics.median(largest):.2f} mm, "
                f"maximum {1e3 * max(largest):.2f} mm"
            )
        worse = sum(one > ALLOWED_M for one in largest)
        print(f"  more than {1e3 * ALLOWED_M:g} mm: {worse}")
        return 1 if lost or worse else 0


if __name__ == "__main__":
    sys.exit(main())
