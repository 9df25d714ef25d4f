"""Executing a path of the tool as it was drawn, and measuring how well that went."""

from __future__ import annotations

from collections.abc import Generator, Iterator

import numpy as np

from bt_dualarm.arm import Arm
from bt_dualarm.errors import Number
from bt_dualarm.motion.cartesian import trace
from bt_dualarm.motion.paths import CartesianPath
from bt_dualarm.scoring import path_error
from bt_dualarm.skill import Record, nowhere

_SAME_BRANCH = 1.0  # rad: the start of the path is a short straight move away
_ENTRY_SHARE = 0.1  # of the progress that is shown


def follow_curve(
    arm: Arm, path: CartesianPath, speed: float, record: Record = nowhere
) -> Generator[float | None, None, dict[str, Number]]:
    """Go to the start of a path, then along it from rest to rest; the whole of it or nothing.

    Yields the progress, once a tick.

    Args:
        arm: That moves.
        path: Of its tool, in the world.
        speed: Share of its limits.
        record: Takes ``planned`` and ``executed`` tool positions.

    Returns:
        ``path_rms_m`` and ``path_max_m`` of executed against planned tool positions at equal
        times, and ``duration_s``.

    Raises:
        Failure: ``PATH_BROKEN``, ``UNREACHABLE`` or ``IN_COLLISION`` before anything moves,
            ``TRACKING_ERROR`` or ``BUSY``.
    """
    yield from arm.think()
    limits = arm.limits(speed)
    motion = trace(arm.kinematics, path, arm.setpoint.q, limits, arm.period)
    arm.refuse_collision_along(motion.q)
    yield from _enter(arm, path, motion.q[0], speed)
    planned = arm.planned_tool_positions(motion)
    running = arm.begin(motion)
    times = arm.time + arm.period * np.arange(len(motion))
    while not running.done:
        yield _ENTRY_SHARE + (1 - _ENTRY_SHARE) * running.progress
        arm.check()
    yield from arm.settle()
    executed = np.array(running.executed)
    record("planned", times, planned)
    record("executed", times, executed)
    rms, worst = path_error(planned, executed)
    return {"path_rms_m": rms, "path_max_m": worst, "duration_s": motion.duration}


def _enter(arm: Arm, path: CartesianPath, start: np.ndarray, speed: float) -> Iterator[float]:
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
        entry = arm.plan_to(start, speed)
    for progress in arm.follow(entry):
        yield _ENTRY_SHARE * progress
