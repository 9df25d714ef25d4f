"""Arms carry loaded containers: success rate, and motion of the contents.

    python -m benchmarks.passengers [--arms 1 2] [--cases 60] [--reality lab] [--seed 0]

With one arm, a bin, tray, cup, bowl, plate or block is grasped, carried past a random pose and set
down at another. With two arms, a tray, a board or a compound with handles is carried together along
a random path. One to three cubes, cans or balls stand on the carrier. Robots with suitable
grippers, masses, poses and the speed (0.5 or 1.0) depend on the seed.

A case counts as carried if the run succeeds, and as refused if the carrier was not lifted. A
success is false if an object is then more than 10 mm lower on the carrier than the lowest one was
at the start. Goals: no false success, and 90 % of the lifted carriers carried; exits with code 1 if
one is missed.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from typing import Any

import numpy as np

import bt_dualarm as bt
from benchmarks.campaign import Campaign, add_options

Tree = dict[str, Any]

HANDS = {
    "ur5": "robotiq_2f85",
    "panda": "panda_hand",
    "xarm7": "robotiq_2f85",
    "ur10": "robotiq_2f85",
    "ur3": "robotiq_2f85",
    "fr3": "panda_hand",
}
TOP = 0.4
"""Height of the table for one arm, m."""

STAND = 0.5
"""Height of the stand between two arms, m."""

REFUSED = ("OUT_OF_REACH", "TOO_HEAVY", "TOO_WIDE", "NO_FACE", "INVALID_TARGET")
FELL_M = 0.010
GOAL_SHARE = 0.9

CARRIERS: dict[str, tuple[str, list[float], float]] = {
    "bin": ("bin", [0.16, 0.12, 0.06], 0.003),
    "tray": ("tray", [0.2, 0.15, 0.03], 0.003),
    "cup": ("cup", [0.037, 0.09], 0.003),
    "bowl": ("bowl", [0.08, 0.05], 0.003),
    "plate": ("box", [0.16, 0.06, 0.02], 0.02),
    "block": ("box", [0.05, 0.05, 0.05], 0.05),
}
"""Carriers for one arm: shape, size in m, and the height on which objects stand, m."""


def rider(kind: str, rng: np.random.Generator, place: list[float], turn: float = 0.0) -> Tree:
    """An object that stands on the carrier's surface at ``place``, x, y and z in m."""
    shapes: dict[str, tuple[str, list[float], float]] = {
        "cube": ("box", [0.03, 0.03, 0.03], 0.015),
        "can": ("cylinder", [0.02, 0.07], 0.035),
        "ball": ("sphere", [0.012], 0.012),
    }
    shape, size, middle = shapes[kind]
    x, y, z = place
    mass = 0.02 if kind == "ball" else float(rng.uniform(0.03, 0.2))
    pose = {"xyz": [x, y, z + middle + 2e-4], "rpy": [0, 0, turn]}
    return {"shape": shape, "size": size, "mass": mass, "pose": pose}


