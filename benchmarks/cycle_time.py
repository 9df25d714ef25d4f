"""Simulated time of skills and of their phases.

    python -m benchmarks.cycle_time [--seeds 3] [--first 0] [--robots ur3 ur5 ur10 panda xarm7]
                                    [--grippers robotiq_2f85 panda_hand suction_cup]
                                    [--reality lab] [--speed 1.0] [--tasks carry insert sight]

``carry`` grasps a random box or cylinder and places it 0.4 m away; ``insert`` grasps a peg and
inserts it into a hole up to 1.5 mm beside the declared position; ``sight`` is the tree
`pick_by_sight` with each robot. ``--speed`` applies to each leaf that has a speed. The phase of a
skill is its innermost suspended generator. Prints medians over all successful runs, in s: of each
skill, of grasp and place together, and of each phase. Exits with code 1 if a run fails, or if a
median exceeds its goal (``GOALS``) at speed 1.0 in ``lab``.
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from pathlib import Path
from types import GeneratorType
from typing import Any, Final

import numpy as np
import yaml

import bt_dualarm as bt
from benchmarks import inserting
from benchmarks.campaign import Campaign, add_options
from bt_dualarm.behaviors.leaf import SkillRun
from bt_dualarm.behaviors.report import LeafReport
from bt_dualarm.skill.registry import Registry

ROBOTS: Final = ("ur3", "ur5", "ur10", "panda", "xarm7")
GRIPPERS: Final = ("robotiq_2f85", "panda_hand", "suction_cup")
TASKS: Final = ("carry", "insert", "sight")

GOALS: Final = {
    "grasp": 2.5,
    "place": 2.0,
    "grasp and place": 5.0,
    "insert": 12.0,
    "pick_by_sight": 8.0,
}
"""Goals for the median simulated time at speed 1.0 in ``lab``, s."""

_TABLE_M: Final = 0.40
_DISTANCE_M: Final = 0.4
_BASE: Final = {"xyz": [0.35, 0.0, _TABLE_M], "rpy": [0, 0, -90]}
_TREES: Final = Path(__file__).parents[1] / "trees"

# Generators that only delegate to others, and are omitted from the names of phases.
_DELEGATING: Final = frozenset({"run", "through", "along", "_along", "to_line", "_when_clear"})


class Phases:
    """Simulated time of one run by skill and phase, which is the chain of suspended generators.

    Attributes:
        seconds: Simulated time by skill and phase, s.
    """

    def __init__(self) -> None:
        self.seconds: dict[tuple[str, str], float] = defaultdict(float)
        self._last: tuple[str, str, float] | None = None

    def record(self, run: SkillRun) -> None:
        """Add the time since the previous step of the skill to its phase."""
        skill = run._skill
        name = type(skill).__name__
        if self._last is not None and self._last[0] == name:
            self.seconds[name, self._last[1]] += skill.time - self._last[2]
        self._last = (name, _phase(run._steps), skill.time)


def _phase(steps: object) -> str:
    names = []
    while isinstance(steps, GeneratorType):
        names.append(steps.gi_code.co_name)
        steps = steps.gi_yieldfrom
    return " > ".join(name for name in names if name not in _DELEGATING) or "end"


def carry(robot: str, gripper: str, reality: str, seed: int) -> dict[str, Any]:
    """A tree file in which an arm grasps an object and places it 0.4 m away."""
    rng = np.random.default_rng((seed, ROBOTS.index(robot)))
    cup = gripper == "suction_cup"
    low = 0.045 if cup else 0.025
    shape = str(rng.choice(["box", "cylinder"]))
    edges = rng.uniform(low, 0.06, 3)
    size = edges.tolist() if shape == "box" else [float(edges[0]) / 2, float(edges[1])]
    height = float(edges[2] if shape == "box" else edges[1])
    near, far = (-0.32, -0.28) if robot == "ur3" else (-0.48, -0.34)
    along = float(rng.uniform(-0.03, 0.03))
    x = 0.35 + along + 0.5 * _DISTANCE_M * np.array((1.0, -1.0)) * rng.choice([-1.0, 1.0])
    y = float(rng.uniform(near, far))
    pose = {
        "xyz": [float(x[0]), y, _TABLE_M + height / 2],
        "rpy": [0, 0, float(rng.uniform(0, 90))],
    }
    obj = {"shape": shape, "size": size, "mass": float(rng.uniform(0.1, 0.5)), "pose": pose}
    at = {"xyz": [float(x[1]), y, _TABLE_M + height / 2]}
    leaves = [{"grasp": {"object": "thing"}}, {"place": {"object": "thing", "at": at}}]
    return _file("carry", robot, gripper, reality, seed, {"thing": obj}, leaves)


def _file(
    name: str,
    robot: str,
    gripper: str,
    reality: str,
    seed: int,
    objects: dict[str, Any],
    leaves: list[Any],
) -> dict[str, Any]:
    arm = {"robot": robot, "gripper": gripper, "base": _BASE, "tree": {"sequence": leaves}}
    return {
        "bt_dualarm": 1,
        "name": name,
        "world": {"scene": "table", "reality": reality, "seed": seed, "time_limit": 200},
        "objects": objects,
        "arms": {"arm1": arm},
    }


def insert(robot: str, gripper: str, reality: str, seed: int) -> dict[str, Any]:
    """The tree file of `benchmarks.inserting` for a robot."""
    options = argparse.Namespace(
        robot=robot, gripper=gripper, reality=reality, shape="cylinder", direction="down"
    )
    file, _ = inserting.task(options, seed)
    return file


def sight(robot: str, gripper: str, reality: str, seed: int) -> dict[str, Any]:
    """The tree `pick_by_sight` with another robot and gripper."""
    file: dict[str, Any] = yaml.safe_load((_TREES / "pick_by_sight.yaml").read_text("utf-8"))
    file["arms"]["arm1"] |= {"robot": robot, "gripper": gripper}
    file["world"] |= {"reality": reality, "seed": seed}
    return file


def _at_speed(node: Any, speed: float, with_speed: frozenset[str]) -> Any:
    """A node of a tree file, with the speed set in each leaf that has one."""
    if isinstance(node, list):
        return [_at_speed(one, speed, with_speed) for one in node]
    if isinstance(node, str):
        return {node: {"speed": speed}} if node in with_speed else node
    if not isinstance(node, dict):
        return node
    changed = {key: _at_speed(value, speed, with_speed) for key, value in node.items()}
    return {
        key: value | {"speed": speed} if key in with_speed and isinstance(value, dict) else value
        for key, value in changed.items()
    }


def run(file: dict[str, Any], speed: float) -> tuple[tuple[LeafReport, ...], float, Phases]:
    """The leaves of a run, its simulated time, and its phases."""
    skills = Registry.load().skills
    with_speed = frozenset(name for name in skills if "speed" in skills[name].Ports.model_fields)
    arm = file["arms"]["arm1"]
    arm["tree"] = _at_speed(arm["tree"], speed, with_speed)
    phases = Phases()
    step = SkillRun.step

    def observed(self: SkillRun, fault: BaseException | None) -> bool:
        goes_on = step(self, fault)
        phases.record(self)
        return goes_on

    SkillRun.step = observed  # type: ignore[method-assign]
    try:
        with bt.open(file) as opened:
            result = opened.finish()
    finally:
        SkillRun.step = step  # type: ignore[method-assign]
    return result.arms["arm1"].runs, result.sim_time_s, phases


def times_of(task: str, runs: tuple[LeafReport, ...], seconds: float) -> dict[str, float]:
    """Simulated time of each skill of a run, and of the whole task, s."""
    took = {leaf.skill: (leaf.ended_s or 0.0) - leaf.started_s for leaf in runs}
    if task == "carry":
        took["grasp and place"] = took["grasp"] + took["place"]
    if task == "sight":
        return {"pick_by_sight": seconds}
    return took if task == "carry" else {"insert": took["insert"]}


MAKERS = {"carry": carry, "insert": insert, "sight": sight}


def measure(
    task: str, robot: str, gripper: str, reality: str, seed: int, speed: float
) -> dict[str, Any]:
    """Times of the skills of a run and of their phases, s, or which one failed."""
    runs, seconds, recorded = run(MAKERS[task](robot, gripper, reality, seed), speed)
    bad = [leaf for leaf in runs if leaf.status != "SUCCESS"]
    if bad:
        message = f"{bad[0].skill} {bad[0].code}: {bad[0].reason}"
        return {"outcome": "FAILURE", "code": bad[0].code, "bad": message}
    phases = [[skill, phase, value] for (skill, phase), value in recorded.seconds.items()]
    return {"took": times_of(task, runs, seconds), "phases": phases}


def main() -> int:
    """Run all tasks and print the medians; returns 1 if one failed or missed its goal."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--robots", nargs="+", default=list(ROBOTS), choices=ROBOTS)
    parser.add_argument("--grippers", nargs="+", default=list(GRIPPERS), choices=GRIPPERS)
    parser.add_argument("--tasks", nargs="+", default=list(TASKS), choices=TASKS)
    parser.add_argument("--reality", default="lab")
    parser.add_argument("--speed", type=float, default=1.0)
    add_options(parser)
    options = parser.parse_args()
    with Campaign(options) as campaign:
        return run_cases(options, campaign)


