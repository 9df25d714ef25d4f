"""Insertion by touch of a 20 mm peg into a 20.5 mm hole up to 1.5 mm beside its declared position.

    python -m benchmarks.inserting [--runs 10] [--seed 0] [--robot ur5] [--gripper robotiq_2f85]
                                   [--reality lab] [--shape cylinder]

Also prints the largest true contact forces on the peg: while its end is at the rim, and while it is
in the hole, by walls and bottom. Exits with code 1 if a run ends with SUCCESS although the peg is
truly not in the hole.
"""

from __future__ import annotations

import argparse
import sys
from typing import Any

import mujoco
import numpy as np

import bt_dualarm as bt
from benchmarks.campaign import Campaign
from benchmarks.grip_arguments import grip_cases, grip_parser
from bt_dualarm.core.pose import Vector
from bt_dualarm.sim.world import World

TABLE = 0.40
"""Height of the table's top, m."""

WIDE = 0.0205
HIGH = 0.02
THICK = 0.03
"""Width of the hole, height and thickness of the walls around it, m."""

DECLARED = (0.30, -0.48)
"""Declared position of the hole, x and y, m."""

OFF_M = 0.0015
"""Largest distance of the hole from its declared position, m."""

DEEP_M = 0.001
"""Height above the bottom above which the peg is not in the hole, m."""


RIM_M = 0.0006
"""Depth below the rim, m, up to which the peg is at the rim; beyond it, `insert` pushes it in."""

NEAR_M = 0.01
"""Distance from the declared position, m, within which contacts are those of insertion."""


class ContactForces:
    """Largest contact forces on the peg at its hole.

    Attributes:
        rim_n, hole_n: Largest force at the rim and in the hole, N.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._peg = world.payload_geoms("peg")
        self._arm = world.arms["arm1"].geom_ids
        self._force = np.empty(6)
        self.rim_n = self.hole_n = 0.0
        world.on_forces.append(self._measure)

    def _measure(self) -> None:
        end = self._world.object_pose("peg").position - (0.0, 0.0, 0.04)
        if np.linalg.norm(end[:2] - DECLARED) > NEAR_M:
            return
        data = self._world.data
        total = np.zeros(3)
        for number, pair in enumerate(data.contact.geom.tolist()):
            if self._peg & set(pair) and not self._arm & set(pair):
                mujoco.mj_contactForce(self._world.model, data, number, self._force)
                axes = data.contact.frame[number].reshape(3, 3)
                total += (1.0 if pair[1] in self._peg else -1.0) * (self._force[:3] @ axes)
        force = float(np.linalg.norm(total))
        if end[2] > TABLE + HIGH - RIM_M:
            self.rim_n = max(self.rim_n, force)
        else:
            self.hole_n = max(self.hole_n, force)


def walls(middle: Vector) -> dict[str, Any]:
    """Four fixed blocks around a hole with a center of shape (2,), m."""
    x, y = (float(value) for value in middle)
    beside = (WIDE + THICK) / 2
    length = WIDE + 2 * THICK
    blocks = {
        "right": ([x + beside, y], [THICK, length]),
        "left": ([x - beside, y], [THICK, length]),
        "back": ([x, y + beside], [WIDE, THICK]),
        "front": ([x, y - beside], [WIDE, THICK]),
    }
    return {
        name: {
            "shape": "box",
            "size": [*size, HIGH],
            "mass": 1.0,
            "fixed": True,
            "pose": {"xyz": [*place, TABLE + HIGH / 2]},
        }
        for name, (place, size) in blocks.items()
    }


def task(options: argparse.Namespace, seed: int) -> tuple[dict[str, Any], float]:
    """The tree file of one run, and the distance of the hole from its declared position, m."""
    rng = np.random.default_rng(seed)
    offset = OFF_M * float(np.sqrt(rng.uniform()))
    turn = float(rng.uniform(0.0, 2.0 * np.pi))
    declared = np.array(DECLARED)
    hole = declared + offset * np.array((np.cos(turn), np.sin(turn)))
    size = [0.01, 0.08] if options.shape == "cylinder" else [0.02, 0.02, 0.08]
    pose = {"xyz": [0.45, -0.40, TABLE + 0.0405], "rpy": [0, 0, 0]}
    peg = {"shape": options.shape, "size": size, "mass": 0.15, "friction": 0.6, "pose": pose}
    at = {"xyz": [*declared.tolist(), TABLE + 0.04], "rpy": [0, 0, 0]}
    leaves = [{"grasp": {"object": "peg"}}, {"insert": {"object": "peg", "at": at, "depth": HIGH}}]
    arm = {"robot": options.robot, "gripper": options.gripper, "base": {"xyz": [0, 0, TABLE]}}
    file = {
        "bt_dualarm": 1,
        "name": "inserting",
        "world": {"scene": "table", "reality": options.reality, "seed": seed, "time_limit": 400},
        "objects": {"peg": peg, **walls(hole)},
        "arms": {"arm1": arm | {"tree": {"sequence": leaves}}},
    }
    return file, offset


def insert(seed: int, **settings: str) -> dict[str, Any]:
    """Outcome of one run, with the offset of the hole and the true depth of the peg."""
    file, offset = task(argparse.Namespace(**settings), seed)
    with bt.open(file) as run:
        pressed = ContactForces(run.world)
        leaf = run.finish().arms["arm1"].runs[-1]
        height = float(run.world.object_pose("peg").position[2]) - TABLE - 0.04
    is_in = leaf.skill == "insert" and leaf.status == "SUCCESS"
    return {
        "outcome": "SUCCESS" if is_in else "FAILURE",
        "code": leaf.code,
        "message": "in" if is_in else f"{leaf.skill} {leaf.code}: {leaf.reason}",
        "off_m": offset,
        "height_m": height,
        "places": leaf.metrics.get("search_places", ""),
        "seconds": (leaf.ended_s or 0.0) - leaf.started_s,
        "rim_n": pressed.rim_n,
        "hole_n": pressed.hole_n,
    }


def main() -> int:
    """Run all cases and print the figures; returns 1 after a false SUCCESS."""
    parser = grip_parser(__doc__, 10)
    parser.add_argument("--shape", default="cylinder", choices=["cylinder", "box"])
    options = parser.parse_args()
    seconds = []
    forces = []
    false = 0
    with Campaign(options) as campaign:
        for case, found in campaign.run(insert, grip_cases(options, "shape")):
            is_in = found["outcome"] == "SUCCESS"
            false += is_in and found["height_m"] > DEEP_M
            if is_in:
                seconds.append(found["seconds"])
                forces.append((found["rim_n"], found["hole_n"]))
            head = f"seed {case['seed']}: {1e3 * found['off_m']:.2f} mm offset, {found['places']}"
            felt = f"{found['rim_n']:.1f} N at the rim, {found['hole_n']:.1f} N in the hole"
            print(
                f"{head} places, {found['seconds']:.0f} s, {felt}, {found['message']}", flush=True
            )
        middle = float(np.median(seconds)) if seconds else float("nan")
        rim, hole = np.median(forces, axis=0).tolist() if forces else (float("nan"), float("nan"))
        print(
            f"{options.robot}, {options.gripper}, {options.reality}, {options.shape}: "
            f"{len(seconds)} of {options.runs} in, median {middle:.1f} s, {rim:.1f} N at the rim "
            f"and {hole:.1f} N in the hole, {false} false"
        )
        return 1 if false else 0


if __name__ == "__main__":
    sys.exit(main())
