"""Insertion by touch of a 20 mm peg into a 20.5 mm hole up to 1.5 mm beside its declared position.

    python -m benchmarks.inserting [--runs 10] [--seed 0] [--robot ur5] [--gripper robotiq_2f85]
                                   [--reality lab] [--shape cylinder] [--direction down]

The hole is on the table, or, with another direction than down, in a block 0.3 m above it.

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
from scipy.spatial.transform import Rotation

import bt_dualarm as bt
from benchmarks.campaign import Campaign
from benchmarks.grip_arguments import grip_cases, grip_parser
from bt_dualarm import HoleAxes
from bt_dualarm.core.pose import Pose
from bt_dualarm.sim.world import World

TABLE = 0.40
"""Height of the table's top, m."""

WIDE = 0.0205
HIGH = 0.02
THICK = 0.03
"""Width of the hole, height and thickness of the walls around it, m."""

DECLARED = (0.30, -0.48, TABLE)
"""Declared position of the bottom of the hole on the table, m."""

RAISED = (0.45, -0.35, TABLE + 0.3)
"""The same of the hole in a block above the table."""

DIRECTIONS = {
    "down": (0.0, 0.0, -1.0),
    "forward": (1.0, 0.0, 0.0),
    "right": (0.0, -1.0, 0.0),
    "left": (0.0, 1.0, 0.0),
    "sloping": (0.5, -0.7, -0.4),
    "rising": (0.7, -0.4, 0.5),
}
"""Directions of insertion, world axes."""

LONG = 0.08
"""Length of the peg, m."""

OFF_M = 0.0015
"""Largest distance of the hole from its declared position, m."""

DEEP_M = 0.001
"""Height above the bottom above which the peg is not in the hole, m."""


RIM_M = 0.0006
"""Depth below the rim, m, up to which the peg is at the rim; beyond it, `insert` pushes it in."""

NEAR_M = 0.01
"""Distance from the declared axis, m, within which contacts are those of insertion."""


def declared_hole(direction: str) -> tuple[Pose, HoleAxes]:
    """Pose of the inserted peg, by the declared position of the hole, and the axes of the hole."""
    inward = np.array(DIRECTIONS[direction])
    inward /= np.linalg.norm(inward)
    turn, _ = Rotation.align_vectors(inward, DIRECTIONS["down"])
    bottom = np.array(DECLARED if direction == "down" else RAISED)
    return Pose(bottom - LONG / 2 * inward, turn.as_quat(scalar_first=True)), HoleAxes(inward)


class ContactForces:
    """Largest contact forces on the peg at its hole.

    Args:
        world: World with the peg.
        direction: Name of the direction of insertion.

    Attributes:
        rim_n, hole_n: Largest force at the rim and in the hole, N.
    """

    def __init__(self, world: World, direction: str) -> None:
        self._world = world
        self._goal, self._axes = declared_hole(direction)
        self._peg = world.payload_geoms("peg")
        self._arm = world.arms["arm1"].geom_ids
        self._force = np.empty(6)
        self.rim_n = self.hole_n = 0.0
        world.on_forces.append(self._measure)

    @property
    def height(self) -> float:
        """True height of the peg above the bottom of the hole, m."""
        return self._axes.offset(self._world.object_pose("peg"), self._goal)[1]

    def _measure(self) -> None:
        beside, height = self._axes.offset(self._world.object_pose("peg"), self._goal)
        if np.linalg.norm(beside) > NEAR_M:
            return
        data = self._world.data
        total = np.zeros(3)
        for number, pair in enumerate(data.contact.geom.tolist()):
            if self._peg & set(pair) and not self._arm & set(pair):
                mujoco.mj_contactForce(self._world.model, data, number, self._force)
                axes = data.contact.frame[number].reshape(3, 3)
                total += (1.0 if pair[1] in self._peg else -1.0) * (self._force[:3] @ axes)
        force = float(np.linalg.norm(total))
        if height > HIGH - RIM_M:
            self.rim_n = max(self.rim_n, force)
        else:
            self.hole_n = max(self.hole_n, force)


