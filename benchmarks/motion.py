"""Curves of the tool: path error, and duration relative to a lower bound.

    python -m benchmarks.motion [--robots ur5 ur3 ur10 panda xarm7] [--speed 1.0]

A circle of 0.1 m, a 1:2 Lissajous curve, both in the YZ plane on 20 waypoints, and a line of 0.3 m,
each run as `bt-run` does, with and without 1 kg at the tool. The bound is that of TOPP-RA, computed
on a separate spline through the same configurations with velocity and acceleration limits only, so
no motion with bounded jerk reaches it. Goals for the UR5: RMS error at most 0.10 mm, maximum
0.3 mm, duration of the curves at most 1.15 times the bound.
"""

from __future__ import annotations

import argparse
import logging
from dataclasses import dataclass

import numpy as np
import toppra
import toppra.algorithm
import toppra.constraint

from benchmarks.campaign import Campaign, add_options, registry
from benchmarks.measured_robots import MEASURED
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.core.pose import Matrix, Pose
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.planning.problem import joint_path
from bt_dualarm.robots.robot import JointLimits, Robot
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.runtime.outcome import ArmResult
from bt_dualarm.runtime.run import Run
from bt_dualarm.skill.registry import Registry
from bt_dualarm.trajectory.paths import Axes, CartesianPath, circle, line, lissajous

YZ: Axes = (np.array((0.0, 1.0, 0.0)), np.array((0.0, 0.0, 1.0)))
BASE = Pose.from_rpy((0.0, 0.0, 0.4))
PAYLOAD_KG = 1.0
POSTURES = {"ur5": "present", "panda": "look_out"}
"""Start posture of the curves, by robot; home for the others."""


@dataclass(frozen=True)
class Case:
    """A curve as a leaf and as a path of the tool."""

    name: str
    leaf: dict[str, object]
    path: CartesianPath


def cases(tool: Pose, speed: float) -> list[Case]:
    """The curves around a tool pose."""
    step = np.array((0.0, -0.2, -0.2)) * 0.3 / np.hypot(0.2, 0.2)
    return [
        Case(
            "circle",
            {"circle": {"radius": 0.1, "waypoints": 20, "speed": speed}},
            circle(tool, YZ, 0.1),
        ),
        Case(
            "lissajous",
            {"lissajous": {"amplitudes": [0.1, 0.1], "waypoints": 20, "speed": speed}},
            lissajous(tool, YZ, (0.1, 0.1), (1, 2), waypoints=20),
        ),
        Case(
            "line",
            {"move_linear": {"offset": {"xyz": step.tolist()}, "speed": speed}},
            line(tool, Pose(tool.position + step, tool.quaternion)),
        ),
    ]


def bound(rows: Matrix, limits: JointLimits) -> float:
    """TOPP-RA's shortest duration in s, with its own spline and grid."""
    steps = np.linalg.norm(np.diff(rows, axis=0) / limits.velocity, axis=1)
    path = toppra.SplineInterpolator(np.concatenate(((0.0,), np.cumsum(steps))), rows)
    constraints = [
        toppra.constraint.JointVelocityConstraint(np.stack((-limits.velocity, limits.velocity), 1)),
        toppra.constraint.JointAccelerationConstraint(
            np.stack((-limits.acceleration, limits.acceleration), 1)
        ),
    ]
    grid = np.linspace(0.0, float(path.path_interval[1]), 2001)
    problem = toppra.algorithm.TOPPRA(constraints, path, gridpoints=grid, solver_wrapper="seidel")
    rates = problem.compute_parameterization(0.0, 0.0)[1]
    return float((2.0 * np.diff(grid) / (rates[1:] + rates[:-1])).sum())


def execute(robot: Robot, case: Case, tool: Pose, loaded: bool, registry: Registry) -> ArmResult:
    """Run the curve."""
    base = {"xyz": BASE.position.tolist()}
    tree = {
        "bt_dualarm": 1,
        "name": "motion",
        "world": {"scene": "empty"},
        "arms": {
            "arm1": {
                "robot": robot.name,
                "base": base,
                "posture": POSTURES.get(robot.name, "home"),
                "tree": case.leaf,
            }
        },
    }
    if loaded:
        at = tool @ Pose.from_rpy((0.0, 0.0, 0.045))  # clear of a hand
        tree["objects"] = {
            "payload": {
                "shape": "box",
                "size": [0.05, 0.05, 0.05],
                "mass": PAYLOAD_KG,
                "pose": {"xyz": at.position.tolist(), "quat": at.quaternion.tolist()},
            }
        }
    with Run(load_tree_file(tree, registry.kinds), registry) as run:
        if loaded:
            run.world.attach("arm1", "payload")
        return run.finish().arms["arm1"]


def summary(arm: ArmResult, shortest: float) -> str:
    """Errors in mm and duration relative to the bound, or the reason of a failure."""
    (leaf,) = arm.runs
    if leaf.status != "SUCCESS":
        return f"{leaf.code}: {leaf.reason}"
    rms, most, took = (
        float(leaf.metrics[key]) for key in ("path_rms_m", "path_max_m", "duration_s")
    )
    return (
        f"rms {1e3 * rms:.4f} mm, max {1e3 * most:.4f} mm in {took:.3f} s, "
        f"{took / shortest:.3f} of the bound, {arm.clipped_setpoints} set-points clipped"
    )


def measure(name: str, number: int, speed: float) -> dict[str, str]:
    """Report on a curve: its bound, and the results without and with a load."""
    logging.getLogger("toppra").setLevel(logging.CRITICAL)
    robot = load_robot(name)
    kinematics = Kinematics(robot, BASE)
    start = robot.postures[POSTURES.get(name, "home")]
    tool = kinematics.forward(start)
    case = cases(tool, speed)[number]
    shortest = bound(joint_path(kinematics, case.path, start), robot.limits.scaled(speed))
    lines = [f"{name:6} {case.name:10} bound {shortest:.3f} s"]
    for loaded in (False, True):
        arm = execute(robot, case, tool, loaded, registry())
        lines.append(f"    {PAYLOAD_KG * loaded:.0f} kg  {summary(arm, shortest)}")
    return {"lines": "\n".join(lines)}


def main() -> None:
    """Print a line for each robot and curve."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    names = ["ur5", *(name for name in MEASURED if name != "ur5")]
    parser.add_argument("--robots", nargs="+", default=names, choices=names)
    parser.add_argument("--speed", type=float, default=1.0)
    add_options(parser)
    arguments = parser.parse_args()
    curves = range(len(cases(Pose.identity(), arguments.speed)))
    each = [
        {"name": name, "number": number, "speed": arguments.speed}
        for name in arguments.robots
        for number in curves
    ]
    with Campaign(arguments) as campaign:
        for _, found in campaign.run(measure, each):
            print(found["lines"], flush=True)


if __name__ == "__main__":
    main()
