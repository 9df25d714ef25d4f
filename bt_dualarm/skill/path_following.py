"""Following a path of the tool, and measuring the path error."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from math import degrees
from typing import Any, ClassVar, TypeAlias

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.arm.branches import MOST_BRANCHES, beginning_at, first_possible
from bt_dualarm.arm.motions import ArmMotions
from bt_dualarm.arm.past_others import PastOthers
from bt_dualarm.core.errors import Failure, Number
from bt_dualarm.core.free_axes import FreeAxes, angle_to
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.planning.problem import joint_paths
from bt_dualarm.skill.grip import held_through
from bt_dualarm.skill.skill import Record, Skill, nowhere
from bt_dualarm.spec.node_types import port
from bt_dualarm.trajectory.constant_speed import at_constant_speed, too_fast
from bt_dualarm.trajectory.path_timing import timed_path
from bt_dualarm.trajectory.paths import CartesianPath
from bt_dualarm.trajectory.set_points import TrajectorySource
from bt_dualarm.trajectory.trajectory import Trajectory


def check_arrival(
    what: str,
    pose: Pose,
    goal: Pose,
    tolerance: float,
    angle_tolerance: float,
    free: FreeAxes = (),
) -> dict[str, Number]:
    """Position and angle error of a reached pose, as metrics.

    Args:
        what: Name of what has moved, for messages.
        pose: Reached pose in the world.
        goal: Goal pose in the world.
        tolerance: Largest position error, m.
        angle_tolerance: Largest angle error, rad.
        free: Rotations about the axes of what has moved that the goal leaves free.

    Raises:
        Failure: ``NOT_REACHED`` if an error exceeds its tolerance.
    """
    away = pose.distance(goal)
    turn = angle_to(pose, goal, free)
    metrics: dict[str, Number] = {"position_error_m": away, "angle_error_rad": turn}
    if away > tolerance or turn > angle_tolerance:
        raise Failure(
            "NOT_REACHED",
            f"{what} is {1000 * away:.2f} mm and {degrees(turn):.2f}° from its target",
            **metrics,
        )
    return metrics


_BLOCK = 256
"""Number of positions that are planned and recorded at a time."""

_Position: TypeAlias = list[float]  # x, y, z in m; faster than arrays for a few positions a tick


class PathDeviation:
    """Deviation of executed from planned tool positions at equal times, in constant memory.

    Args:
        arm: Arm that moves.
        source: Motion at its start, as it is executed.
        record: Recorder of ``planned`` and ``executed`` tool positions.

    Attributes:
        worst_m: Largest distance so far, m.
    """

    def __init__(self, arm: Arm, source: TrajectorySource, record: Record) -> None:
        self.worst_m = 0.0
        self._arm = arm
        self._source = source
        self._record = record
        self._began_s = arm.time
        self._count = 0
        self._recorded = 0
        self._squares = 0.0
        self._planned: list[_Position] = []
        self._executed: list[_Position] = []
        self._first = 0
        self._block = list[_Position]()

    @property
    def rms_m(self) -> float:
        """Root mean square of the distance so far, m."""
        return float(np.sqrt(self._squares / max(self._count, 1)))

    def look(self) -> float:
        """Compare new measurements; returns the largest distance among them, m."""
        farthest = 0.0
        for position, parameter in self._source.take_measured():
            executed = position.tolist()
            planned = self._planned_at(parameter)
            away = math.dist(executed, planned)
            farthest = max(farthest, away)
            self._squares += away * away
            self._count += 1
            self._planned.append(planned)
            self._executed.append(executed)
        self.worst_m = max(self.worst_m, farthest)
        if self._count - self._recorded >= _BLOCK:
            self.flush()
        return farthest

    def flush(self) -> None:
        """Record the positions that are not recorded yet."""
        if self._count == self._recorded:
            return
        times = self._began_s + self._arm.period * np.arange(self._recorded, self._count)
        self._record("planned", times, np.array(self._planned))
        self._record("executed", times, np.array(self._executed))
        self._recorded = self._count
        self._planned.clear()
        self._executed.clear()

    def _planned_at(self, parameter: float) -> _Position:
        """Planned tool position at a path parameter, s: linear between two set-points."""
        motion = self._source.trajectory
        index = parameter / motion.dt
        last = len(motion) - 1
        low = max(min(int(index), last - 1), 0)
        begin = self._of_set_point(low)
        end = self._of_set_point(min(low + 1, last))
        share = min(max(index - low, 0.0), 1.0)
        return [a + share * (b - a) for a, b in zip(begin, end, strict=True)]

    def _of_set_point(self, number: int) -> _Position:
        """Tool position at a set-point, computed in blocks.

        The nominal chain is used, as for the measured positions, so that only motion errors count.
        """
        if not self._first <= number < self._first + len(self._block):
            motion = self._source.trajectory
            nominal = self._arm.world.nominal[self._arm.name]
            piece = motion.piece(number, min(number + _BLOCK, len(motion)))
            self._first = number
            self._block = [nominal.tool_position_at(q).tolist() for q in piece.q]
        return self._block[number - self._first]


TOLERANCE_M = 0.005
"""Default tolerance of the tool's distance from its planned position, m."""

