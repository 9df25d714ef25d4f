"""Timing of curves: duration relative to the bound without jerk limits, and limit violations.

    python benchmarks/timing.py [--robots ur5 panda] [--speeds 1.0 0.5 0.2]

The curves of the demo: a circle of 0.1 m and a 1:2 Lissajous curve in the YZ plane.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.planning.problem import joint_path
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.trajectory.path_timing import TimeOptimal, spline_through, time_path
from bt_dualarm.trajectory.paths import Axes, CartesianPath, circle, lissajous
from bt_dualarm.trajectory.trajectory import shares_of_limits

DT = 0.004
YZ: Axes = (np.array((0.0, 1.0, 0.0)), np.array((0.0, 0.0, 1.0)))
POSTURES = {  # away from limits and singularities; the tool looks along x or down
    "ur5": np.array((0.0015, -0.9451, 1.5663, 2.5204, -1.5723, 3.1416)),
    "panda": np.array((0.0, -0.156, 0.0, -2.198, 0.0, 2.042, 0.785)),
}


def curves(tool: Pose) -> dict[str, CartesianPath]:
    """The curves around a tool pose."""
    return {
        "circle, 20 waypoints": circle(tool, YZ, 0.1),
        "circle, 3 turns": circle(tool, YZ, 0.1, turns=3),
        "lissajous 1:2, 20 waypoints": lissajous(tool, YZ, (0.1, 0.1), (1, 2), waypoints=20),
        "lissajous 1:2, 40 waypoints": lissajous(tool, YZ, (0.1, 0.1), (1, 2)),
    }


def report(name: str, start: Vector, speed: float) -> None:
    """Print a line for each curve."""
    robot = load_robot(name)
    kinematics = Kinematics(robot, Pose.identity())
    limits = robot.limits.scaled(speed)
    for title, path in curves(kinematics.forward(start)).items():
        rows = joint_path(kinematics, path, start)
        bound = TimeOptimal(spline_through(rows, limits, closed=True), limits).fastest.duration
        began = time.perf_counter()
        motion = time_path(rows, limits, DT, closed=True)
        took = time.perf_counter() - began
        shares = shares_of_limits(motion, limits)
        beyond = sum(int((share > 1.0 + 1e-9).sum()) for share in shares)
        print(
            f"{name:6} speed {speed:.1f}  {title:28} {motion.duration:7.3f} s, "
            f"bound {bound:7.3f} s, ratio {motion.duration / bound:.3f}, "
            f"{beyond} violations in {len(motion)} set-points, timed in {1e3 * took:.0f} ms"
        )


def main() -> None:
    """Print a line for each robot, speed and curve."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--robots", nargs="+", default=list(POSTURES), choices=list(POSTURES))
    parser.add_argument("--speeds", nargs="+", type=float, default=[1.0, 0.5, 0.2])
    arguments = parser.parse_args()
    for name in arguments.robots:
        for speed in arguments.speeds:
            report(name, POSTURES[name], speed)


if __name__ == "__main__":
    main()
