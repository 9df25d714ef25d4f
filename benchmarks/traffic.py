"""Cells in which two to five arms obstruct each other, without keywords for coordination.

    python -m benchmarks.traffic [--cells 20] [--seed 0] [--reality lab] [--orders 1] [--quick]
    python -m benchmarks.traffic --only 17

Arms of several robots stand around one table. They fill a tray in its middle (``bin``), take the
objects in it to shelves of their own (``table``), or reach for positions across it (``cross``). A
cell counts if each of its trees succeeds while its arm is the only one that moves; other cells are
left out. For each cell, the outcome is printed, the makespan relative to that of one arm after the
other, and the share of the longest single tree in that sum, which is a lower bound. Contacts are
those of the simulation. With ``--quick``, the arms of a cell run alone only if it fails, and there
are no makespans: that takes a fourth of the time. With ``--orders 2`` each cell runs once more with
its arms listed in reverse, and each leaf must end with the same code. Exits with code 1 after a
contact or if a leaf does not.
"""

from __future__ import annotations

import argparse
import itertools
import math
import statistics
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from benchmarks.campaign import Campaign, add_options, registry
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.core.errors import DualArmError
from bt_dualarm.core.pose import Pose
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.outcome import RunResult
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.composition import name_of_geom
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry

ROBOTS: Final = ("ur5", "ur10", "panda", "xarm7", "ur3")
GRIPPERS: Final = ("robotiq_2f85", "panda_hand")
KINDS: Final = ("bin", "table", "cross")
LIMIT_S: Final = 300.0
CUBE_M: Final = 0.04
TRAY_TOP_M: Final = 0.22
SHELF_TOP_M: Final = 0.20

Tree = dict[str, Any]


@dataclass(frozen=True)
class Cell:
    """A generated cell.

    Attributes:
        seed: Seed of the cell.
        kind: One of `KINDS`.
        file: Tree file.
    """

    seed: int
    kind: str
    file: Tree

    @property
    def arms(self) -> tuple[str, ...]:
        """Names of the arms."""
        return tuple(self.file["arms"])

    def alone(self, arm: str) -> Tree:
        """The same cell in which only one arm moves; the others stay at home."""
        resting = {"tree": {"sequence": ["succeed"]}}
        arms = self.file["arms"].items()
        others = {name: spec if name == arm else spec | resting for name, spec in arms}
        return {**self.file, "arms": others}

    def reversed(self) -> Tree:
        """The same cell with its arms in the opposite order."""
        return {**self.file, "arms": dict(reversed(self.file["arms"].items()))}


class ArmContacts(IdleObserver):
    """Pairs of arms whose bodies touch, with the time of the first contact, s."""

    def __init__(self, world: World) -> None:
        self._world = world
        self.pairs: dict[tuple[str, str], float] = {}

    def after_step(self, time: float) -> None:
        """Record contacts between arms."""
        data = self._world.data
        for first, second in data.contact.geom[data.contact.dist < 0.0].tolist():
            names = [
                name_of_geom(self._world.model, geom).partition("/")[0] for geom in (first, second)
            ]
            if names[0] != names[1] and all(name in self._world.arms for name in names):
                self.pairs.setdefault((min(names), max(names)), time)


def generate(seed: int, reality: str) -> Cell:
    """The cell of a seed."""
    rng = np.random.default_rng(seed)
    kind = str(rng.choice(KINDS))
    count = int(rng.integers(2, 6))
    objects: Tree = {
        "tray": _box((0.36, 0.36, 0.02), (0.0, 0.0, TRAY_TOP_M - 0.01), "white", fixed=True)
    }
    arms: Tree = {}
    start = float(rng.uniform(-math.pi, math.pi))
    for number in range(count):
        bearing = start + 2.0 * math.pi * (number + float(rng.uniform(-0.1, 0.1))) / count
        name = f"arm{number + 1}"
        arms[name] = _arm(name, kind, bearing, objects, rng)
    world = {"scene": "empty", "reality": reality, "seed": seed, "time_limit": LIMIT_S}
    file = {"bt_dualarm": 1, "name": "traffic", "world": world, "objects": objects, "arms": arms}
    return Cell(seed, kind, file)