_SAME_BRANCH = 1.0  # rad; a start this close is first tried by a straight tool motion
_SAME_POSTURE = 0.05  # rad; tolerance of a redundant arm's posture at the end of that motion
_ENTRY_SHARE = 0.1  # fraction of the displayed progress for the motion to the start
_EXIT_SHARE = 0.1  # the same for the motion from the path to another end
_AT_GOAL = 1e-6  # m or rad; within it no motion is needed


def follow_curve(
    arm: Arm,
    path: CartesianPath,
    speed: float,
    record: Record = nowhere,
    tolerance: float = TOLERANCE_M,
    end: Pose | None = None,
    tool_speed: float | None = None,
    *,
    from_here: bool = False,
) -> Generator[float | None, None, dict[str, Number]]:
    """Move to the start of a path, then along it from rest to rest: all of it or nothing.

    If another arm is in the way of the path, or of the motion to its start, the arm waits for that
    to change before it moves. Yields the progress, once per tick.

    Args:
        arm: Arm that moves.
        path: Path of its tool, in the world.
        speed: Fraction of its limits, above 0 to 1.
        record: Recorder of ``planned`` and ``executed`` tool positions.
        tolerance: Largest distance of the tool from its planned position, m.
        end: Pose in the world to which the tool moves on in a straight line; None to stay.
        tool_speed: Constant speed of the tool along the path, m/s, after a smooth start and before
            a smooth end; None for as fast as ``speed`` allows.
        from_here: Whether the path begins at the arm's current pose, and the arm may not move to
            another branch of the inverse kinematics first.

    Returns:
        ``path_rms_m`` and ``path_max_m`` of executed against planned tool positions at equal
        times, ``duration_s``, and ``shortest_s``: the smallest duration under velocity and
        acceleration limits alone (TOPP-RA). ``grip_speed_scale`` if the grip limits the speed. With
        ``tool_speed`` also ``ramp_s``, the duration of the start and of the end.

    Raises:
        Failure: ``TOO_FAST``, ``PATH_BROKEN``, ``SINGULAR``, ``UNREACHABLE``, ``IN_COLLISION`` or
            ``OVERLOADED`` before anything moves; ``TRACKING_ERROR`` as soon as the tool is beyond
            the tolerance; ``INTERRUPTED`` or ``BUSY``.
    """
    yield from arm.think()
    move = replace(arm.past_others(speed), give_way=not from_here)
    plan = yield from move.when_clear(
        lambda: _Plan.of(move, path, end, tool_speed, from_here=from_here)
    )
    first = plan
    further = [
        lambda: first.others(move, path, end, tool_speed),
        lambda: first.turned(move, path, end, tool_speed),
    ]
    plan = yield from _enter(move, path, plan, further)
    source = arm.begin(plan.motion, along_path=True)
    source.tool_avoids_payloads = True
    deviation = PathDeviation(arm, source, record)
    for progress in _monitored(arm, source, deviation, tolerance):
        yield _ENTRY_SHARE + plan.share * progress
    metrics: dict[str, Number] = {
        "path_rms_m": deviation.rms_m,
        "path_max_m": deviation.worst_m,
        "duration_s": plan.motion.duration,
        "shortest_s": plan.shortest_s,
    }
    if plan.grip_scale < 1.0:
        metrics["grip_speed_scale"] = plan.grip_scale
    if plan.ramp_s is not None:
        metrics["ramp_s"] = plan.ramp_s
    leave = plan.exit
    if leave is not None:
        # The world may have changed since it was planned.
        stays = replace(move, give_way=False)
        yield from stays.when_clear(lambda: stays.checked(leave, known_free=False))
        for progress in arm.follow(leave):
            yield 1.0 - _EXIT_SHARE * (1.0 - progress)
    return metrics


