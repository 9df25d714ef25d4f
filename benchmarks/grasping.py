"""Objects of many shapes, grasped, shaken, carried fast and placed: success rate and errors.

    python -m benchmarks.grasping [--runs 20] [--seed 0] [--robot ur5] [--gripper robotiq_2f85]
                                  [--reality lab]

Each run has one object at a random pose on the table: a box, a cylinder, a capsule or a sphere of
20 to 70 mm and 0.05 to 1.5 kg; for a suction cup one with a flat face, up to 0.8 kg. It is grasped,
moved back and forth by 80 mm along each axis of the world and carried, both as fast as the arm
allows, and placed. The results of the leaves are compared with the true state. Also prints the true
acceleration of the tool along each axis during the shaking. Exits with code 1 after a false
SUCCESS.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter, deque
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import bt_dualarm as bt
from benchmarks.campaign import Campaign
from benchmarks.grip_arguments import grip_cases, grip_parser
from bt_dualarm.behaviors.report import StatusChange
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.sim.world import World

SHAPES = ["box", "cylinder", "capsule", "sphere"]
STROKE = 0.08
"""Stroke of the shaking, m."""

TABLE = 0.40
"""Height of the table's top, m."""

FALSE_M = 0.02
"""Distance in m from its goal beyond which the SUCCESS of a placed object is false."""

PRINTED_METRICS = (
    "transport.slid_m",
    "place.placed_error_m",
    "place.placed_turned_rad",
    "place.impact_n",
)
"""Metrics whose largest value is printed."""

_SPAN = 10
"""Steps between the positions from which accelerations are computed."""

LIFTED_SHARE = 0.5
"""Share of the lift by which an object must have risen to count as grasped."""


@dataclass
class Tally:
    """Results of all runs.

    Attributes:
        verdicts: Number of runs that ``placed``, ``refused CODE``, ``failed CODE`` or ``lied``.
        worst: Largest value of each metric.
        shaken: Largest acceleration of the tool along each axis of the world, by run, m/s².
    """

    verdicts: Counter[str] = field(default_factory=Counter)
    worst: dict[str, float] = field(default_factory=dict)
    shaken: list[list[float]] = field(default_factory=list)


class TrueAcceleration(IdleObserver):
    """True acceleration of the tool in straight motions.

    Attributes:
        most: Largest acceleration along each axis of the world, of shape (3,), m/s².
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._positions = deque[np.ndarray](maxlen=2 * _SPAN + 1)
        self._shaken = False
        self.most = np.zeros(3)

    def on_event(self, change: StatusChange) -> None:
        """Measure while a straight motion runs."""
        if change.kind == "move_linear":
            self._shaken = change.new == "RUNNING"
            self._positions.clear()

    def after_step(self, time: float) -> None:  # noqa: ARG002 - the world has its own clock
        """Compute second differences of the tool's position, over 20 ms each."""
        if not self._shaken:
            return
        self._positions.append(self._world.arms["arm1"].tool_pose.position)
        if len(self._positions) == 2 * _SPAN + 1:
            span = _SPAN * self._world.model.opt.timestep
            second_difference = (
                self._positions[0] - 2.0 * self._positions[_SPAN] + self._positions[-1]
            )
            self.most = np.maximum(self.most, np.abs(second_difference) / span**2)


def obj(rng: np.random.Generator, cup: bool) -> tuple[dict[str, Any], float]:
    """An object as in a tree file, and the height of its center on the table, m."""
    shape = str(rng.choice(["box", "cylinder"] if cup else SHAPES))
    edges = [float(edge) for edge in rng.uniform(0.045 if cup else 0.02, 0.07, 3)]
    size, height = {
        "box": (edges, edges[2] / 2),
        "cylinder": ([edges[0] / 2, edges[1]], edges[1] / 2),
        "capsule": ([edges[0] / 2, edges[1]], edges[0] / 2),
        "sphere": ([edges[0] / 2], edges[0] / 2),
    }[shape]
    pitch = 90.0 if shape == "capsule" else 0.0  # on its end it would not stand
    place = [float(rng.uniform(0.20, 0.50)), float(rng.uniform(-0.58, -0.32))]
    pose = {
        "xyz": [*place, TABLE + height + 5e-4],
        "rpy": [0, pitch, float(rng.uniform(-180, 180))],
    }
    mass = float(rng.uniform(0.05, 0.8 if cup else 1.5))
    return {"shape": shape, "size": size, "mass": mass, "pose": pose}, height


