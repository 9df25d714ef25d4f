"""The servo law alone: filter and servo follow a motion, without physics or images.

    python -m benchmarks.servo_law [--trials N] [--seed S] [--robot NAME ...] [--motion KIND ...]
                                   [--camera FPS/MS ...] [--share 0.8]

The motions are those of `benchmarks.track_anything`, sampled with 0.2 mm of noise at the camera's
rate and delivered after its latency. Four RMS errors in mm show where an error comes from: that of
the prediction; that of the servo if it knows the current true motion with velocity and
acceleration; if it knows the true motion at the exposure of its newest image and assumes constant
acceleration since then; and if it follows the prediction. A trial takes a second.
"""

from __future__ import annotations

import argparse
import sys
from collections import deque
from dataclasses import asdict
from types import SimpleNamespace
from typing import Any, Final, Literal, TypeAlias, cast

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.campaign import Campaign, add_options
from benchmarks.following_trial import LOOKS
from benchmarks.track_anything import MOTIONS, Case, Course, add_case_options, cases, course
from benchmarks.vantage import BASE, Vantage, vantage
from bt_dualarm.control.planar_servo import PlanarServo, PlaneTarget, plane_limits
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.perception.target_filter import DualFilterEstimate
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.skill.tracking import servo_gains
from bt_dualarm.spec.values import Plane
from bt_dualarm.trajectory.set_points import SetPoint

PERIOD_S: Final = 0.002
"""Period of the set-points."""

_NOISE_M = 2e-4
_BEFORE_S = 2.0  # at rest before the motion
_SAMPLE_S = 0.01  # of a course


Knowledge: TypeAlias = Literal["now", "exposure", "images"]
"""What the servo knows: the current true motion, that at the newest exposure, or only images."""


def errors(
    case: Case, viewpoint: Vantage, path: Course, knowledge: Knowledge
) -> tuple[float, float]:
    """RMS errors in m of the tool, minus its mean error, and of the target that it follows.

    Args:
        case: Robot, plane and camera.
        viewpoint: Start posture of the arm.
        path: Motion of the target.
        knowledge: What the servo knows of the motion. After the exposure, constant acceleration is
            assumed.
    """
    robot = load_robot(case.robot)
    arm = Kinematics(robot, Pose.from_rpy(BASE[0], np.radians(BASE[1]).tolist()))
    axes = np.array(Plane.model_validate(case.plane).axes)
    times = _SAMPLE_S * np.arange(len(path.positions))
    spline = CubicSpline(times, path.positions - path.positions[0], bc_type="clamped")
    camera = cast(
        "Any", SimpleNamespace(noise=0.0, latency=case.latency, period=1.0 / case.fps)
    )  # what gains depend on
    gains = servo_gains(camera, plane_limits(arm, robot.limits, viewpoint.q, axes).jerk)
    estimate = DualFilterEstimate(gains.calmness, gains.calm_jerk)

    def true(time: float, order: int = 0) -> Vector:
        moving = 0.0 < time < path.duration
        if order and not moving:
            return np.zeros(2)
        value: Vector = spline(min(max(time, 0.0), path.duration), order)
        return value

    def target(time: float, displacement: Vector) -> PlaneTarget | None:  # noqa: ARG001
        if knowledge != "images":
            known = time if knowledge == "now" or not estimate.seen else estimate.stamp
            passed = time - known
            velocity = true(known, 1)
            acceleration = true(known, 2)
            return PlaneTarget(
                true(known) + passed * (velocity + 0.5 * passed * acceleration),
                velocity + passed * acceleration,
                acceleration,
            )
        return PlaneTarget(*estimate.predict(time)) if estimate.seen else None

    rest = np.zeros_like(viewpoint.q)
    start = SetPoint(viewpoint.q, rest, rest)
    servo = PlanarServo(
        arm, robot.limits, PERIOD_S, start, axes, target, gains.bandwidth, gains.slack
    )
    rng = np.random.default_rng(case.seed)
    arriving: deque[tuple[float, Vector]] = deque()
    time = -_BEFORE_S
    exposure = time
    rows = []
    while time < path.duration:
        while exposure <= time:
            hidden = path.hidden[0] <= exposure < path.hidden[1]
            if not hidden:
                arriving.append((exposure, true(exposure) + rng.normal(0.0, _NOISE_M, 2)))
            exposure += 1.0 / case.fps
        while arriving and arriving[0][0] + case.latency <= time:
            estimate.update(*arriving.popleft(), _NOISE_M)
        tool = axes @ (arm.matrix(servo(time).q)[:3, 3] - arm.matrix(viewpoint.q)[:3, 3])
        if time > 0.0:
            followed = target(time, tool)
            prediction_error = np.zeros(2) if followed is None else followed.position - true(time)
            rows.append((*(tool - true(time)), *prediction_error))
        time += PERIOD_S
    found = np.array(rows)
    return _rms(found[:, :2] - found[:, :2].mean(axis=0)), _rms(found[:, 2:])


def _rms(vectors: Matrix) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))


def main(arguments: list[str]) -> int:
    """Print a line for each trial, then medians and 95th percentiles."""
    parser = argparse.ArgumentParser(description="the servo law alone")
    add_case_options(parser, MOTIONS, default=MOTIONS[:6])
    add_options(parser)
    options = parser.parse_args(arguments)
    options.reality = ["ideal"]
    options.free = False
    found = []
    with Campaign(options) as campaign:
        for fields, result in campaign.run(run_trial, [asdict(case) for case in cases(options)]):
            case = Case(**fields)
            if "errors" not in result:
                print(f"{case}: {result['why']}", flush=True)
                continue
            found.append([1e3 * error for error in result["errors"]])
            predicted, known, late, tool = found[-1]
            print(
                f"{case}: prediction {predicted:.2f}, servo with the true motion {known:.2f}, "
                f"at the exposure {late:.2f}, servo {tool:.2f} mm",
                flush=True,
            )
        for name, column in zip(
            ("prediction", "servo with true motion", "servo with motion at exposure", "servo"),
            np.array(found).reshape(-1, 4).T,
            strict=True,
        ):
            print(f"{name}: median {np.median(column):.2f}, p95 {np.percentile(column, 95):.2f} mm")
        return 0


def run_trial(**fields: Any) -> dict[str, Any]:  # Any: fields of `Case`
    """Errors of a trial, m, or why its curve was rejected."""
    case = Case(**fields)
    try:
        viewpoint = vantage(case.robot, LOOKS[case.plane])
        path = course(case, viewpoint, np.array(Plane.model_validate(case.plane).axes))
        known, _ = errors(case, viewpoint, path, "now")
        late, _ = errors(case, viewpoint, path, "exposure")
        tool, predicted = errors(case, viewpoint, path, "images")
    except Failure as failure:
        return {"outcome": "SKIPPED", "why": str(failure)}
    return {"errors": [predicted, known, late, tool]}


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