@dataclass(frozen=True, eq=False)
class _Plan:
    """Motion plan from the start of a path on.

    Attributes:
        motion: Motion along the path.
        shortest_s: Its shortest duration under velocity and acceleration limits alone.
        grip_scale: Speed scale to which the grip limits it, up to 1.
        exit: Motion from the path's end to another end pose; None to stay there.
        ramp_s: Duration of its start and of its end, if its speed is constant in between.
    """

    motion: Trajectory
    shortest_s: float
    grip_scale: float
    exit: Trajectory | None
    ramp_s: float | None

    @classmethod
    def of(
        cls,
        move: PastOthers,
        path: CartesianPath,
        end: Pose | None,
        tool_speed: float | None,
        *,
        from_here: bool,
    ) -> Generator[None, None, _Plan]:
        """Plan in the first branch of the inverse kinematics in which the whole path is possible.

        Yields once for each branch that is refused.

        Raises:
            Failure: That of the preferred branch, as `follow_curve`; or of one in which another arm
                is in the way, which may leave.
        """
        arm = move.arm
        q = arm.setpoint.q
        branches: Iterable[Matrix]
        if from_here:
            branches = [arm.kinematics.follow_on(path.poses, q, free=path.free)]
        else:
            branches = joint_paths(arm.kinematics, path, q)
        return (
            yield from first_possible(
                branches,
                lambda rows: cls._along(arm, path, rows, move.speed, end, tool_speed),
                is_final=move.may_leave,
            )
        )

    def others(
        self, move: PastOthers, path: CartesianPath, end: Pose | None, tool_speed: float | None
    ) -> Generator[None, None, list[_Plan]]:
        """Plans in the further branches, the preferred one first; yields once per branch."""
        arm = move.arm
        found = list[_Plan]()
        for rows in islice(joint_paths(arm.kinematics, path, arm.setpoint.q), MOST_BRANCHES):
            if float(np.abs(rows[0] - self.motion.start).max()) > _SAME_POSTURE:
                with contextlib.suppress(Failure):
                    found.append(self._along(arm, path, rows, move.speed, end, tool_speed))
            yield
        return found

    def turned(
        self, move: PastOthers, path: CartesianPath, end: Pose | None, tool_speed: float | None
    ) -> Generator[None, None, list[_Plan]]:
        """Plans with joints rotated by whole turns, nearest first; yields once per plan.

        None while another arm may be the reason that there is no motion to this one.
        """
        arm = move.arm
        found = list[_Plan]()
        branches = islice(joint_paths(arm.kinematics, path, arm.setpoint.q), MOST_BRANCHES)
        own = beginning_at(self.motion.start, branches)
        for rows in arm.turned([own]) if arm.may_turn else ():
            with contextlib.suppress(Failure):
                found.append(self._along(arm, path, rows, move.speed, end, tool_speed))
            yield
        return found

    @classmethod
    def _along(
        cls,
        arm: ArmMotions,
        path: CartesianPath,
        rows: Matrix,
        speed: float,
        end: Pose | None,
        tool_speed: float | None,
    ) -> _Plan:
        """Plan along the configurations of one branch, of shape (n, dof), rad."""
        ramp = None
        if tool_speed is None:
            motion, shortest = timed_path(rows, arm.limits(speed), arm.period, path.closed)
        else:
            full = arm.limits(1.0)
            shortest = timed_path(rows, full, arm.period, path.closed).shortest_s
            motion, ramp = at_constant_speed(rows, path.lengths, tool_speed, full, arm.period)
        arm.refuse_collision_along(motion)
        asked_s = motion.duration
        motion = arm.within_efforts(motion)
        if tool_speed is not None and motion.duration > asked_s + arm.period:
            fastest = tool_speed * asked_s / motion.duration
            raise too_fast(tool_speed, fastest, "the load does not allow it on the whole path")
        grip_scale = arm.grip_speed_scale
        leave = None
        if end is not None and not _is_at(path.end, end):
            leave = _straight(arm, motion.end, end, speed, path.free)
        return cls(motion, shortest, grip_scale, leave, ramp)

    @property
    def share(self) -> float:
        """Fraction of the displayed progress for the path itself."""
        return 1.0 - _ENTRY_SHARE - (0.0 if self.exit is None else _EXIT_SHARE)