def for_one(seed: int, reality: str) -> Tree:
    """Tree file in which one arm carries a loaded container across a table."""
    rng = np.random.default_rng(seed)
    robot = str(rng.choice(list(HANDS)))
    kind = str(rng.choice(list(CARRIERS)))
    shape, size, floor = CARRIERS[kind]
    near = robot == "ur3"
    x, y = 0.32 if near else 0.42, -0.2
    height = size[-1]
    yaw = float(rng.uniform(-90, 90))
    carrier = {"shape": shape, "size": size, "mass": float(rng.uniform(0.05, 0.15))}
    carrier["pose"] = {"xyz": [x, y, TOP + 0.5 * height], "rpy": [0, 0, yaw]}
    contents = ["ball", "ball"] if kind == "cup" else [str(rng.choice(["cube", "can", "ball"]))]
    if kind in ("plate", "block") and contents == ["ball"]:
        contents = ["cube"]  # it would roll off
    riders = {
        f"rider{i}": rider(one, rng, [x, y, TOP + floor + 0.025 * i], yaw)
        for i, one in enumerate(contents)
    }
    to_x, to_y = float(rng.uniform(0.25, 0.33) if near else rng.uniform(0.35, 0.45)), 0.2
    turn = yaw + float(rng.uniform(-60, 60))
    above = {"xyz": [to_x, 0.1, TOP + 0.2]}
    goal = {"xyz": [to_x, to_y, TOP + 0.5 * height], "rpy": [0, 0, turn]}
    speed = float(rng.choice([0.5, 1.0]))
    leaves_of_arm = [
        {"grasp": {"object": "carrier"}},
        {"transport": {"object": "carrier", "to": above, "speed": speed}},
        {"place": {"object": "carrier", "at": goal}},
    ]
    table = {"shape": "box", "size": [1.2, 0.9, TOP], "mass": 50, "fixed": True}
    return {
        "bt_dualarm": 1,
        "name": f"{robot} {kind} {' '.join(contents)}",
        "world": {"scene": "empty", "reality": reality, "seed": seed, "time_limit": 90},
        "objects": {"table": table | {"pose": {"xyz": [0.5, 0, 0.5 * TOP]}}, "carrier": carrier}
        | riders,
        "arms": {
            "arm1": {
                "robot": robot,
                "gripper": HANDS[robot],
                "base": {"xyz": [0, 0, TOP]},
                "tree": {"sequence": leaves_of_arm},
            }
        },
    }


def for_two(seed: int, reality: str) -> Tree:
    """Tree file in which two arms carry a loaded container together."""
    rng = np.random.default_rng(seed)
    robots = [str(rng.choice([one for one in HANDS if one != "ur3"])) for _ in range(2)]
    kind = str(rng.choice(["tray", "board", "handles"]))
    y = -0.45
    length, width = float(rng.uniform(0.5, 0.65)), float(rng.uniform(0.2, 0.3))
    if kind == "tray":
        carrier: Tree = {"shape": "tray", "size": [length, width, 0.03], "wall": 0.004, "mass": 1.0}
        middle, floor = 0.015, 0.004
    elif kind == "board":
        carrier = {"shape": "box", "size": [length, 0.07, 0.02], "mass": 0.8}
        middle, floor = 0.01, 0.02
    else:
        plate = {"shape": "box", "size": [length, width, 0.02], "pose": {"xyz": [0, 0, -0.025]}}
        bar = {"shape": "box", "size": [0.02, 0.1, 0.06]}
        end = 0.5 * length - 0.03
        parts = {"plate": plate, "left": bar | {"pose": {"xyz": [-end, 0, 0.015]}}}
        parts["right"] = bar | {"pose": {"xyz": [end, 0, 0.015]}}
        carrier = {"shape": "compound", "mass": 1.2, "parts": parts}
        middle, floor = 0.035, 0.02
    low = STAND + middle
    carrier["pose"] = {"xyz": [0, y, low]}
    count = int(rng.integers(1, 4))
    riders = {
        f"rider{i}": rider(str(rng.choice(["cube", "can"])), rng, [float(x), y, STAND + floor])
        for i, x in enumerate(np.linspace(-0.12, 0.12, count) if count > 1 else [0.0])
    }
    speed = float(rng.choice([0.5, 1.0]))
    dx, dy, dz, yaw = rng.uniform((-0.06, -0.05, 0.12, -12), (0.06, 0.05, 0.22, 12)).tolist()
    end_x, end_y, end_yaw = rng.uniform((-0.04, -0.02, -4), (0.04, 0.02, 4)).tolist()
    path = [
        {"xyz": [dx, y + dy, low + dz], "rpy": [0, 0, yaw]},
        {"xyz": [end_x, y + end_y, low], "rpy": [0, 0, end_yaw]},
    ]
    arms = {}
    for i, robot in enumerate(robots):
        ports: Tree = {"object": "carrier", "with": [f"arm{2 - i}"]}
        if i == 0:
            ports |= {"path": path, "speed": speed}
        turn = 0 if robot.startswith("ur") else -90
        arms[f"arm{i + 1}"] = {
            "robot": robot,
            "gripper": HANDS[robot],
            "base": {"xyz": [(-0.6, 0.6)[i], 0, 0.4], "rpy": [0, 0, turn]},
            "tree": {"carry_together": ports},
        }
    stand = {"shape": "box", "size": [0.36, 0.25, STAND], "mass": 50, "fixed": True}
    return {
        "bt_dualarm": 1,
        "name": f"{'+'.join(robots)} {kind} {count}",
        "world": {"scene": "empty", "reality": reality, "seed": seed, "time_limit": 90},
        "objects": {"stand": stand | {"pose": {"xyz": [0, y, 0.5 * STAND]}}, "carrier": carrier}
        | riders,
        "arms": arms,
    }


