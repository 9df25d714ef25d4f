"""The demo beside a third arm: python -m benchmarks.third_arm [PLACES [SEED]].

`pick_and_track` is run with one more arm of the catalog, 1.2 to 3 m from the nearer of the two,
which swings back and forth at full speed. For each base pose of the third arm, prints how the two
arms end, and how much later than without it. Exits with code 1 if one of them fails.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from benchmarks.campaign import Campaign, add_options, registry
from benchmarks.measured_robots import MEASURED
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.core.share import share_dir
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.outcome import RunResult
from bt_dualarm.runtime.run import Run
from bt_dualarm.skill.registry import Registry

PLACES = 10
SEED = 0

NEAREST_M = 1.2
FARTHEST_M = 3.0

LONGEST_S = 60.0
"""Simulated seconds after which a run ends; the demo takes a third of that."""

_BASES = ((0.0, 0.0), (1.6, 0.11))  # x and y of the two arms of the demo, m

_ARM = """
  arm3:
    robot: ROBOT
    base: {xyz: [X, Y, 0.3], rpy: [0, 0, YAW]}
    tree:
      repeat:
        times: 1000
        child:
          sequence:
            - reach_to_pose: {posture: home, speed: 1.0}
            - move_joints: {to: {JOINT: 60}, speed: 1.0}
"""


@dataclass(frozen=True)
class Place:
    """Base pose of the third arm.

    Attributes:
        robot: Name of the robot in the catalog.
        x: Position of its base, m.
        y: Position of its base, m.
        yaw: Rotation of its base, degrees.
    """

    robot: str
    x: float
    y: float
    yaw: float

    @property
    def text(self) -> str:
        """Declaration of the arm."""
        joint = load_robot(self.robot).joints[0]
        values = {"ROBOT": self.robot, "X": self.x, "YAW": self.yaw, "Y": self.y, "JOINT": joint}
        text = _ARM
        for word, value in values.items():
            text = text.replace(word, str(value))
        return text


def places(count: int, seed: int) -> list[Place]:
    """Random base poses around the two arms, with the robots of the catalog in turn."""
    rng = np.random.default_rng(seed)
    found: list[Place] = []
    while len(found) < count:
        base = np.array(_BASES[int(rng.integers(2))])
        angle = rng.uniform(-np.pi, np.pi)
        distance = rng.uniform(NEAREST_M, FARTHEST_M)
        x, y = base + distance * np.array((np.cos(angle), np.sin(angle)))
        if min(np.hypot(x - at[0], y - at[1]) for at in _BASES) < NEAREST_M:
            continue
        robot = MEASURED[len(found) % len(MEASURED)]
        yaw = round(float(rng.uniform(-180, 180)), 1)
        found.append(Place(robot, round(float(x), 3), round(float(y), 3), yaw))
    return found


def run_beside(place: Place | None, skills: Registry) -> RunResult:
    """Result of the demo with or without a third arm."""
    text = (share_dir("trees") / "pick_and_track.yaml").read_text(encoding="utf-8")
    text += "" if place is None else place.text
    options = RunOptions(duration=LONGEST_S, renderer="ray")
    with Run(load_tree_file(text, skills.kinds), skills, options) as run:
        return run.finish()


def failures(result: RunResult) -> list[str]:
    """Sentences about each of the two arms that did not succeed."""
    return [
        f"{name}: {result.arms[name].outcome}; "
        + "; ".join(f"{leaf.path} {leaf.code}: {leaf.reason}" for leaf in result.arms[name].runs)
        for name in ("arm1", "arm2")
        if result.arms[name].outcome != "SUCCESS"
    ]


def evaluate(place: dict[str, Any] | None) -> dict[str, Any]:
    """Times at which the two arms end beside a third one, s, and the failures."""
    result = run_beside(None if place is None else Place(**place), registry())
    wrong = failures(result)
    ends = {name: result.arms[name].ended_s or float("nan") for name in ("arm1", "arm2")}
    return {"outcome": "FAILURE" if wrong else "SUCCESS", "wrong": wrong, "ends": ends}


def main() -> int:
    """Print a line for each base pose; returns the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("places", type=int, nargs="?", default=PLACES)
    parser.add_argument("seed", type=int, nargs="?", default=SEED)
    add_options(parser)
    options = parser.parse_args()
    base_poses = [None, *map(asdict, places(options.places, options.seed))]
    failed = 0
    alone: dict[str, float] = {}
    with Campaign(options) as campaign:
        for number, (case, found) in enumerate(
            campaign.run(evaluate, [{"place": s} for s in base_poses])
        ):
            place = case["place"]
            if place is None:
                alone = found["ends"]
                continue
            failed += bool(found["wrong"])
            later = ", ".join(
                f"{name} {end - alone.get(name, float('nan')):+.2f} s"
                for name, end in found["ends"].items()
            )
            where = f"{place['robot']} at ({place['x']:.2f}, {place['y']:.2f})"
            result = "; ".join(found["wrong"]) or later
            print(f"[{number}/{options.places}] {where}: {result}", flush=True)
        print(f"the demo fails beside {failed} of {options.places} arms")
        return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
