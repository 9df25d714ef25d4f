"""How hard things are set down, by what the arm feels and by what truly presses on the ground.

    python -m benchmarks.placing [--runs 10] [--seed 0] [--robot ur5] [--gripper robotiq_2f85]
                                 [--reality lab]

Each run is one thing of 0.05 to 1.5 kg (for a cup: 0.8 kg) that is grasped and placed elsewhere.
``felt`` is ``impact_n``; ``true`` the largest force between thing and ground until the gripper
opens; ``after`` that until the end, less the thing's weight. Exit code 1 if one is not placed.
"""

from __future__ import annotations

import argparse
import sys
from typing import Any

import mujoco
import numpy as np

import bt_dualarm as bt
from benchmarks.grip_arguments import grip_parser
from bt_dualarm.runtime.parts import IdleObserver
from bt_dualarm.tree.report import LeafReport, StatusChange
from bt_dualarm.world.world import World

TABLE = 0.40
"""Height of the table's top, m."""

TOLD = ("impact_n", "placed_error_m", "placed_turned_rad")
"""Metrics of `place`."""


def task(options: argparse.Namespace, seed: int) -> dict[str, Any]:
    """The tree file of one run."""
    rng = np.random.default_rng(seed)
    cup = options.gripper == "suction_cup"
    shape = str(rng.choice(["box", "cylinder"]))
    edges = [float(edge) for edge in rng.uniform(0.045 if cup else 0.025, 0.065, 3)]
    size, height = (
        (edges, edges[2] / 2) if shape == "box" else ([edges[0] / 2, edges[1]], edges[1] / 2)
    )
    x = (0.10, 0.24) if options.robot == "ur3" else (0.20, 0.45)
    y = (-0.36, -0.25) if options.robot == "ur3" else (-0.52, -0.32)
    start, end = ([float(rng.uniform(*x)), float(rng.uniform(*y))] for _ in range(2))
    mass = float(np.exp(rng.uniform(np.log(0.05), np.log(0.8 if cup else 1.5))))
    pose = {"xyz": [*start, TABLE + height + 5e-4], "rpy": [0, 0, float(rng.uniform(0, 90))]}
    what = {"shape": shape, "size": size, "mass": mass, "pose": pose}
    place = {"object": "thing", "at": {"xyz": [*end, TABLE + height]}}
    leaves = [{"grasp": {"object": "thing"}}, {"place": place}]
    arm = {"robot": options.robot, "gripper": options.gripper, "base": {"xyz": [0, 0, TABLE]}}
    return {
        "bt_dualarm": 1,
        "name": "placing",
        "world": {"scene": "table", "reality": options.reality, "seed": seed, "time_limit": 60},
        "objects": {"thing": what},
        "arms": {"arm1": arm | {"tree": {"sequence": leaves}}},
    }


class Ground(IdleObserver):
    """The force with which the ground bears the thing, while it is placed.

    Attributes:
        pressed, after: Largest force in N before and after the gripper begins to open.
        began: Simulated seconds at which `place` began.
    """

    def __init__(self, world: World) -> None:
        self._world, self._force = world, np.empty(6)
        self.pressed = self.after = 0.0
        self.began: float | None = None
        world.on_forces.append(self._look)

    def on_event(self, change: StatusChange) -> None:
        """Note when the thing is in the fingers."""
        if change.kind == "grasp" and change.new == "SUCCESS":
            self.began = change.time

    def _look(self) -> None:
        if self.began is None:
            return
        force = self._bearing()
        if self._world.grippers["arm1"].commanded.width > 0.0:
            self.after = max(self.after, force)
        else:
            self.pressed = max(self.pressed, force)

    def _bearing(self) -> float:
        model, data = self._world.model, self._world.data
        thing, mine = self._world.object_geom("thing"), self._world.arms["arm1"].geom_ids
        force = np.zeros(3)
        for i, (one, other) in enumerate(data.contact.geom.tolist()):
            if thing in (one, other) and not {one, other} & set(mine):
                mujoco.mj_contactForce(model, data, i, self._force)
                frame = data.contact.frame[i].reshape(3, 3)
                force += (1.0 if other == thing else -1.0) * (self._force[:3] @ frame)
        return float(np.linalg.norm(force))


def run(file: dict[str, Any]) -> tuple[LeafReport, Ground]:
    """The last leaf of a run, and what the ground bore."""
    with bt.open(file) as opened:
        ground = Ground(opened.world)
        opened.watch(ground)
        return opened.finish().arms["arm1"].runs[-1], ground


def main() -> int:
    """Run all of it and print the figures; 1 if a thing was not placed."""
    parser = grip_parser(__doc__, 10)
    parser.add_argument("--verbose", action="store_true", help="print each run")
    options = parser.parse_args()
    rows: list[list[float]] = []
    failed = 0
    for seed in range(options.seed, options.seed + options.runs):
        file = task(options, seed)
        leaf, ground = run(file)
        mass = file["objects"]["thing"]["mass"]
        if leaf.skill != "place" or leaf.status != "SUCCESS":
            failed += leaf.skill == "place"
            print(f"seed {seed}: {leaf.skill} {leaf.code}: {leaf.reason}", flush=True)
            continue
        felt, off, turned = (float(leaf.metrics[name]) for name in TOLD)
        seconds = (leaf.ended_s or 0.0) - leaf.started_s
        rows.append([felt, ground.pressed, ground.after - 9.81 * mass, off, turned, seconds])
        if options.verbose:
            print(f"seed {seed}: {mass:.2f} kg", " ".join(f"{value:.3g}" for value in rows[-1]))
    worst = np.max(rows, axis=0).tolist() if rows else [float("nan")] * 6
    arm = f"{options.robot}, {options.gripper}, {options.reality}"
    print(f"{arm}: {len(rows)} placed, {failed} not")
    names = ("felt N", "true N", "after, beyond its weight, N", "off m", "turned rad", "seconds")
    print("  worst: " + ", ".join(f"{n} {v:.3g}" for n, v in zip(names, worst, strict=True)))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
