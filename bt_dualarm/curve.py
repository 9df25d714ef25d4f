"""Executing a path of the tool as it was drawn, and measuring how well that went."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence

import numpy as np

from bt_dualarm.arm import Arm
from bt_dualarm.errors import Failure, Number
from bt_dualarm.motion.cartesian import trace
from bt_dualarm.motion.motions import TrajectoryMotion
from bt_dualarm.motion.paths import CartesianPath
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.scoring import path_error
from bt_dualarm.skill import Record, nowhere

TOLERANCE_M = 0.005
"""How far in m the tool may be from where it was planned to be, unless said otherwise."""

_SAME_BRANCH = 1.0  # rad: the start of the path is a short straight move away
_ENTRY_SHARE = 0.1  # of the progress that is shown


def follow_curve(
    arm: Arm,
    path: CartesianPath,
    speed: float,
    record: Record = nowhere,
    tolerance: float = TOLERANCE_M,
) -> Generator[float | None, None, dict[str, Number]]:
    """Go to the start of a path, then along it from rest to rest; the whole of it or nothing.

    Yields the progress, once a tick.

    Args:
        arm: That moves.
        path: Of its tool, in the world.
        speed: Share of its limits.
        record: Takes ``planned`` and ``executed`` tool positions.
        tolerance: How far the tool may be from where it was planned to be, in metres.

    Returns:
        ``path_rms_m`` and ``path_max_m`` of executed against planned tool positions at equal
        times, ``duration_s``, and ``shortest_s``: the least that velocity and acceleration allow
        on this path, jerk aside (TOPP-RA).

    Raises:
        Failure: ``PATH_BROKEN``, ``SINGULAR``, ``UNREACHABLE`` or ``IN_COLLISION`` before
            anything moves; ``TRACKING_ERROR`` as soon as the tool is beyond the tolerance;
            ``INTERRUPTED`` or ``BUSY``.
    """
    yield from arm.think()
    limits = arm.limits(speed)
    motion, shortest = trace(arm.kinematics, path, arm.setpoint.q, limits, arm.period)
    arm.refuse_collision_along(motion.q)
    checked = arm.time
    yield from _enter(arm, path, motion.q[0], speed)
    if arm.time > checked:  # the world has gone on meanwhile
        arm.refuse_collision_along(motion.q)
    planned = arm.planned_tool_positions(motion)
    running = arm.begin(motion, along_path=True)
    watch = arm.watch(running)
    began = arm.time
    while not running.done:
        yield _ENTRY_SHARE + (1 - _ENTRY_SHARE) * running.progress
        arm.check()
        watch.look(arm.time)
        arm.refuse_when_held_up(running)
        _refuse_beyond(tolerance, running, planned)
    yield from arm.settle()
    executed = np.array(running.executed)
    times = began + arm.period * np.arange(len(executed))
    planned = _planned_at(running.places, planned, motion.dt)
    record("planned", times, planned)
    record("executed", times, executed)
    rms, worst = path_error(planned, executed)
    if worst > tolerance:
        raise Failure(
            "TRACKING_ERROR",
            f"the tool was up to {1e3 * worst:.1f} mm from where it was planned to be",
            path_max_m=worst,
        )
    return {
        "path_rms_m": rms,
        "path_max_m": worst,
        "duration_s": motion.duration,
        "shortest_s": shortest,
    }


def _refuse_beyond(tolerance: float, motion: TrajectoryMotion, planned: Matrix) -> None:
    """Compare the last place of the tool that was measured with what was planned for then."""
    if not motion.executed:
        return
    last = _planned_at(motion.places[-1:], planned, motion.trajectory.dt)
    away = float(np.linalg.norm(motion.executed[-1] - last[0]))
    if away > tolerance:
        raise Failure(
            "TRACKING_ERROR",
            f"the tool is {1e3 * away:.1f} mm from where it was planned to be",
            path_error_m=away,
            progress=motion.progress,
        )


def _planned_at(places: Sequence[float], planned: Matrix, dt: float) -> Matrix:
    """Tool positions, of shape (n, 3), planned for places in s on a motion."""
    index = np.array(places) / dt
    low = np.clip(index.astype(int), 0, max(len(planned) - 2, 0))
    high = np.minimum(low + 1, len(planned) - 1)
    u = np.clip(index - low, 0.0, 1.0)[:, None]
    between: Matrix = planned[low] + u * (planned[high] - planned[low])
    return between


def _enter(arm: Arm, path: CartesianPath, start: Vector, speed: float) -> Iterator[float | None]:
    """Move to the first configuration: straight with the tool where it is near."""
    away = float(np.abs(start - arm.setpoint.q).max())
    if away < 1e-9:
        return
    if away < _SAME_BRANCH:
        rows = arm.line(arm.commanded_tool_pose, path.start)
        rows = np.vstack((arm.setpoint.q, rows, start))
        arm.refuse_collision_along(rows)
        entry = arm.time_path(rows, speed)
    else:
        entry = yield from arm.plan([start], speed)
    for progress in arm.follow(entry):
        yield _ENTRY_SHARE * progress