def _box(size: Sequence[float], xyz: Sequence[float], color: str, *, fixed: bool) -> Tree:
    place = [round(float(one), 4) for one in xyz]
    fields: Tree = {"fixed": True} if fixed else {}
    mass = 1.0 if fixed else 0.1
    return {"shape": "box", "size": [*size], "mass": mass, "color": color, **fields} | {
        "pose": {"xyz": place}
    }


def _arm(name: str, kind: str, bearing: float, objects: Tree, rng: np.random.Generator) -> Tree:
    """An arm that faces the middle from a bearing in rad; adds its objects to ``objects``."""
    robot = str(rng.choice(ROBOTS))
    home = Kinematics(load_robot(robot), Pose.from_rpy((0, 0, 0))).forward(
        load_robot(robot).postures["home"]
    )
    distance = float(home.position[0]) + 0.26  # at home the tool is not above the tray
    outward = np.array((math.cos(bearing), math.sin(bearing)))
    across = np.array((-outward[1], outward[0]))
    base = {
        "xyz": [*np.round(distance * outward, 4).tolist(), 0.0],
        "rpy": [0.0, 0.0, round(math.degrees(bearing) + 180.0, 3)],
    }
    speed = round(float(rng.uniform(0.4, 1.0)), 2)
    if kind == "cross":
        return {"robot": robot, "base": base, "tree": {"sequence": _reaches(rng, speed)}}
    side = 1.0 if rng.random() < 0.5 else -1.0
    shelf = distance * outward + 0.75 * min(distance, 0.55) * side * across
    objects[f"shelf_{name}"] = _box(
        (0.16, 0.16, SHELF_TOP_M), (*shelf, SHELF_TOP_M / 2), "gray", fixed=True
    )
    leaves: list[Any] = []
    for turn in range(int(rng.integers(1, 3))):
        cube = f"cube_{name}_{turn}"
        slot = (0.09 + 0.06 * turn) * outward
        inside = (*slot, TRAY_TOP_M + CUBE_M / 2)
        outside = (*(shelf + (0.08 * turn - 0.04) * outward), SHELF_TOP_M + CUBE_M / 2)
        start, goal = (outside, inside) if kind == "bin" else (inside, outside)
        objects[cube] = _box((CUBE_M,) * 3, start, "red", fixed=False)
        to = {"xyz": [round(float(one), 4) for one in goal]}
        leaves += [
            {"grasp": {"object": cube, "speed": speed}},
            {"place": {"object": cube, "at": to, "speed": speed}},
        ]
    gripper = str(rng.choice(GRIPPERS))
    leaves.append({"go_home": {"speed": speed}})
    return {"robot": robot, "gripper": gripper, "base": base, "tree": {"sequence": leaves}}


def _reaches(rng: np.random.Generator, speed: float) -> list[Any]:
    leaves: list[Any] = []
    for _ in range(3):
        x, y = rng.uniform(-0.2, 0.2, 2).round(4).tolist()
        z = round(float(rng.uniform(0.35, 0.6)), 4)
        to = {"xyz": [x, y, z], "rpy": [180, 0, 0]}
        leaves.append({"reach_to_pose": {"to": to, "speed": speed}})
    return [*leaves, {"go_home": {"speed": speed}}]


def _play(file: Tree, skills: Registry) -> tuple[RunResult, ArmContacts]:
    with Run(load_tree_file(file, skills.kinds), skills, RunOptions(renderer="ray")) as run:
        contacts = ArmContacts(run.world)
        run.watch(contacts)
        return run.finish(), contacts


def _try_play(cell: Cell, skills: Registry) -> tuple[RunResult, ArmContacts] | None:
    """The run of a cell; None if its arms or objects overlap at the start."""
    try:
        return _play(cell.file, skills)
    except DualArmError:
        return None


def _ended_s(result: RunResult) -> float:
    ends = [arm.ended_s for arm in result.arms.values()]
    return max(LIMIT_S if end is None else end for end in ends)


def _codes(result: RunResult) -> dict[str, list[str]]:
    """How each leaf of each arm ended."""
    return {name: [leaf.code for leaf in arm.runs] for name, arm in result.arms.items()}


def _is_feasible(cell: Cell, skills: Registry, alone: dict[str, float]) -> bool:
    """Whether each arm succeeds alone; fills ``alone`` with the durations, s."""
    for arm in cell.arms:
        try:
            result, _ = _play(cell.alone(arm), skills)
        except DualArmError:
            return False
        if result.outcome != "SUCCESS":
            return False
        alone[arm] = _ended_s(result)
    return True


