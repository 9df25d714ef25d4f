"""A trajectory as a controller follows it: at a time scale that may change, or to a stop."""

from __future__ import annotations

from collections import deque

from bt_dualarm.motion.setpoints.set_point import SetPoint
from bt_dualarm.motion.setpoints.time_scaling import (
    PathParameter,
    ScaledPiece,
    brake_after,
    change_scale,
    keep_scale,
    sampled_at,
    to_rest_after,
)
from bt_dualarm.motion.timing.trajectory import Trajectory
from bt_dualarm.pose import Vector
from bt_dualarm.world.robots.robot import JointLimits

_PIECE = 25  # set-points at an even scale that are worked out at a time


_KEPT = 8192  # measured positions that nobody has asked for


class TrajectorySource:
    """Follows a trajectory set-point by set-point; keeps where the tool was, if that matters.

    Args:
        trajectory: Trajectory from rest to rest.
        along_path: Whether the tool's path matters, not only its end.

    Attributes:
        goal_scale: Time scale that it has, or is changing to.
        held_since: Simulated time in s since which it is stopped, None while it goes on.
        held_up: Reason for which it is stopped.
        leaves_path: Whether the braking trajectory that is reserved does.
    """

    def __init__(self, trajectory: Trajectory, along_path: bool = False) -> None:
        self.trajectory = trajectory
        self.along_path = along_path
        self.goal_scale = 1.0
        self.held_since: float | None = None
        self.held_up = ""
        self.leaves_path = False
        self._measured: deque[tuple[Vector, float]] = deque(maxlen=_KEPT)
        self._position: Vector | None = None
        self._next, self._count = 0, len(trajectory)
        self._ahead: ScaledPiece | None = None
        self._row = 0
        self._reserved = False

    @property
    def done(self) -> bool:
        """Whether the last set-point has been sent."""
        if self._ahead is not None:
            along: float = self._ahead.parameters.item(self._row, 0)
            return along >= self.trajectory.duration
        return self._next >= self._count

    @property
    def progress(self) -> float:
        """Share of the motion that was sent, from 0 to 1."""
        if self._ahead is not None:
            return min(self.parameter.s / max(self.trajectory.duration, 1e-9), 1.0)
        return self._next / len(self.trajectory)

    @property
    def parameter(self) -> PathParameter:
        """Path parameter of the last set-point."""
        if self._ahead is None:
            return PathParameter(max(self._next - 1, 0) * self.trajectory.dt)
        return PathParameter(*self._ahead.parameters[self._row].tolist())

    @property
    def changing(self) -> bool:
        """Whether its time scale is being changed."""
        return self.parameter.scale != self.goal_scale

    @property
    def braking(self) -> Trajectory | None:
        """Braking trajectory from the last set-point on that is reserved; None if there is none."""
        if self._ahead is None or not self._reserved:
            return None
        rows, i = self._ahead.motion, self._row
        return Trajectory(rows.dt, rows.q[i:], rows.v[i:], rows.a[i:])

    def measure(self, position: Vector) -> None:
        """Note where the tool is, of shape (3,), m, at the time of the set-point to come."""
        self._position = position

    def take_measured(self) -> list[tuple[Vector, float]]:
        """What was measured since it was last asked, or the last half minute of that.

        Returns:
            Positions of the tool at set-points' times, each of shape (3,), m, with the path
            parameters at the same times: seconds on the trajectory.
        """
        taken = list(self._measured)
        self._measured.clear()
        return taken

    def next(self, time: float) -> SetPoint:  # noqa: ARG002 - a trajectory counts its own time
        """The next set-point."""
        if self._ahead is not None:
            return self._next_ahead(self._ahead)
        i = min(self._next, self._count - 1)
        self._next += 1
        self._note(i * self.trajectory.dt)
        return SetPoint(*self.trajectory.set_point(i))

    def change_scale(self, scale: float, limits: JointLimits) -> bool:
        """Begin to change the time scale; whether the limits allow it.

        Args:
            scale: Time scale that it shall have; 0 is to stand still on the path.
            limits: Limits that no set-point may pass.
        """
        change = change_scale(self.trajectory, self.parameter, scale, limits)
        if change is None:
            return False
        self._ahead, self._row, self._reserved = change, 0, False
        self.goal_scale, self.leaves_path = change.goal, False
        return True

    def to_rest_after(self, count: int, scale: float, limits: JointLimits) -> ScaledPiece | None:
        """The next ``count`` set-points, changing to a time scale, then to rest on the path.

        None where that is not possible within the limits.
        """
        return to_rest_after(self.trajectory, self.parameter, scale, count, limits)

    def to_brake_after(self, count: int, limits: JointLimits) -> ScaledPiece | None:
        """The next ``count`` set-points, then to rest joint by joint, wherever that leads.

        None where its time scale is changing.
        """
        now = self.parameter
        if now.change:
            return None
        return brake_after(self.trajectory, now, count, limits)

    def take(self, ahead: ScaledPiece, *, leaves_path: bool = False) -> None:
        """Follow what is reserved: it ends at rest, unless the motion is told to go on before.

        Args:
            ahead: Piece from the last set-point on.
            leaves_path: Whether its end does.
        """
        self._ahead, self._row, self._reserved = ahead, 0, True
        self.goal_scale, self.leaves_path = ahead.goal, leaves_path

    def halt(self, limits: JointLimits) -> Trajectory | None:
        """A stop on the path, from the last set-point on; None if there is none."""
        change = change_scale(self.trajectory, self.parameter, 0.0, limits)
        return None if change is None else change.motion

    def configuration(self, s: float) -> Vector:
        """Joint angles, of shape (dof,), rad, at a path parameter in s, on the grid."""
        row = min(round(s / self.trajectory.dt), len(self.trajectory) - 1)
        return self.trajectory.set_point(row)[0]

    def _note(self, parameter: float) -> None:
        if self._position is not None:
            self._measured.append((self._position, parameter))

    def _next_ahead(self, ahead: ScaledPiece) -> SetPoint:
        self._row += 1
        if self._row >= len(ahead.parameters):
            last = PathParameter(*ahead.parameters[-1].tolist())
            parameters = keep_scale(self.trajectory, last, _PIECE)
            rows = sampled_at(self.trajectory, parameters)
            ahead = ScaledPiece(parameters, rows, last.scale)
            self._ahead, self._row = ahead, 1
        self._note(ahead.parameters.item(self._row, 0))
        return SetPoint(*ahead.motion.set_point(self._row))