def _is_at(pose: Pose, goal: Pose) -> bool:
    return pose.distance(goal) < _AT_GOAL and pose.angle(goal) < _AT_GOAL


def _monitored(
    arm: Arm, source: TrajectorySource, deviation: PathDeviation, tolerance: float
) -> Iterator[float]:
    """Progress of a motion along a path, once per tick, until the arm is at rest at its end.

    Raises:
        Failure: ``TRACKING_ERROR`` as soon as the tool is beyond the tolerance; as `Arm.follow`.
    """

    def refuse_beyond_tolerance() -> None:
        distance = deviation.look()
        if distance > tolerance:
            raise Failure(
                "TRACKING_ERROR",
                f"the tool is {1e3 * distance:.1f} mm from its planned position",
                path_error_m=distance,
                progress=source.progress,
            )

    watch = arm.watch(source, waits_for_arms=True)
    try:
        while not source.done:
            yield source.progress
            arm.check()
            watch.look(arm.time)
            arm.refuse_when_held_up(source)
            refuse_beyond_tolerance()
        yield from arm.settle()
        refuse_beyond_tolerance()
    finally:
        deviation.flush()


def _enter(
    move: PastOthers,
    path: CartesianPath,
    plan: _Plan,
    further: Sequence[Callable[[], Generator[None, None, list[_Plan]]]],
) -> Generator[float | None, None, _Plan]:
    """Move to the first configuration of a plan, on a straight tool path if that is near and free.

    If no path leads there, the arm moves to the start in another branch: one that has to keep
    something upright can hardly leave its own.

    Args:
        move: Motion to the start.
        path: Path of the tool, in the world.
        plan: Plan in the preferred branch.
        further: Plans in the further branches, then those with joints rotated by whole turns.

    Returns:
        The plan whose start the arm has reached.

    Raises:
        Failure: As motions, and as the plan to the preferred branch if there is none to any other.
    """
    arm = move.arm
    start = plan.motion.start
    checked = arm.time
    chosen = plan

    def entry() -> Generator[None, None, Trajectory]:
        nonlocal chosen
        chosen = plan
        if float(np.abs(start - arm.setpoint.q).max()) < _SAME_BRANCH:
            try:
                straight = _straight(arm, arm.setpoint.q, path.start, move.speed, path.free, start)
            except Failure as failure:
                is_blocked = failure.code == "IN_COLLISION" and not move.may_clear(failure)
                if not is_blocked and failure.code not in ("PATH_BROKEN", "SINGULAR"):
                    raise
            else:
                if straight is not None:
                    return straight
        try:
            return (yield from arm.plan([start], move.speed))
        except Failure as failure:
            if failure.code != "NO_PLAN":
                raise
            refusal = failure.with_traceback(None)  # would keep this frame alive
        for plans in further:
            found = yield from plans()
            if not found:
                continue
            try:
                motion = yield from arm.plan([one.motion.start for one in found], move.speed)
            except Failure as failure:
                if failure.code != "NO_PLAN":
                    raise
            else:
                chosen = min(
                    found, key=lambda one: float(np.abs(one.motion.start - motion.end).max())
                )
                return motion
        if _is_at(arm.commanded_tool_pose, path.start):  # why does it not begin as it is?
            try:
                arm.kinematics.follow_on(path.poses, arm.setpoint.q, free=path.free)
            except Failure as failure:
                reason = f"{refusal.reason}; from its current configuration, {failure.reason}"
                raise Failure(refusal.code, reason, **refusal.numbers) from refusal.__cause__
        raise refusal

    if float(np.abs(start - arm.setpoint.q).max()) >= 1e-9:
        for progress in move.to_line(entry, lambda: chosen.motion):
            yield None if progress is None else _ENTRY_SHARE * progress
    if arm.time > checked:  # the world may have changed meanwhile
        arm.refuse_collision_along(chosen.motion)
    return chosen