def carry(arms: int, reality: str, seed: int) -> dict[str, Any]:
    """Simulate a run: its outcome, and how far the objects have moved on the carrier."""
    with bt.open((for_one, for_two)[arms - 1](seed, reality)) as run:
        world = run.world
        names = [name for name in world.objects if name.startswith("rider")]

        def poses_on_carrier() -> dict[str, bt.Pose]:
            from_world = world.object_pose("carrier").inverse
            return {name: from_world @ world.object_pose(name) for name in names}

        run.step(0.5)  # they settle
        before = poses_on_carrier()
        result = run.finish()
        after = poses_on_carrier()
    leaves = [
        leaf for arm in result.arms.values() for leaf in arm.runs if leaf.code not in ("", None)
    ]
    first = min(leaves, key=lambda leaf: leaf.ended_s or 0.0, default=None)
    lifted = first is None or first.code not in REFUSED
    moved = [before[name].distance(after[name]) for name in names]
    # A ball that starts on another one comes to rest beside it.
    low = min(pose.position[2] for pose in before.values()) - FELL_M
    fell = [name for name in names if after[name].position[2] < low]
    return {
        "outcome": "SUCCESS" if first is None or not lifted else "FAILURE",
        "code": "" if first is None else first.code,
        "message": "" if first is None else f"{first.skill}: {first.code}: {first.reason}",
        "name": run.name,
        "lifted": lifted,
        "carried": first is None,
        "moved_m": moved,
        "fell": fell,
        "time_s": result.sim_time_s,
    }


def main() -> int:
    """Print the results; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--arms", type=int, nargs="+", default=[1, 2], choices=[1, 2])
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--reality", default="lab")
    parser.add_argument("--seed", type=int, default=0)
    add_options(parser)
    options = parser.parse_args()
    good = True
    with Campaign(options) as campaign:
        for arms in options.arms:
            cases = [
                {"arms": arms, "reality": options.reality, "seed": options.seed + i}
                for i in range(options.cases)
            ]
            outcomes: Counter[str] = Counter()
            moved: list[float] = []
            false = 0
            for given, found in campaign.run(carry, cases):
                is_carried = found["carried"]
                kind = "carried" if is_carried else found["code"]
                outcomes[kind if found["lifted"] else f"refused: {kind}"] += 1
                if is_carried:
                    moved += found["moved_m"]
                    false += bool(found["fell"])
                if not is_carried or found["fell"]:
                    fell = f"  fell: {', '.join(found['fell'])}" if found["fell"] else ""
                    print(f"  {given['seed']} {found['name']}: {found['message']}{fell}")
            lifted = sum(n for kind, n in outcomes.items() if not kind.startswith("refused"))
            share = outcomes["carried"] / max(lifted, 1)
            millimeters = 1e3 * np.array(moved or [np.nan])
            print(
                f"{arms} arm{'s' if arms > 1 else ''}, {options.reality}: {outcomes['carried']} of "
                f"{lifted} that were lifted were carried ({100 * share:.0f} %), false successes: "
                f"{false}; objects moved on them by {np.median(millimeters):.1f} mm (median), "
                f"{np.quantile(millimeters, 0.95):.1f} mm (95 %)"
            )
            print(f"  {dict(outcomes)}")
            good &= share >= GOAL_SHARE and not false
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