def run_cases(options: argparse.Namespace, campaign: Campaign) -> int:
    """Run all cases and print the medians; returns the exit code."""
    times: dict[str, list[float]] = defaultdict(list)
    phases: dict[tuple[str, str], list[float]] = defaultdict(list)
    failed = 0
    settings = {"reality": options.reality, "speed": options.speed}
    cases = [
        {"task": task, "robot": robot, "gripper": gripper, "seed": seed, **settings}
        for task in options.tasks
        for robot in options.robots
        for seed in range(options.first, options.first + options.seeds)
        for gripper in (options.grippers[seed % len(options.grippers)],)
        if (task, gripper) != ("insert", "suction_cup")  # the peg is too thin for it
    ]
    for case, found in campaign.run(measure, cases):
        task = case["task"]
        label = f"{task} {case['robot']} {case['gripper']} seed {case['seed']}"
        if "bad" in found:
            failed += 1
            print(f"{label}: {found['bad']}", flush=True)
            continue
        took = found["took"]
        print(f"{label}:", ", ".join(f"{k} {v:.2f}" for k, v in took.items()), flush=True)
        for name, value in took.items():
            times[name].append(value)
        for skill, phase, value in found["phases"]:
            phases[(f"{task} {skill}", phase)].append(value)
    for (skill, phase), values in phases.items():
        print(f"{np.median(values):6.2f} s  {len(values):3}x  {skill}: {phase}")
    missed = 0
    for name, values in times.items():
        median = float(np.median(values))
        goal = GOALS.get(name, np.inf)
        missed += options.speed == 1.0 and options.reality == "lab" and median > goal
        print(
            f"{name}: median {median:.2f} s of {len(values)}, worst {max(values):.2f} (goal {goal})"
        )
    print(f"{failed} failed")
    return 1 if failed or missed else 0


if __name__ == "__main__":
    sys.exit(main())
