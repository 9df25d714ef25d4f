"""Accuracy of the hand-eye calibration of wrist cameras by `calibrate`.

    python -m benchmarks.hand_eye [--sets lab rough] [--seeds 5] [--robots panda]

An arm runs `calibrate` with a yellow ball 0.35 m in front of its camera. Prints the errors before
and after, relative to the simulator: the lateral error of a point at the ball, in the middle of the
image; the errors of the camera's position and orientation; and the residuals in the images.
"""

from __future__ import annotations

import argparse
import itertools
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

import bt_dualarm as bt
from benchmarks.campaign import Campaign, add_options
from bt_dualarm.core.pose import Pose, camera_pose
from bt_dualarm.sim.world import World

DISTANCE_M = 0.35
POSTURES = {"panda": "look_out"}
BASE = {"xyz": [1.60, 0.11, 0.28], "rpy": [0, 0, 180]}


@dataclass(frozen=True)
class Error:
    """Error of a hand-eye calibration.

    Attributes:
        shift_mm: Error of the camera's position, mm.
        turn_deg: Error of its orientation, degrees.
        aim_mm: Lateral error of a point at the target, mm.
    """

    shift_mm: float
    turn_deg: float
    aim_mm: float


def error_of(world: World) -> Error:
    """The current error of the hand-eye calibration of ``arm1``."""
    body = world.arms["arm1"]
    nominal_pose = world.nominal["arm1"].camera_pose_at(body.q)
    deviation = nominal_pose.inverse @ camera_pose(world.data, body.camera_id)
    ahead = deviation.apply(np.array((0.0, 0.0, DISTANCE_M)))[:2]
    aim = 1e3 * float(np.linalg.norm(ahead))
    shift = 1e3 * float(np.linalg.norm(deviation.position))
    return Error(shift, float(np.degrees(deviation.angle(Pose.identity()))), aim)


def calibrated(robot: str, reality: str, seed: int) -> tuple[Error, Error, bt.LeafResult]:
    """The error before and after `calibrate`, and the result of the leaf."""
    camera = {"mount": "wrist", "resolution": [320, 240], "fov": 50, "fps": 60}
    arm = {"robot": robot, "base": BASE, "posture": POSTURES.get(robot, "home"), "camera": camera}
    tree = {
        "bt_dualarm": 1,
        "name": "hand_eye",
        "world": {"scene": "empty", "time_limit": 120, "reality": reality},
        "objects": {},
        "arms": {"arm1": {**arm, "tree": {"calibrate": {"distance": DISTANCE_M}}}},
    }
    with bt.open(tree, seed=seed, renderer="ray") as run:
        view = run.world.nominal["arm1"].camera_pose_at(run.world.hardware["arm1"].q)
    place = view.apply(np.array((0.0, 0.0, DISTANCE_M))).tolist()
    ball = {"shape": "sphere", "size": [0.03], "mass": 0.1, "fixed": True, "color": "yellow"}
    tree["objects"] = {"mark": {**ball, "pose": {"xyz": place}}}
    with bt.open(tree, seed=seed, renderer="ray") as run:
        before = error_of(run.world)
        result = run.finish()
        after = error_of(run.world)
    return before, after, result.arms["arm1"].leaves["calibrate"]


def run_calibration(robot: str, reality: str, seed: int) -> dict[str, Any]:
    """The errors before and after `calibrate`, and the status of the leaf."""
    before, after, leaf = calibrated(robot, reality, seed)
    return {
        "outcome": str(leaf.status),
        "code": leaf.code,
        "message": f"{leaf.status} {leaf.reason} views {leaf.metrics.get('views')}",
        "before": asdict(before),
        "after": asdict(after),
        "residuals": [
            leaf.metrics.get(name, np.nan) for name in ("residual_before_px", "residual_px")
        ],
    }


def main() -> None:
    """Print a line per robot, reality and seed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--robots", nargs="+", default=["panda"])
    parser.add_argument("--sets", nargs="+", default=["lab", "rough"])
    parser.add_argument("--seeds", type=int, default=5)
    add_options(parser)
    arguments = parser.parse_args()
    each = itertools.product(arguments.robots, arguments.sets, range(arguments.seeds))
    cases = [{"robot": robot, "reality": reality, "seed": seed} for robot, reality, seed in each]
    with Campaign(arguments) as campaign:
        for case, found in campaign.run(run_calibration, cases):
            before = Error(**found["before"])
            after = Error(**found["after"])
            first, last = found["residuals"]
            print(
                f"{case['robot']:6} {case['reality']:6} {case['seed']} {found['message']} "
                f"aim {before.aim_mm:.2f} -> {after.aim_mm:.2f} mm, "
                f"place {before.shift_mm:.2f} -> {after.shift_mm:.2f} mm, "
                f"turn {before.turn_deg:.3f} -> {after.turn_deg:.3f} deg, "
                f"residual {first:.2f} -> {last:.2f} px",
                flush=True,
            )


if __name__ == "__main__":
    main()
