"""Slip detection: pulls at a carried box, detection delay, boxes kept, false alarms.

    python -m benchmarks.pulls [--pulls 20] [--quiet 60] [--seed 0] [--robot ur5]
                               [--gripper robotiq_2f85] [--reality lab] [--times 1.2]

A box of 0.1 to 0.8 kg is carried back and forth as fast as the arm allows. At a random moment a
force in a random direction pulls at it for 0.1 s, ``--times`` as large as the holding force: that
is the friction of the pads for fingers, and for a suction cup what it bears in that direction (away
from it or across it). The delay is the time until the arm detects the slip (`slips_felt`) or the
leaf fails. In ``--quiet`` seconds of the same motion without pulls, each detection is a false
alarm. Exits with code 1 if a pull was detected later than after 50 ms or not at all, or after a
false alarm.
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from itertools import cycle, islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import numpy as np
import yaml

from benchmarks.campaign import Campaign, add_options, registry
from bt_dualarm.arm.payload import cup_measures
from bt_dualarm.arm.slip_response import SlipResponse
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.grasping.grasp import suction_forces
from bt_dualarm.robots.gripper import load_gripper
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry

PULL_S = 0.1
"""Seconds for which a pull lasts."""

SOON_S = 0.05
"""Goal for the detection delay, s."""

POST_M = 0.08
"""Height in m of the post under a box for a suction cup."""

POST = {
    "shape": "box",
    "size": [0.04, 0.04, POST_M],
    "mass": 1.0,
    "fixed": True,
    "pose": {"xyz": [0.45, -0.40, 0.40 + POST_M / 2]},
}

PLACES = ((0.30, -0.45, 0.70), (0.40, -0.20, 0.60), (0.45, -0.40, 0.62), (0.20, -0.55, 0.65))
"""Positions between which the box is carried, m."""


@dataclass
class Puller(IdleObserver):
    """Pulls once, and records when the arm detects a slip.

    Attributes:
        after: Simulated seconds from the grasp to the pull; infinite for none.
        times: Force of the pull as a multiple of the holding force.
        direction: Direction of the pull in the world, of shape (3,).
        began: Simulated time at which the box was grasped, s.
        pulled: Simulated time of the pull, s.
        detected: Simulated times of slip detections, s.
        held_s: Time for which the box has been held, s.
        run: The run.
        slip: The arm's slip response.
    """

    after: float
    times: float
    direction: np.ndarray
    began: float | None = None
    pulled: float | None = None
    detected: list[float] = field(default_factory=list)
    held_s: float = 0.0
    run: Run = field(init=False)
    slip: SlipResponse | None = None
    _detections: int = 0

    def after_step(self, time: float) -> None:
        """Pull, and record slip detections."""
        world = self.run.world
        held = world.attachments.find("arm1", "box")
        if self.slip is not None and self.slip.felt > self._detections:
            self._detections = self.slip.felt
            self.detected.append(time)
        if held is not None:
            self.began = time if self.began is None else self.began
            self.held_s = time - self.began
            if self.pulled is None and self.held_s >= self.after:
                self.pulled = time
                self._pull(self.times * holding_force(world, self.direction))
        if self.pulled is not None and time - self.pulled > PULL_S:
            self._pull(0.0)

    def _pull(self, newton: float) -> None:
        world = self.run.world
        world.data.xfrc_applied[world.object_body("box"), :3] = newton * self.direction


def holding_force(world: World, direction: np.ndarray) -> float:
    """Largest force in N that the gripper can hold in a direction of shape (3,)."""
    hardware = world.grippers["arm1"]
    obj = world.objects["box"]
    spec = hardware.gripper
    commanded_n = hardware.commanded.force
    if spec.fingers:
        return 2.0 * max(spec.friction, obj.friction) * commanded_n
    forces = (world.arms["arm1"].tool_pose.rotation_matrix.T @ direction)[None]
    cup = cup_measures(spec, obj.friction)
    back = np.array((0.0, 0.0, -1.0))
    return commanded_n / float(suction_forces(forces, np.zeros(3), back, cup)[0])


def watch_slip(puller: Puller) -> AbstractContextManager[object]:
    """Context in which the puller knows the arm's slip response."""
    look = SlipResponse.look

    def look_and_record(slip: SlipResponse) -> None:
        puller.slip = slip
        look(slip)

    return patch.object(SlipResponse, "look", look_and_record)