def _straight(
    arm: ArmMotions,
    q: Vector,
    end: Pose,
    speed: float,
    free: FreeAxes,
    last: Vector | None = None,
) -> Trajectory | None:
    """Motion of the tool on a straight line from a configuration to a pose, in the same branch.

    Args:
        arm: Arm that moves.
        q: Start configuration, of shape (dof,), rad.
        end: Last pose of the tool, in the world.
        speed: Fraction of its limits.
        free: Rotations about the tool's axes that do not count on the line.
        last: Exact end configuration, of shape (dof,), rad; None for any.

    Returns:
        The motion; None if the line ends in a posture other than that of ``last``.
    """
    rows = arm.line_after(q, end, free)
    if last is not None:
        if float(np.abs(rows[-1] - last).max()) > _SAME_POSTURE:
            return None
        rows = np.vstack((rows, last))
    arm.refuse_collision_along(rows)
    return arm.time_path(rows, speed)


class PathSkill(Skill):
    """Base of skills that build a path and move the tool along all of it or nothing.

    A subclass declares the ports ``speed``, ``tolerance`` and ``free`` with the declarations given
    here, builds its path in `run`, and follows it with `along`.

    Attributes:
        SPEED: Declaration of the port ``speed``.
        TOLERANCE: Declaration of the port ``tolerance``.
        FREE: Declaration of the port ``free``.
        INTO: Declaration of the port ``into``.
    """

    # Any: a declaration stands for a value of the type that the port's own annotation names.
    SPEED: ClassVar[Any] = port(
        0.5, "fraction of the arm's limits of velocity, acceleration and jerk"
    )
    TOLERANCE: ClassVar[Any] = port(
        TOLERANCE_M,
        "largest deviation of the tool from its planned position at any time",
        unit="m",
        ge=1e-4,
        le=0.1,
    )
    FREE: ClassVar[Any] = port(
        None, "rotations about the tool's own axes that do not count, by default none"
    )
    INTO: ClassVar[Any] = port(
        None,
        "object, held by another arm with `hold_still`, to which tool and held object may come "
        "as near as they need, such as a plate in whose hole a peg is put",
    )
    failures: ClassVar[dict[str, str]] = {
        "SINGULAR": "the path leads through a singularity of the arm; nothing was executed",
        "PATH_BROKEN": "the arm can follow only a part of the path; nothing was executed",
        "IN_COLLISION": "the arm would touch something on the path",
        "TRACKING_ERROR": "the arm was blocked or left its plan by more than the tolerance",
        "SLIPPED": "the held object slid between the fingers",
        "DROPPED": "the gripper no longer holds the object",
        "BUSY": "another leaf moves the arm",
    }

    def along(
        self,
        path: CartesianPath,
        *,
        to_center: bool = False,
        tool_speed: float | None = None,
        free: FreeAxes = (),
        from_here: bool = False,
    ) -> Iterator[float | None]:
        """Move to the start of a path and along it; adds the measured errors to the metrics.

        Args:
            path: Path of the tool, in the world.
            to_center: Whether the tool moves on to the curve's center, on a straight line.
            tool_speed: Constant speed of the tool, m/s; None for as fast as ``speed`` allows.
            free: Rotations about the tool's axes that do not count anywhere on the path.
            from_here: As `follow_curve`.

        Raises:
            Failure: As `follow_curve` and, with a held object, as `held_through`.
        """
        end = path.center if to_center else None
        following = self._follow(replace(path, free=free), end, tool_speed, from_here)
        self.metrics |= yield from held_through(self.arm, following)

    def _follow(
        self, path: CartesianPath, end: Pose | None, tool_speed: float | None, from_here: bool
    ) -> Iterator[float | None]:
        ports = self.ports
        self.metrics |= yield from follow_curve(
            self.arm,
            path,
            ports.speed,
            self.record,
            ports.tolerance,
            end,
            tool_speed,
            from_here=from_here,
        )
