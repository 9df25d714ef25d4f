"""Arms that cross among obstacles, with rods in hand: python -m benchmarks.crossing [RUNS [SEED]].

Each run is random: two robots of the catalog face each other, with some blocks between them, and
half of the arms first take a rod. Both arms reach for poses in the box between them and go home,
with random values of `patience` and `speed`. Prints each leaf that ended with an exception, each
unexpected contact of arms, held objects and obstacles, and the number of leaves by code.

Exits with code 1 after an exception or a contact.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from typing import Any

import numpy as np

from benchmarks.campaign import Campaign, add_options, registry
from benchmarks.measured_robots import MEASURED
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.core.errors import DualArmError, Failure
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

RUNS = 60
SEED = 0

DEPTH_M = 5e-4
"""Depth above which contacts count; resting objects overlap by less, m."""

START_S = 0.004
"""Time until which a contact means that the arms overlap at the start, s."""

_HEAD = """bt_dualarm: 1
name: crossing
world: {scene: empty, time_limit: 120}
objects:
"""
_REACHES = 5  # number of leaves per arm


class UnexpectedContacts(IdleObserver):
    """Unexpected contacts between pairs of shapes, with the times of the first ones, s."""

    def __init__(self, world: World) -> None:
        self.first_s: dict[tuple[str, str], float] = {}
        self._world = world
        self._generation = -1
        self._movers = np.zeros(0, dtype=bool)
        self._owner: list[str] = []

    def after_step(self, time: float) -> None:
        """Record unexpected contacts."""
        world = self._world
        if self._generation != world.generation:
            self._read_world()
        data = world.data
        if not data.ncon:
            return
        geoms = data.contact.geom
        deep = data.contact.dist < -DEPTH_M
        for first, second in geoms[deep & self._movers[geoms].any(axis=1)].tolist():
            if self._owner[first] != self._owner[second] and not self._is_expected(first, second):
                pair = sorted(name_of_geom(world.model, geom) for geom in (first, second))
                self.first_s.setdefault((pair[0], pair[1]), time)

    def _read_world(self) -> None:
        world = self._world
        self._generation = world.generation
        self._owner = [name_of_geom(world.model, geom) for geom in range(world.model.ngeom)]
        self._movers = np.zeros(world.model.ngeom, dtype=bool)
        self._tools: dict[int, str] = {}
        for name, body in world.arms.items():
            self._movers[list(body.geom_ids)] = True
            self._tools |= dict.fromkeys(body.tool_geom_ids, name)

    def _is_expected(self, first: int, second: int) -> bool:
        """Whether one shape is the tool of an arm and the other one its rod."""
        names = {self._owner[first], self._owner[second]}
        arms = {self._tools.get(geom, "") for geom in (first, second)}
        return any(f"rod_{arm}" in names for arm in arms if arm)


def obstacles(rng: np.random.Generator, gap: float) -> str:
    """Blocks between two arms whose bases are ``gap`` m apart, as text."""
    text = ""
    for number in range(int(rng.integers(1, 5))):
        x = round(float(rng.uniform(0.3, 0.7) * gap), 3)
        y = round(float(rng.uniform(-0.45, 0.45)), 3)
        height = round(float(rng.uniform(0.1, 0.7)), 3)
        side = round(float(rng.uniform(0.03, 0.15)), 3)
        text += (
            f"  block{number}: {{shape: box, size: [{side}, {side}, {height}], mass: 5,"
            f" fixed: true, pose: {{xyz: [{x}, {y}, {height / 2}]}}}}\n"
        )
    return text


def rod(name: str, kinematics: Kinematics, rng: np.random.Generator) -> tuple[str, str]:
    """A stand beside an arm with a rod on it, and the leaf that takes it, as text."""
    length = round(float(rng.uniform(0.1, 0.4)), 3)
    base = kinematics.base.position
    side = 1.0 if rng.random() < 0.5 else -1.0
    x = round(float(base[0]), 3)
    y = round(float(base[1]) + 0.45 * side, 3)
    height = 0.25
    text = (
        f"  stand_{name}: {{shape: box, size: [0.06, 0.06, {height}], mass: 5, fixed: true,"
        f" pose: {{xyz: [{x}, {y}, {height / 2}]}}}}\n"
        f"  rod_{name}: {{shape: box, size: [0.03, 0.03, {length}], mass: 0.2,"
        f" pose: {{xyz: [{x}, {y}, {height + length / 2 + 0.0005}]}}}}\n"
    )
    leaf = f"        - approach_and_attach: {{object: rod_{name}}}\n"
    return text, leaf


def reaches(kinematics: Kinematics, gap: float, rng: np.random.Generator) -> list[str]:
    """Leaves that reach for poses between the arms, or sometimes for home."""
    leaves: list[str] = []
    home = kinematics.robot.postures["home"]
    while len(leaves) < _REACHES:
        patience = round(float(rng.choice((0.5, 4.0, 20.0))), 1)
        speed = round(float(rng.uniform(0.1, 1.0)), 2)
        yielding = str(bool(rng.random() < 0.5)).lower()
        if rng.random() < 0.2:
            leaves.append(f"go_home: {{speed: {speed}}}")
            continue
        place = (rng.uniform(0.35, 0.65) * gap, rng.uniform(-0.4, 0.4), rng.uniform(0.2, 0.8))
        turn = np.radians(rng.uniform((150, -30, -180), (210, 30, 180)))
        pose = Pose.from_rpy(np.round(place, 4).tolist(), turn.tolist())
        try:
            kinematics.solve(pose, home)
        except Failure:
            continue
        to = f"{{xyz: {pose.position.tolist()}, quat: {pose.quaternion.tolist()}}}"
        leaves.append(
            f"reach_to_pose: {{to: {to}, patience: {patience}, speed: {speed}, "
            f"give_way: {yielding}}}"
        )
    return leaves


def tree(seed: int) -> str:
    """A tree file in which two arms cross."""
    rng = np.random.default_rng(seed)
    gap = round(float(rng.uniform(0.9, 1.2)), 3)
    objects = obstacles(rng, gap)
    arms = ""
    for name, x, yaw in (("arm1", 0.0, 0.0), ("arm2", gap, 180.0)):
        robot = str(rng.choice(MEASURED))
        base = Pose.from_rpy((x, 0.0, 0.0), (0.0, 0.0, np.radians(yaw)))
        kinematics = Kinematics(load_robot(robot), base)
        leaves = ""
        if rng.random() < 0.5:
            text, leaves = rod(name, kinematics, rng)
            objects += text
        for leaf in reaches(kinematics, gap, rng):
            leaves += f"        - force_success: {{child: {{{leaf}}}}}\n"
        arms += (
            f"  {name}:\n    robot: {robot}\n    base: {{xyz: [{x}, 0, 0], rpy: [0, 0, {yaw}]}}\n"
            f"    tree:\n      sequence:\n{leaves}"
        )
    return f"{_HEAD}{objects}arms:\n{arms}"


def run(seed: int, skills: Registry) -> tuple[RunResult, UnexpectedContacts]:
    """Result of one run, and its unexpected contacts."""
    file = load_tree_file(tree(seed), skills.kinds)
    with Run(file, skills, RunOptions(seed=seed)) as opened:
        contacts = UnexpectedContacts(opened.world)
        opened.watch(contacts)
        return opened.finish(), contacts


def evaluate(seed: int) -> dict[str, Any]:
    """Outcome of a run: the codes of its leaves, and violations as sentences."""
    try:
        result, contacts = run(seed, registry())
    except DualArmError as error:  # a block overlaps an arm or a stand
        messages = [f"run {seed} refused: {str(error).splitlines()[0]}"]
        return {"outcome": "SKIPPED", "wrong": 0, "codes": [], "message": messages}
    messages = [
        f"run {seed} {arm.name} {leaf.skill} {leaf.started_s:.1f}: {leaf.reason}"
        for arm in result.arms.values()
        for leaf in arm.runs
        if leaf.code == "EXCEPTION"
    ]
    wrong = len(messages)
    if any(when <= START_S for when in contacts.first_s.values()):
        messages.append(f"run {seed} left out: the arms overlap at the start")
    else:
        wrong += len(contacts.first_s)
        for (first, second), when in contacts.first_s.items():
            messages.append(f"run {seed} {when:.3f} s: {first} touches {second}")
    codes = [leaf.code or leaf.status for arm in result.arms.values() for leaf in arm.runs]
    outcome = "FAILURE" if wrong else "SUCCESS"
    return {"outcome": outcome, "wrong": wrong, "codes": codes, "message": messages}


def main() -> int:
    """Print the outcomes of all runs; returns the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("runs", type=int, nargs="?", default=RUNS)
    parser.add_argument("seed", type=int, nargs="?", default=SEED)
    add_options(parser)
    options = parser.parse_args()
    codes: Counter[str] = Counter()
    wrong = refused = 0
    began = time.perf_counter()
    seeds = range(options.seed, options.seed + options.runs)
    with Campaign(options) as campaign:
        for _, found in campaign.run(evaluate, [{"seed": seed} for seed in seeds]):
            refused += found["outcome"] == "SKIPPED"
            wrong += found["wrong"]
            codes.update(found["codes"])
            for line in found["message"]:
                print(line, flush=True)
        print(f"{options.runs} runs, {refused} refused, {time.perf_counter() - began:.0f} s")
        print(", ".join(f"{code} {count}" for code, count in codes.most_common()))
        print(f"exceptions and contacts: {wrong}")
        return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