def walls(bottom: Pose, *, closed: bool) -> dict[str, Any]:
    """Four fixed blocks around a hole, and one below it if it is closed.

    Args:
        bottom: Pose of the bottom of the hole, whose z axis points out of it.
        closed: Whether there is a fifth block below it.
    """
    beside = (WIDE + THICK) / 2
    length = WIDE + 2 * THICK
    blocks = {
        "right": ([beside, 0.0, HIGH / 2], [THICK, length, HIGH]),
        "left": ([-beside, 0.0, HIGH / 2], [THICK, length, HIGH]),
        "back": ([0.0, beside, HIGH / 2], [WIDE, THICK, HIGH]),
        "front": ([0.0, -beside, HIGH / 2], [WIDE, THICK, HIGH]),
    }
    if closed:
        blocks["end"] = ([0.0, 0.0, -HIGH / 2], [length, length, HIGH])
    return {
        name: {
            "shape": "box",
            "size": size,
            "mass": 1.0,
            "fixed": True,
            "pose": written(bottom.shifted(bottom.rotation_matrix @ np.array(place))),
        }
        for name, (place, size) in blocks.items()
    }


def written(pose: Pose) -> dict[str, list[float]]:
    """A pose as in a tree file."""
    return {"xyz": pose.position.tolist(), "quat": pose.quaternion.tolist()}


def task(options: argparse.Namespace, seed: int) -> tuple[dict[str, Any], float]:
    """The tree file of one run, and the distance of the hole from its declared position, m."""
    rng = np.random.default_rng(seed)
    offset = OFF_M * float(np.sqrt(rng.uniform()))
    turn = float(rng.uniform(0.0, 2.0 * np.pi))
    goal, axes = declared_hole(options.direction)
    beside = offset * np.array((np.cos(turn), np.sin(turn)))
    bottom = axes.pose(goal, beside, -LONG / 2)
    is_down = options.direction == "down"
    size = [0.01, LONG] if options.shape == "cylinder" else [0.02, 0.02, LONG]
    place = [0.45, -0.40] if is_down else [0.20, -0.45]
    pose = {"xyz": [*place, TABLE + 0.0005 + LONG / 2], "rpy": [0, 0, 0]}
    peg = {"shape": options.shape, "size": size, "mass": 0.15, "friction": 0.6, "pose": pose}
    insert = {"object": "peg", "at": written(goal), "depth": HIGH}
    grasp: dict[str, Any] = {"object": "peg"}
    if not is_down:
        insert["direction"] = (-axes.out).tolist()
        grasp["then_at"] = written(goal)
    leaves = [{"grasp": grasp}, {"insert": insert}]
    arm = {"robot": options.robot, "gripper": options.gripper, "base": {"xyz": [0, 0, TABLE]}}
    file = {
        "bt_dualarm": 1,
        "name": "inserting",
        "world": {"scene": "table", "reality": options.reality, "seed": seed, "time_limit": 400},
        "objects": {"peg": peg, **walls(bottom, closed=not is_down)},
        "arms": {"arm1": arm | {"tree": {"sequence": leaves}}},
    }
    return file, offset


def insert(seed: int, **settings: str) -> dict[str, Any]:
    """Outcome of one run, with the offset of the hole and the true depth of the peg."""
    file, offset = task(argparse.Namespace(**settings), seed)
    with bt.open(file) as run:
        pressed = ContactForces(run.world, settings["direction"])
        leaf = run.finish().arms["arm1"].runs[-1]
        height = pressed.height
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
    parser.add_argument("--direction", default="down", choices=list(DIRECTIONS))
    options = parser.parse_args()
    seconds = []
    forces = []
    false = 0
    with Campaign(options) as campaign:
        for case, found in campaign.run(insert, grip_cases(options, "shape", "direction")):
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
            f"{options.robot}, {options.gripper}, {options.reality}, {options.shape}, "
            f"{options.direction}: "
            f"{len(seconds)} of {options.runs} in, median {middle:.1f} s, {rim:.1f} N at the rim "
            f"and {hole:.1f} N in the hole, {false} false"
        )
        return 1 if false else 0


if __name__ == "__main__":
    sys.exit(main())
