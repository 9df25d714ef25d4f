"""Limits that hold along a path, and motions of one arm that keep them.

A `PathConstraint` limits the pose of a frame that moves with the tool: cones in which an axis of it
stays, and a range of its height. Any pose can be projected onto it in closed form. The search is
an RRT-Connect over poses (Kuffner, LaValle, ICRA 2000) whose samples are projected (Berenson,
Srinivasa, Kuffner, Task Space Regions, IJRR 2011), with straight edges that are followed by inverse
kinematics from the configuration at their beginning: what holds at every pose of an edge holds for
the arm.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bt_dualarm.collision.checker import FINE, CollisionChecker
from bt_dualarm.core.errors import Failure, Number
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.planning.pose_tree import REACH_M, SAME, TO_GOAL, Meeting, PoseTrees, apart
from bt_dualarm.planning.problem import (
    PlanningProblem,
    motion_around,
    outline,
    refuse_contact,
)
from bt_dualarm.robots.robot import Robot
from bt_dualarm.spec.node_types import counted
from bt_dualarm.trajectory.path_timing import time_path
from bt_dualarm.trajectory.paths import blended, line
from bt_dualarm.trajectory.trajectory import Trajectory

MARGIN_RAD = math.radians(0.5)
"""Angle by which plans stay inside a cone: what servo and spline may add during the motion."""

MARGIN_M = 0.002
"""Distance by which plans stay inside a range of heights, m."""

POSES = 40_000
"""Maximum number of poses of which a search solves the inverse kinematics: a few seconds."""

_BLEND_M = 0.05  # distance from a corner at which it may be rounded
_SPUN = 0.6  # fraction of the samples that are rotated about the vertical
_COARSE = (0.008, 0.02)  # distance in m and rotation in rad between two samples of an edge
_FREE = 40_000  # configurations that are checked in a search without the constraint
_RESTARTS = 4  # trees that are begun again: the branch depends on the route to a pose
_SELF_MOTION_RAD = 0.05  # step of the joints while the tool rests
_TINY = 1e-6  # distance, angle or length that counts as none
_SHORTCUTS = 30
_ARRIVALS = 10  # at the goal pose in one other configuration, after which no path is expected
_NOT_REDUNDANT = 6  # joints of an arm whose branch, hence its configuration, a path decides
_SAME_RAD = 1e-3  # largest distance of the joints in one configuration
_PROJECTIONS = 4  # rounds in which two cones are satisfied together


@dataclass(frozen=True, eq=False)
class Cone:
    """Cone in which an axis of a frame stays.

    Attributes:
        name: Name in messages and metrics.
        axis: Axis in the frame, of unit length, of shape (3,).
        most: Largest angle between the axis and the center of the cone, rad.
        direction: Center of the cone in the world, of unit length, of shape (3,); None if it leads
            to a point.
        point: Point in the world to which the center leads, of shape (3,), m.
    """

    name: str
    axis: Vector
    most: float
    direction: Vector | None = None
    point: Vector | None = None

    def angle(self, pose: Pose) -> float:
        """Angle between the axis and the center of the cone, rad."""
        axis = pose.turn(self.axis)
        center = self._center(pose)
        return math.atan2(float(np.linalg.norm(np.cross(axis, center))), float(axis @ center))

    def projected(self, pose: Pose, most: float) -> Pose:
        """Pose turned about its origin by the smallest angle so that it keeps an angle, rad."""
        beyond = self.angle(pose) - most
        if beyond <= 0.0:
            return pose
        axis = pose.turn(self.axis)
        about = np.cross(axis, self._center(pose))
        length = float(np.linalg.norm(about))
        if length < _TINY:  # opposite: any axis at a right angle
            about = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
            length = float(np.linalg.norm(about))
        half = 0.5 * beyond
        turn = Pose(np.zeros(3), np.array((math.cos(half), *(math.sin(half) * about / length))))
        turned = turn @ Pose(np.zeros(3), pose.quaternion)
        return Pose(pose.position, turned.quaternion)

    def _center(self, pose: Pose) -> Vector:
        if self.direction is not None:
            return self.direction
        assert self.point is not None  # noqa: S101 - one of the two is given
        to = self.point - pose.position
        return np.asarray(to / max(float(np.linalg.norm(to)), _TINY), float)


@dataclass(frozen=True)
class Violation:
    """By how much a pose violates a constraint; 0 where it does not.

    Attributes:
        rad: Largest angle beyond a cone.
        m: Distance beyond the range of heights.
        what: What is violated most, with its value and its limit, for messages.
    """

    rad: float = 0.0
    m: float = 0.0
    what: str = ""

    def __bool__(self) -> bool:
        return self.rad > 0.0 or self.m > 0.0


@dataclass(frozen=True, eq=False)
class PathConstraint:
    """Limits of the pose of a frame that moves with the tool; can be pickled.

    Attributes:
        robot: Robot of the arm.
        base: Pose of its base link in the world.
        in_tool: Pose of the frame in the tool.
        cones: Cones in which axes of the frame stay.
        lowest: Minimum height of its origin in the world, m.
        highest: Largest height of its origin in the world, m.
    """

    robot: Robot
    base: Pose
    in_tool: Pose
    cones: tuple[Cone, ...] = ()
    lowest: float = -math.inf
    highest: float = math.inf

    def violation(self, frame: Pose) -> Violation:
        """Violation by a pose of the frame in the world."""
        rad = 0.0
        what = ""
        for cone in self.cones:
            angle = cone.angle(frame)
            if angle - cone.most > rad:
                rad = angle - cone.most
                what = f"{cone.name}: {math.degrees(angle):.1f}° of {math.degrees(cone.most):.3g}°"
        height = float(frame.position[2])
        m = max(self.lowest - height, height - self.highest, 0.0)
        if m > 0.0:
            limits = f"{self.lowest:.4g} to {self.highest:.4g} m"
            what = f"{what}; " * bool(what) + f"height: {height:.4f} m, not {limits}"
        return Violation(rad, m, what)

    def of_tool(self, tool: Pose) -> Violation:
        """Violation by a pose of the tool in the world."""
        return self.violation(tool @ self.in_tool)

    def within(self, *frames: Pose) -> PathConstraint:
        """Constraint with a margin inside, but no stricter than poses that it has to admit."""
        cones = tuple(
            replace(
                cone,
                most=min(
                    cone.most,
                    max(
                        cone.most - min(MARGIN_RAD, 0.2 * cone.most),
                        *(cone.angle(frame) + _TINY for frame in frames),
                    ),
                ),
            )
            for cone in self.cones
        )
        heights = [float(frame.position[2]) for frame in frames]
        margin = min(MARGIN_M, 0.2 * (self.highest - self.lowest))
        lowest = max(self.lowest, min(self.lowest + margin, *(h - _TINY for h in heights)))
        highest = min(self.highest, max(self.highest - margin, *(h + _TINY for h in heights)))
        return replace(self, cones=cones, lowest=lowest, highest=highest)

    def projected(self, frame: Pose) -> Pose:
        """Pose of the frame nearest to a given one that keeps the limits, as far as possible."""
        x, y, z = frame.position.tolist()
        pose = Pose(np.array((x, y, min(max(z, self.lowest), self.highest))), frame.quaternion)
        for _ in range(_PROJECTIONS if len(self.cones) > 1 else 1):
            for cone in self.cones:
                pose = cone.projected(pose, cone.most)
        return pose

    def along(self, kinematics: Kinematics, rows: Matrix) -> tuple[float, Violation] | None:
        """First violation along configurations, of shape (n, dof), rad, with its share of them."""
        for i, q in enumerate(rows):
            violation = self.of_tool(kinematics.forward(q))
            if violation:
                return i / max(len(rows) - 1, 1), violation
        return None

    @property
    def names(self) -> str:
        """What it limits, for messages."""
        limited = [cone.name for cone in self.cones]
        if self.lowest > -math.inf or self.highest < math.inf:
            limited.append("height")
        return " and ".join(limited)


@dataclass(frozen=True, eq=False)
class ConstrainedProblem:
    """Motion planning problem with a path constraint; can be pickled.

    Attributes:
        problem: Admitted problem without it.
        keep: Path constraint.
        poses: Maximum number of poses of which the search solves the inverse kinematics.
        at_goals: Whether the motion has to end in one of the configurations of the problem, not
            only with the tool there.
    """

    problem: PlanningProblem
    keep: PathConstraint
    poses: int = POSES
    at_goals: bool = False

    @property
    def planner(self) -> str:
        """Name of the planner, for messages."""
        return "RRT"

    def motion(self, abandoned: Callable[[], bool] = lambda: False) -> Trajectory:
        """Motion to the tool pose of the preferred goal that keeps the constraint.

        Unless ``at_goals``, it may end in another configuration than the goals given, with the tool
        at the same pose.

        Args:
            abandoned: Polled during the search; ends it when the plan is no longer needed.

        Raises:
            Failure: ``NO_PLAN``.
        """
        return _ConstrainedSearch(self, abandoned).motion()

    def keeps(self, motion: Trajectory) -> bool:
        """Whether a motion keeps the constraint with its margin."""
        kinematics = Kinematics(self.keep.robot, self.keep.base, self.problem.seed)
        ends = (kinematics.forward(motion.q[0]), kinematics.forward(motion.q[-1]))
        strict = self.keep.within(*(tool @ self.keep.in_tool for tool in ends))
        rows = outline(motion, self.problem.checker.radii, FINE)
        return strict.along(kinematics, rows) is None


class _ConstrainedSearch:
    """Search for one motion; arguments as `ConstrainedProblem.motion`."""

    def __init__(self, given: ConstrainedProblem, abandoned: Callable[[], bool]) -> None:
        problem = given.problem
        self._problem = problem
        self._given = given
        self._abandoned = abandoned
        self._kinematics = Kinematics(given.keep.robot, given.keep.base, problem.seed)
        self._to_tool = given.keep.in_tool.inverse
        self._start = self._kinematics.forward(problem.start) @ given.keep.in_tool
        self._goal = self._kinematics.forward(problem.goals[0]) @ given.keep.in_tool
        self._strict = given.keep.within(self._start, self._goal)
        self._rng = np.random.default_rng(problem.seed)
        self._count = 0
        self._checker: CollisionChecker = problem.checker
        self._elsewhere: Vector | None = None
        self._arrivals = 0

    def motion(self) -> Trajectory:
        """See `ConstrainedProblem.motion`."""
        found = self._ending_at_goal(self._timed([self._start, self._goal]))
        if found is not None:
            return found
        if not self._given.keep.cones:  # often kept without a search for it
            with contextlib.suppress(Failure):
                free = motion_around(replace(self._problem, checks=_FREE), self._abandoned)
                if self._given.keeps(free):
                    return free
        goals = itertools.cycle(self._problem.goals)
        while not self._is_over(self._given.poses):
            found = self._around(next(goals), self._count + self._given.poses // _RESTARTS)
            if found is not None:
                return found
        if self._abandoned():
            raise Failure("INTERRUPTED", "this plan is no longer needed")
        numbers: dict[str, Number] = {"planner": self._given.planner, "states": self._count}
        ends = ""
        if self._arrivals >= _ARRIVALS:
            ends = ", except to another configuration at the goal, in which it may not end"
        raise Failure(
            "NO_PLAN",
            f"no collision-free path was found along which the arm keeps {self._strict.names}"
            f"{ends} ({counted(self._count, 'pose')})",
            **numbers,
        )

    def _is_over(self, poses: int) -> bool:
        """Whether a search ends without a path.

        An arm of six joints that keeps an axis upright hardly ever leaves its branch: where it
        arrives in the same other configuration by one path after another, no path is expected.
        """
        return self._count >= poses or self._arrivals >= _ARRIVALS or self._abandoned()

    def _around(self, goal: Vector, last: int) -> Trajectory | None:
        """Motion around obstacles; None if none was found with this many poses.

        Args:
            goal: Configuration at the goal from which a tree grows, of shape (dof,), rad.
            last: Number of poses after which the search ends.
        """
        q = self._problem.start
        trees = PoseTrees(self._start, self._goal, q, goal, self._step, self._edge)
        low = np.minimum(self._start.position, self._goal.position) - REACH_M
        high = np.maximum(self._start.position, self._goal.position) + REACH_M
        while not self._is_over(last):
            self._count += 1
            target = self._goal
            if self._rng.random() > TO_GOAL:
                target = self._sample(low, high)
            meeting = trees.grow(target)
            if meeting is None:
                continue
            corners = meeting.corners
            if self._rows(corners, q) is not None:
                found = self._ending_at_goal(self._timed(self._shortened(corners, q)))
                if found is not None or not self._given.at_goals:
                    return found
            found = self._joined(meeting, goal)
            if found is not None:
                return found
        return None

    def _ending_at_goal(self, motion: Trajectory | None) -> Trajectory | None:
        """A motion to the tool pose of the goal; None if it has to end at a goal, and does not.

        A redundant arm gets there by a motion of the joints alone.
        """
        if motion is None or not self._given.at_goals:
            return motion
        for goal in self._problem.goals:
            last = motion.q[-1]
            if np.abs(last - goal).max() < _TINY:
                return motion
            rest = self._self_motion(self._goal, last, goal)
            if rest is not None:
                turn = time_path(rest, self._problem.limits, self._problem.dt)
                longer = motion.then(turn)
                if self._is_free(longer):
                    return longer
        last = motion.q[-1]
        if self._elsewhere is None or float(np.abs(last - self._elsewhere).max()) > _SAME_RAD:
            self._elsewhere = last
            self._arrivals = 0
        if len(last) <= _NOT_REDUNDANT:
            self._arrivals += 1
        return None

    def _joined(self, meeting: Meeting, goal: Vector) -> Trajectory | None:
        """Motion along both paths to a meeting, with a motion of the joints alone between them.

        A redundant arm arrives there in another configuration from either side; it then moves while
        its tool rests. None if that is not free, or the two are of different branches.

        Args:
            meeting: Where two trees met.
            goal: Configuration at the goal from which the second one grew, of shape (dof,), rad.
        """
        start = self._problem.start
        short = self._shortened(meeting.from_start, start), self._shortened(meeting.from_goal, goal)
        for from_start, from_goal in (short, (meeting.from_start, meeting.from_goal)):
            found = self._between_halves(from_start, from_goal, goal)
            if found is not None:
                return found
        return None

    def _between_halves(
        self, from_start: Sequence[Pose], from_goal: Sequence[Pose], goal: Vector
    ) -> Trajectory | None:
        """As `_joined`, for corners from the start and from the goal to the pose of the meeting."""
        begin = self._rows(from_start, self._problem.start)
        end = self._rows(from_goal, goal)
        if begin is None or end is None:
            return None
        first = begin[-1][-1] if begin else self._problem.start
        second = end[-1][-1] if end else goal
        between = self._self_motion(from_start[-1], first, second)
        if between is None:
            return None
        motion = Trajectory.rest(self._problem.start, self._problem.dt)
        for rows in (*begin, between, *(rows[::-1] for rows in reversed(end))):
            motion = motion.then(time_path(rows, self._problem.limits, self._problem.dt))
        return motion if self._is_free(motion) else None

    def _self_motion(self, frame: Pose, first: Vector, second: Vector) -> Matrix | None:
        """Configurations with a resting tool between two of these; None if there is a jump."""
        tool = frame @ self._to_tool
        steps = math.ceil(float(np.abs(second - first).max()) / _SELF_MOTION_RAD) + 1
        rows = [first]
        for share in np.linspace(0.0, 1.0, steps + 1)[1:-1]:
            self._count += 1
            try:
                q = self._kinematics.solve(tool, first + share * (second - first))
            except Failure:
                return None
            rows.append(q)
        rows.append(second)
        path = np.array(rows)
        is_smooth = np.abs(np.diff(path, axis=0)).max() < 2.0 * _SELF_MOTION_RAD
        return path if is_smooth and self._checker.first_contact(path) is None else None

    def _sample(self, low: Vector, high: Vector) -> Pose:
        """Random pose of the frame, projected onto the constraint."""
        share = float(self._rng.random())
        turned = _between(self._start, self._goal, share)
        quaternion = turned.quaternion
        if self._rng.random() < _SPUN:
            spin = Pose.from_rpy((0, 0, 0), (0.0, 0.0, float(self._rng.uniform(-np.pi, np.pi))))
            quaternion = (spin @ Pose(np.zeros(3), quaternion)).quaternion
        return self._strict.projected(Pose(self._rng.uniform(low, high), quaternion))

    def _step(self, start: Pose, end: Pose, share: float) -> Pose:
        """Pose at a fraction of the way between two others, projected onto the constraint."""
        if share < 1.0:
            end = _between(start, end, share)
        return end if end is self._goal else self._strict.projected(end)

    def _edge(self, start: Pose, end: Pose, q: Vector) -> Vector | None:
        """Configuration at the end of a straight edge; None if it is not free, or not kept."""
        rows = self._edge_rows(start, end, q)
        if rows is None:
            return None
        last: Vector = rows[-1]
        return last

    def _edge_rows(self, start: Pose, end: Pose, q: Vector) -> Matrix | None:
        """Configurations along a straight edge, of shape (n, dof), rad; None as for `_edge`."""
        frames = line(start, end, *_COARSE).poses
        if any(self._strict.violation(frame) for frame in frames):
            return None
        self._count += len(frames)
        try:
            rows = self._kinematics.follow_on([frame @ self._to_tool for frame in frames], q)
        except Failure:
            return None
        return None if self._checker.first_contact(rows) is not None else rows

    def _rows(self, corners: Sequence[Pose], q: Vector) -> list[Matrix] | None:
        """Configurations along each edge from a configuration; None if one is not free."""
        found = []
        for here, there in itertools.pairwise(corners):
            rows = self._edge_rows(here, there, q)
            if rows is None:
                return None
            found.append(rows)
            q = rows[-1]
        return found

    def _shortened(self, corners: list[Pose], q: Vector) -> list[Pose]:
        """Fewer corners from a configuration on, as far as straight edges between them are free."""
        for _ in range(_SHORTCUTS):
            if len(corners) < 3 or self._abandoned():
                break
            i, j = sorted(self._rng.choice(len(corners), 2, replace=False).tolist())
            if j == i + 1:
                continue
            shorter = [*corners[: i + 1], *corners[j:]]
            if self._rows(shorter, q) is not None:
                corners = shorter
        return corners

    def _timed(self, corners: Sequence[Pose]) -> Trajectory | None:
        """Motion along straight lines, with rounded corners where possible; None if not free."""
        stops = [corners[0]]
        stops += [pose for pose in corners[1:] if apart(pose, stops[-1]) > SAME]
        if len(stops) < 2:  # already there
            return Trajectory.rest(self._problem.start, self._problem.dt)
        attempts = [[blended(stops, _BLEND_M).poses]] if len(stops) > 2 else []
        attempts.append([line(here, there).poses for here, there in itertools.pairwise(stops)])
        for pieces in attempts:
            motion = self._followed(pieces)
            if motion is not None:
                return motion
        return None

    def _followed(self, pieces: Sequence[Sequence[Pose]]) -> Trajectory | None:
        """Motion along pieces of a path, with a stop after each; None if it is not free."""
        motion = Trajectory.rest(self._problem.start, self._problem.dt)
        q = self._problem.start
        for frames in pieces:
            if any(self._strict.violation(frame) for frame in frames):
                return None
            self._count += len(frames)
            try:
                rows = self._kinematics.follow_on([one @ self._to_tool for one in frames], q)
                piece = time_path(rows, self._problem.limits, self._problem.dt)
            except Failure:
                return None
            motion = motion.then(piece)
            q = rows[-1]
        return motion if self._is_free(motion) else None

    def _is_free(self, motion: Trajectory) -> bool:
        """Whether a motion touches nothing and keeps the constraint."""
        try:
            refuse_contact(self._checker, motion)
        except Failure:
            return False
        rows = outline(motion, self._checker.radii, FINE)
        return self._given.keep.along(self._kinematics, rows) is None


def _between(start: Pose, end: Pose, share: float) -> Pose:
    """Pose at a share of the straight line between two others."""
    step = start.inverse @ end
    w = float(np.clip(step.quaternion[0], -1.0, 1.0))
    vector = step.quaternion[1:] if w >= 0.0 else -step.quaternion[1:]
    sine = float(np.linalg.norm(vector))
    position = start.position + share * (end.position - start.position)
    if sine < 1e-12:
        return Pose(position, start.quaternion)
    half = share * math.atan2(sine, abs(w))
    turn = Pose(np.zeros(3), np.array((math.cos(half), *(math.sin(half) * vector / sine))))
    return Pose(position, (Pose(np.zeros(3), start.quaternion) @ turn).quaternion)