def evaluate(seed: int, reality: str, *, quick: bool, orders: int) -> dict[str, Any]:
    """Outcome of a cell and the lines to print."""
    cell = generate(seed, reality)
    alone: dict[str, float] = {}
    played = _try_play(cell, registry()) if quick else None
    needs_check = played is None or played[0].outcome != "SUCCESS"
    if needs_check and not _is_feasible(cell, registry(), alone):
        return {"outcome": "SKIPPED"}
    result, contacts = played or _play(cell.file, registry())
    found: dict[str, Any] = {"outcome": str(result.outcome), "codes": [], "wrong": 0}
    makespan = ""
    line = f"cell {cell.seed}: {cell.kind}, {len(cell.arms)} arms, {result.outcome}"
    if alone:
        total = sum(alone.values())
        ratio = _ended_s(result) / total
        bound = max(alone.values()) / total
        makespan = f"\n    makespan {ratio:.2f} of one by one, bound {bound:.2f}"
        if result.outcome == "SUCCESS":
            found |= {"ratio": ratio, "bound": bound}
    for arm in result.arms.values():
        for leaf in arm.runs:
            if leaf.status == "FAILURE" and leaf.code:
                found["codes"].append(f"{leaf.skill} {leaf.code}")
                line += f"\n    {arm.name} {leaf.skill}: {leaf.code}: {leaf.reason}"
    line += makespan
    for pair, when in contacts.pairs.items():
        found["wrong"] += 1
        line += f"\n    {when:.3f} s: {pair[0]} touches {pair[1]}"
    if orders == 2:
        again, _ = _play(cell.reversed(), registry())
        if _codes(again) != _codes(result):
            found["wrong"] += 1
            line += "\n    ends differently in reverse order"
    return {**found, "line": line}


def main() -> int:
    """Run the cells; returns the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--cells", type=int, default=20, help="number of cells that count")
    parser.add_argument("--seed", type=int, default=0, help="the first seed")
    parser.add_argument("--reality", default="lab", choices=("ideal", "lab", "rough"))
    parser.add_argument("--orders", type=int, default=1, choices=(1, 2))
    parser.add_argument("--quick", action="store_true", help="no makespans")
    parser.add_argument("--only", type=int, help="run only this seed")
    add_options(parser)
    options = parser.parse_args()
    with Campaign(options) as campaign:
        return run_cells(options, campaign)


def run_cells(options: argparse.Namespace, campaign: Campaign) -> int:
    """Run the cells and print the figures; returns the exit code."""
    only = options.only
    seeds = itertools.count(options.seed) if only is None else iter([only])
    settings = {name: getattr(options, name) for name in ("reality", "quick", "orders")}
    cases = ({"seed": seed, **settings} for seed in seeds)
    counted = complete = wrong = left_out = 0
    codes = Counter[str]()
    ratios: list[float] = []
    bounds: list[float] = []
    for _, found in campaign.run(evaluate, cases, options.cells if only is None else 1):
        if found["outcome"] == "SKIPPED":
            left_out += 1
            continue
        counted += 1
        complete += found["outcome"] == "SUCCESS"
        wrong += found["wrong"]
        codes.update(found["codes"])
        if "ratio" in found:
            ratios.append(found["ratio"])
            bounds.append(found["bound"])
        print(found["line"], flush=True)
    print(f"{counted} cells ({left_out} left out, in which an arm fails even alone)")
    print(f"  complete: {complete} ({complete / max(counted, 1):.0%})")
    if ratios:
        parallel = [ratio for ratio, bound in zip(ratios, bounds, strict=True) if bound <= 0.6]
        print(f"  makespan over one by one: median {statistics.median(ratios):.2f}")
        if parallel:
            share = sum(ratio <= 0.7 for ratio in parallel) / len(parallel)
            print(
                f"  of {len(parallel)} cells with a bound of 0.6 or less: median "
                f"{statistics.median(parallel):.2f}, 0.7 or less in {share:.0%}"
            )
    for code, times in codes.most_common():
        print(f"  {times:4d}  {code}")
    print(f"  contacts between arms and different ends in reverse order: {wrong}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
