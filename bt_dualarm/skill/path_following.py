"""Executing a path of the tool as it was drawn, and measuring how well that went."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.errors import Failure, Number
from bt_dualarm.motion.paths.cartesian_path import CartesianPath
from bt_dualarm.motion.planning.tool_path import trace
from bt_dualarm.motion.setpoints.trajectory_source import TrajectorySource
from bt_dualarm.motion.timing.trajectory import Trajectory
from bt_dualarm.pose import Pose, Vector
from bt_dualarm.skill.path_deviation import PathDeviation
from bt_dualarm.skill.skill import Record, nowhere

TOLERANCE_M = 0.005
"""How far in m the tool may be from where it was planned to be, unless said otherwise."""

_SAME_BRANCH = 1.0  # rad: the start of the path is a short straight move away
_SAME_POSTURE = 0.05  # rad: what a redundant arm may turn in place at the end of that move
_ENTRY_SHARE = 0.1  # of the progress that is shown
_EXIT_SHARE = 0.1  # likewise, of a path that does not end where the tool is to end
_THERE = 1e-6  # m or rad: who is this near need not go there


def follow_curve(
    arm: Arm,
    path: CartesianPath,
    speed: float,
    record: Record = nowhere,
    tolerance: float = TOLERANCE_M,
    end: Pose | None = None,
) -> Generator[float | None, None, dict[str, Number]]:
    """Go to the start of a path, then along it from rest to rest; the whole of it or nothing.

    Yields the progress, once a tick.

    Args:
        arm: Arm that moves.
        path: Path of its tool, in the world.
        speed: Share of its limits, above 0 to 1.
        record: Taker of ``planned`` and ``executed`` tool positions.
        tolerance: Distance in metres by which the tool may be from where it was planned to be.
        end: Pose in the world to go on to in a straight line; None to stay at the path's end.

    Returns:
        ``path_rms_m`` and ``path_max_m`` of executed against planned tool positions at equal
        times, ``duration_s``, and ``shortest_s``: the least that velocity and acceleration allow
        on this path, jerk aside (TOPP-RA). ``grip_pace`` where the gripper's hold slows it.

    Raises:
        Failure: ``PATH_BROKEN``, ``SINGULAR``, ``UNREACHABLE``, ``IN_COLLISION`` or
            ``OVERLOADED`` before anything moves; ``TRACKING_ERROR`` as soon as the tool is beyond
            the tolerance; ``INTERRUPTED`` or ``BUSY``.
    """
    yield from arm.think()
    plan = _Plan.of(arm, path, speed, end)
    yield from _enter(arm, path, plan.motion, speed)
    run = _PathRun.begun(arm, plan.motion, record)
    for progress in run.watched(tolerance):
        yield _ENTRY_SHARE + plan.share * progress
    rms, worst = run.deviation.rms_m, run.deviation.worst_m
    if plan.leaving is not None:
        yield from _leave(arm, plan.leaving)
    times = {"duration_s": plan.motion.duration, "shortest_s": plan.shortest_s}
    pace = {"grip_pace": plan.pace} if plan.pace < 1.0 else {}
    return {"path_rms_m": rms, "path_max_m": worst, **times, **pace}


@dataclass(frozen=True, eq=False)
class _Plan:
    """All that a tool is to do from the start of a path on.

    Attributes:
        motion: Motion along the path.
        shortest_s: Least duration that velocity and acceleration allow there, jerk aside.
        pace: Share of the pace that the grip on what is held allows, up to 1.
        leaving: Motion from the path's end to where the tool is to end; None if that is there.
    """

    motion: Trajectory
    shortest_s: float
    pace: float
    leaving: Trajectory | None

    @classmethod
    def of(cls, arm: Arm, path: CartesianPath, speed: float, end: Pose | None) -> _Plan:
        limits = arm.limits(speed)
        motion, shortest = trace(arm.kinematics, path, arm.setpoint.q, limits, arm.period)
        arm.refuse_collision_along(motion)
        motion = arm.within_efforts(motion)
        pace = arm.grip_pace
        return cls(motion, shortest, pace, _to_end(arm, motion.end, path.end, end, speed))

    @property
    def share(self) -> float:
        """Share of the progress that is shown which the path itself has."""
        return 1.0 - _ENTRY_SHARE - (0.0 if self.leaving is None else _EXIT_SHARE)


@dataclass(frozen=True, eq=False)
class _PathRun:
    """A motion along a path, from its first set-point on.

    Attributes:
        arm: Arm that moves.
        source: Motion as it is executed.
        deviation: How far the tool is from where it was planned to be.
    """

    arm: Arm
    source: TrajectorySource
    deviation: PathDeviation

    @classmethod
    def begun(cls, arm: Arm, motion: Trajectory, record: Record) -> _PathRun:
        source = arm.begin(motion, along_path=True)
        return cls(arm, source, PathDeviation(arm, source, record))

    def watched(self, tolerance: float) -> Iterator[float]:
        """Its progress, once a tick, until the arm stands at its end.

        Raises:
            Failure: ``TRACKING_ERROR`` as soon as the tool was beyond the tolerance.
        """
        arm, source = self.arm, self.source
        watch = arm.watch(source)
        try:
            while not source.done:
                yield source.progress
                arm.check()
                watch.look(arm.time)
                arm.refuse_when_held_up(source)
                self._refuse_beyond(tolerance)
            yield from arm.settle()
            self._refuse_beyond(tolerance)
        finally:
            self.deviation.flush()

    def _refuse_beyond(self, tolerance: float) -> None:
        """Compare what was measured of the tool with what was planned for then."""
        away = self.deviation.look()
        if away > tolerance:
            raise Failure(
                "TRACKING_ERROR",
                f"the tool is {1e3 * away:.1f} mm from where it was planned to be",
                path_error_m=away,
                progress=self.source.progress,
            )


def _enter(
    arm: Arm, path: CartesianPath, motion: Trajectory, speed: float
) -> Iterator[float | None]:
    """Go to the first configuration of a motion: straight with the tool where it is near."""
    start, checked = motion.start, arm.time
    away = float(np.abs(start - arm.setpoint.q).max())
    if away >= 1e-9:
        entry = None
        if away < _SAME_BRANCH:
            try:
                entry = _straight(arm, arm.setpoint.q, path.start, speed, start)
            except Failure as failure:
                if failure.code not in ("PATH_BROKEN", "SINGULAR"):
                    raise
        if entry is None:
            entry = yield from arm.plan([start], speed)
        for progress in arm.follow(entry):
            yield _ENTRY_SHARE * progress
    if arm.time > checked:  # the world has gone on meanwhile
        arm.refuse_collision_along(motion)


def _to_end(
    arm: Arm, q: Vector, path_end: Pose, end: Pose | None, speed: float
) -> Trajectory | None:
    """The motion from the end of a path to where the tool is to end; None if it is there."""
    if end is None or (path_end.distance(end) < _THERE and path_end.angle(end) < _THERE):
        return None
    return _straight(arm, q, end, speed)


def _leave(arm: Arm, motion: Trajectory) -> Iterator[float]:
    """Go on from the end of a path; the world has gone on since that was planned."""
    arm.refuse_collision_along(motion)
    for progress in arm.follow(motion):
        yield 1.0 - _EXIT_SHARE * (1.0 - progress)


def _straight(
    arm: Arm, q: Vector, end: Pose, speed: float, last: Vector | None = None
) -> Trajectory | None:
    """The motion from a configuration straight to a pose of the tool, in the same branch.

    Args:
        arm: Arm that is to move.
        q: Configuration to begin at, of shape (dof,), rad.
        end: Last pose of the tool, in the world.
        speed: Share of its limits.
        last: Configuration to end at to the last digit, of shape (dof,), rad; None for any.

    Returns:
        The motion; None where the line ends at the pose, but elbow or wrist are elsewhere than in
        ``last``.
    """
    rows = arm.line_after(q, end)
    if last is not None:
        if float(np.abs(rows[-1] - last).max()) > _SAME_POSTURE:
            return None
        rows = np.vstack((rows, last))
    arm.refuse_collision_along(rows)
    return arm.time_path(rows, speed)