def task(options: argparse.Namespace, rng: np.random.Generator, carries: int) -> dict[str, Any]:
    """The tree file of one run."""
    cup = load_gripper(options.gripper).cup
    least = 0.035 if cup is None else 2.0 * cup.radius + 0.005
    edges = [float(edge) for edge in rng.uniform(least, 0.06, 3)]
    high = 0.0 if cup is None else POST_M  # a cup is short: the arm would touch the table
    pose = {"xyz": [0.45, -0.40, 0.4005 + high + edges[2] / 2]}
    box = {"shape": "box", "size": edges, "mass": float(rng.uniform(0.1, 0.8)), "pose": pose}
    carry: Iterator[Any] = islice(cycle(PLACES), carries)
    leaves = [
        {"transport": {"object": "box", "to": {"xyz": list(to)}, "speed": 1.0}} for to in carry
    ]
    base = {"xyz": [0.0, 0.0, 0.40]}
    arm = {"robot": options.robot, "gripper": options.gripper, "base": base}
    return {
        "bt_dualarm": 1,
        "name": "pulls",
        "world": {"scene": "table", "reality": options.reality, "time_limit": 600},
        "objects": {"box": box} | ({} if cup is None else {"post": POST}),
        "arms": {"arm1": arm | {"tree": {"sequence": [{"grasp": {"object": "box"}}, *leaves]}}},
    }


def play(
    options: argparse.Namespace, seed: int, skills: Registry, *, pulls: bool, carries: int
) -> tuple[Puller, str]:
    """Play one run; returns its puller, and ``kept`` or the code of the failure."""
    rng = np.random.default_rng(seed)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "pulls.yaml"
        path.write_text(yaml.safe_dump(task(options, rng, carries)), encoding="utf-8")
        file = load_tree_file(path, skills.kinds)
        direction = rng.normal(size=3)
        direction[2] = -abs(direction[2])  # away from a cup
        after = float(rng.uniform(1.0, 5.0)) if pulls else np.inf
        puller = Puller(after, options.times, direction / np.linalg.norm(direction))
        with watch_slip(puller):
            run = puller.run = Run(file, skills, RunOptions(seed=seed, renderer="ray"))
            run.watch(puller)
            with run:
                result = run.finish()
    failed = [leaf for leaf in result.arms["arm1"].leaves.values() if leaf.status == "FAILURE"]
    return puller, str(failed[0].code) if failed else "kept"


def carry_box(seed: int, *, pulls: bool, carries: int, **settings: Any) -> dict[str, Any]:
    """Times of the pull and of its detections, s, and how the run ended."""
    puller, end = play(
        argparse.Namespace(**settings), seed, registry(), pulls=pulls, carries=carries
    )
    return {
        "outcome": "SUCCESS" if end == "kept" else "FAILURE",
        "code": end,
        "pulled": puller.pulled,
        "answered": puller.detected,
        "held_s": puller.held_s,
    }


def main() -> int:
    """Pull, carry without pulls, print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--pulls", type=int, default=20)
    parser.add_argument("--quiet", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--robot", default="ur5")
    parser.add_argument("--gripper", default="robotiq_2f85")
    parser.add_argument("--reality", default="lab")
    parser.add_argument("--times", type=float, default=1.2)
    add_options(parser)
    options = parser.parse_args()
    with Campaign(options) as campaign:
        return run_both(options, campaign)


def run_both(options: argparse.Namespace, campaign: Campaign) -> int:
    """Pull, carry without pulls, and print the figures; returns the exit code."""
    delays = []
    ends = []
    settings = {name: getattr(options, name) for name in ("robot", "gripper", "reality", "times")}
    seeds = range(options.seed, options.seed + options.pulls)
    cases = [{"seed": seed, "pulls": True, "carries": 8, **settings} for seed in seeds]
    for case, found in campaign.run(carry_box, cases):
        end, pulled = found["code"], found["pulled"]
        if pulled is None:
            ends.append(f"not pulled: {end}")
            continue
        delay = next((at - pulled for at in found["answered"] if at >= pulled), np.inf)
        delays.append(delay)
        ends.append(end)
        print(f"seed {case['seed']}: detected after {1e3 * delay:.0f} ms, {end}", flush=True)
    quiet_s = 0.0
    alarms = 0
    later = itertools.count(options.seed + options.pulls)
    free = ({"seed": seed, "pulls": False, "carries": 24, **settings} for seed in later)
    enough = options.quiet <= 0.0
    for case, found in () if enough else campaign.run(carry_box, free, wanted=math.inf):
        end, detected = found["code"], found["answered"]
        quiet_s = quiet_s + found["held_s"]
        alarms = alarms + len(detected)
        if detected or end != "kept":
            print(f"seed {case['seed']}, no pull: {len(detected)} alarms, {end}", flush=True)
        if quiet_s >= options.quiet or not found["held_s"]:
            break
    soon = sum(delay <= SOON_S for delay in delays)
    counts = {end: ends.count(end) for end in sorted(set(ends))}
    print(f"{options.robot}, {options.gripper}, {options.reality}: {soon} of {len(delays)} pulls")
    print(
        f"  detected within 50 ms, median {1e3 * float(np.median(delays or [np.inf])):.0f} ms; "
        f"{counts}"
    )
    print(f"  {alarms} false alarms in {quiet_s:.0f} s of carrying")
    return 1 if soon < len(delays) or alarms else 0


if __name__ == "__main__":
    sys.exit(main())