def task(options: argparse.Namespace, seed: int) -> dict[str, Any]:
    """The tree file of one run."""
    rng = np.random.default_rng(seed)
    declared, height = obj(rng, options.gripper == "suction_cup")
    to = [float(rng.uniform(0.20, 0.45)), float(rng.uniform(-0.55, -0.33)), TABLE + height]
    steps = [
        [sign * (i == axis) * STROKE for i in range(3)] for axis in range(3) for sign in (1, -1)
    ]
    shaken = [{"move_linear": {"offset": {"xyz": step}, "speed": 1.0}} for step in steps]
    middle = {"xyz": [0.35, -0.40, 0.62]}
    leaves = [
        {"grasp": {"object": "thing"}},
        {"transport": {"object": "thing", "to": middle, "speed": 1.0}},
        *shaken,
        {"place": {"object": "thing", "at": {"xyz": to}, "speed": 1.0}},
    ]
    world = {"scene": "table", "reality": options.reality, "seed": seed, "time_limit": 90}
    base = {"xyz": [0.0, 0.0, TABLE]}
    arm = {"robot": options.robot, "gripper": options.gripper, "base": base}
    return {
        "bt_dualarm": 1,
        "name": "grasping",
        "world": world,
        "objects": {"thing": declared},
        "arms": {"arm1": arm | {"tree": {"sequence": leaves}}},
    }


def attempt(file: dict[str, Any]) -> tuple[bt.RunResult, list[float]]:
    """Result of one run, and the largest acceleration of the tool along each axis, m/s²."""
    with bt.open(file) as run:
        shaking = TrueAcceleration(run.world)
        run.watch(shaking)
        return run.finish(), shaking.most.tolist()


def evaluate(seed: int, **settings: str) -> dict[str, Any]:
    """Verdict on one run, its largest metrics, and the largest accelerations of its tool."""
    result, shaken = attempt(task(argparse.Namespace(**settings), seed))
    worst: dict[str, float] = {}
    verdict = _verdict(result, worst)
    outcome = "SUCCESS" if verdict == "placed" else "FAILURE"
    return {"outcome": outcome, "code": verdict, "worst": worst, "shaken": shaken}


def _verdict(result: bt.RunResult, worst: dict[str, float]) -> str:
    leaves = list(result.arms["arm1"].leaves.items())
    for name, leaf in leaves:
        declared = name.rpartition("/")[2].partition("#")[0]
        for metric, value in leaf.metrics.items():
            if isinstance(value, float) and declared in ("grasp", "transport", "place"):
                key = f"{declared}.{metric}"
                worst[key] = max(worst.get(key, 0.0), abs(value))
        if leaf.status == "SUCCESS" and (
            float(leaf.metrics.get("lifted_m", 1.0)) < LIFTED_SHARE * 0.04
            or float(leaf.metrics.get("placed_error_m", 0.0)) > FALSE_M
        ):
            return "false success"
    for name, leaf in leaves:
        if leaf.status == "FAILURE":
            before = name.endswith("grasp") and "lifted_m" not in leaf.metrics
            moved = "approach_force_n" in leaf.metrics
            return f"{'refused' if before and not moved else 'failed'} {leaf.code}"
    return "placed" if result.outcome == "SUCCESS" else f"failed {result.outcome}"


def main() -> int:
    """Run all cases and print the figures; returns 1 after a false success."""
    parser = grip_parser(__doc__, 20)
    options = parser.parse_args()
    tally = Tally()
    with Campaign(options) as campaign:
        for case, found in campaign.run(evaluate, grip_cases(options)):
            verdict = found["code"]
            tally.verdicts[verdict] += 1
            for key, value in found["worst"].items():
                tally.worst[key] = max(tally.worst.get(key, 0.0), value)
            if verdict == "placed":
                tally.shaken.append(found["shaken"])
            else:
                print(f"seed {case['seed']}: {verdict}", flush=True)
        print(f"{options.robot}, {options.gripper}, {options.reality}: {dict(tally.verdicts)}")
        for metric in PRINTED_METRICS:
            if metric in tally.worst:
                print(f"  worst {metric}: {tally.worst[metric]:.3g}")
        if tally.shaken:
            middle = np.median(tally.shaken, axis=0)
            least = np.min(tally.shaken, axis=0)
            print(f"  shaken, m/s², x y z: median {middle.round(1)}, least {least.round(1)}")
        return 1 if tally.verdicts["false success"] else 0


if __name__ == "__main__":
    sys.exit(main())
