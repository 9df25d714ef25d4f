"""Motion planning of one arm: from a problem to a collision-free path and a timed motion.

A straight line in joint space is taken if it is free. Otherwise OMPL searches a path, with compiled
checks of whole edges (`CompiledEdges`); what its RRT-Connect does not find soon is searched by one
for narrow passages (`CompiledRRTConnect`). The corners are then rounded as far as obstacles allow,
and the path is timed.

Planning is in scaled joint angles, the distance in m that the farthest point of the arm moves, so
that one resolution holds for shoulder and wrist alike. A search ends after a number of checks, not
after a time: its result depends on the problem and its seed alone.

- `PlanningProblem`, `admitted`, `straight_motion` and `motion_around` plan a motion to a goal.
- `refuse_contact` and `refuse_infeasible` check a motion from any other source.
- `trace` follows a Cartesian path of the tool.
- `yielding_configurations` proposes where an arm can wait out of the others' way.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bt_dualarm.collision.checker import FINE, CollisionChecker, interpolated
from bt_dualarm.collision.swept import (
    CompiledEdges,
    Edges,
    SampledEdges,
    UnknownShapeError,
    is_clear,
    is_path_free,
    path_length,
    swept_arm,
)
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics, refuse_beyond
from bt_dualarm.planning.path_search import (
    DEFAULT_PLANNER,
    ArmChecks,
    Budget,
    CompiledRRTConnect,
    OmplSearch,
    Planner,
    shortened,
)
from bt_dualarm.robots.robot import JointLimits, Robot
from bt_dualarm.trajectory.path_timing import TimedPath, point_to_point, time_path, timed_path
from bt_dualarm.trajectory.paths import CartesianPath, corner_curve
from bt_dualarm.trajectory.set_points import keeps_rates
from bt_dualarm.trajectory.trajectory import LONG, Trajectory

_SHORT_CHECKS = 500
"""Maximum number of checks of the short search. With 1,000, OMPL solves 5 % more problems of
`benchmarks.scenes`, and those that it does not solve take half as long again."""

_SAME_S = 1e-9
"""Largest difference of two periods that are the same, s."""

_AT_REST_RAD_S = 1e-3
"""Velocity up to which a motion ends at rest, rad/s."""

_BEYOND_RAD = 1e-3
"""How far the spline of a path may exceed a position limit between its samples, rad: 0.3 mrad where
a straight path of the tool ends at the limit. The controller sends nothing beyond it."""

_SAME_RAD = 1e-3
"""Difference of a position from what the velocities before make of it, rad: the trapezoids that
are compared with it are off by less than a tenth of that."""

_SHORT_EDGE = 1.0
"""Longest edge of the short search, as motion of the arm, m."""

_SHORT_RANGE = np.pi / 2
"""Range of the samples of the short search beyond the ends, rad: most paths need no more."""

_PATHS = 3
"""Maximum number of paths of which the short search takes the shortest: the first one that
RRT-Connect finds depends on luck."""

_ATTEMPTS = ((1.5, 0.1), (0.7, 0.4), (0.35, 1.0))
"""Longest edge of the search trees, as motion of the arm in m, and the share of all checks after
which the next one is tried: long edges are fast, short ones find narrow passages."""

CHECKS = 240_000
"""Maximum number of configurations that are checked; a few seconds."""

ROOM_M = 2e-3
"""Distance that a motion keeps from everything but the arm itself if there is such a motion, m: at
full speed an arm is off by 0.6 mm in `lab`, and more in `rough`."""

_STRAIGHT = 2.0 * ROOM_M
"""Largest motion of a point of the arm between two checks of a straight motion, m: between them it
may cut off a right-angled edge by half of that, but then it does not keep `ROOM_M`."""

QUICK_CHECKS = 30_000
"""The same for a search that often fails, or is one of many; about a second. A motion to one of
`PlanningProblem.turned` is mostly found within a thousand: the joint then rotates freely."""

_ROOMY_CHECKS = 30_000
"""Maximum number of checks of the search for such a motion, before one without that distance."""

_SAMPLES = 12
"""Number of configurations of a path at which MuJoCo confirms the result of the compiled search."""

_NEAR_ENDS_M = 0.005
"""Motion of the arm from either end within which MuJoCo confirms all configurations, m: there the
arm may be in an allowed contact."""

_CUTS = (0.5, 0.3, 0.18, 0.1, 0.05)
"""Shares of the shorter segment at a corner that are tried for its blend, longest first."""

_SPACING = 0.02
"""Largest motion of a point of the arm between two samples, m."""

_ELSEWHERE_M = 0.3
"""Minimum motion of some part of an arm that moves aside, m."""

_YIELD_SAMPLES = 60
"""Number of random candidates for a configuration out of the way in one draw."""

_YIELD_DRAWS = 10
"""Maximum number of draws: few candidates are free in the middle of other arms."""

_CHOICES = 3
"""Largest number of configurations out of the way that are proposed."""

_TURN_COST = 0.05
"""Gain of distance that a radian of joint motion must be worth, m/rad."""


@dataclass(frozen=True, eq=False)
class PlanningProblem:
    """Everything that a plan depends on; can be pickled, and has the same solution in any process.

    Attributes:
        checker: Collision checker of the arm, with the world as it was when created.
        start: Configuration of shape (dof,), rad.
        goals: Configurations, each of shape (dof,), rad, the preferred one first; at least one.
        limits: Limits of the arm, scaled by the speed.
        dt: Time between set-points, s.
        seed: Seed of the random search; at least 0.
        planner: Name of the planner that searches if the straight path is not free.
        checks: Maximum number of configurations that are checked.
        roomy: Stricter checker, by which a motion is searched first; None for none.
        turned: Goals with joints rotated by whole turns, nearest first: tried only if no motion to
            one of ``goals`` was found.
    """

    checker: CollisionChecker
    start: Vector
    goals: tuple[Vector, ...]
    limits: JointLimits
    dt: float
    seed: int = 0
    planner: Planner = DEFAULT_PLANNER
    checks: int = CHECKS
    roomy: CollisionChecker | None = None
    turned: tuple[Vector, ...] = ()

    @property
    def straight(self) -> Matrix:
        """Straight path to the preferred goal, of shape (2, dof), rad, free or not."""
        return np.array((self.start, self.goals[0]))


def admitted(problem: PlanningProblem) -> PlanningProblem:
    """The same problem with valid goals only, and a checker that is stricter between the ends.

    Raises:
        Failure: ``IN_COLLISION`` or ``JOINT_LIMIT`` of the start, or of the preferred goal if no
            goal is valid.
    """
    _check_end(problem, problem.start)
    refusals = []
    goals = []
    for goal in problem.goals:
        try:
            _check_end(problem, goal)
        except Failure as refusal:
            # Its traceback refers to this frame, which must not refer back: it would stay.
            refusals.append(refusal.with_traceback(None))
        else:
            goals.append(goal)
    if not goals:
        raise refusals.pop(0)
    ends = problem.start, *goals
    strict = problem.checker.without_new_contacts(ends)
    return replace(
        problem,
        checker=strict,
        goals=tuple(goals),
        roomy=strict.keeping(ROOM_M, ends),
        turned=tuple(q for q in problem.turned if strict.free(q)),
    )


def _check_end(problem: PlanningProblem, q: Vector) -> None:
    refuse_beyond(problem.checker.joints, q, problem.limits)
    contact = problem.checker.contact(q)
    if contact is not None:
        raise contact.failure()


def straight_motion(problem: PlanningProblem) -> Trajectory | None:
    """Straight motion to the preferred goal of an admitted problem; None if it is not free.

    It keeps `ROOM_M`: one that does not is taken by `motion_around` if it finds none that does.
    """
    if not is_free(problem.roomy or problem.checker, problem.straight):
        return None
    return point_to_point(problem.start, problem.goals[0], problem.limits, problem.dt)


def motion_around(
    problem: PlanningProblem, abandoned: Callable[[], bool] = lambda: False
) -> Trajectory:
    """Motion around obstacles to one of the goals of an admitted problem.

    Args:
        problem: Admitted problem whose straight path is not free, or does not keep `ROOM_M`.
        abandoned: Polled during the search; ends it when the plan is no longer needed.

    Raises:
        Failure: ``NO_PLAN``.
    """
    if problem.turned:
        try:
            return motion_around(replace(problem, turned=()), abandoned)
        except Failure as failure:
            if failure.code != "NO_PLAN":
                raise
            refusal = failure.with_traceback(None)  # would keep this frame alive
        try:
            checks = min(problem.checks, QUICK_CHECKS)
            turned = replace(problem, goals=problem.turned, turned=(), checks=checks)
            return motion_around(turned, abandoned)
        except Failure as failure:
            raise (refusal if failure.code == "NO_PLAN" else failure) from None
    if problem.roomy is not None:
        close = replace(problem, roomy=None)
        checks = min(problem.checks, _ROOMY_CHECKS)
        try:
            return motion_around(replace(close, checker=problem.roomy, checks=checks), abandoned)
        except Failure as failure:
            if failure.code != "NO_PLAN":
                raise
        straight = straight_motion(close)
        return motion_around(close, abandoned) if straight is None else straight
    path = path_around(problem, abandoned)
    motion = Trajectory.rest(path.corners[0], problem.dt)
    for piece in rounded(path.corners, problem.checker.radii, path.is_free):
        motion = motion.then(time_path(piece, problem.limits, problem.dt))
    if path.is_dense_path_free(outline(motion, problem.checker.radii, FINE)):
        return motion
    try:
        refuse_contact(problem.checker, motion)
    except Failure:
        # The spline deviates from its samples by more than the clearance: go straight from corner
        # to corner instead, and stop at each.
        motion = Trajectory.rest(path.corners[0], problem.dt)
        for begin, end in itertools.pairwise(path.corners):
            motion = motion.then(point_to_point(begin, end, problem.limits, problem.dt))
    return motion


@dataclass(frozen=True, eq=False)
class PathSearch:
    """Collision-free path of straight segments in joint space, and the checks it was found with.

    Attributes:
        corners: Corners, of shape (n, dof), rad.
        checker: Collision checker of the path.
        edges: Collision checks of its segments.
        by_ompl: Whether a planner of OMPL found it, not the compiled one.
    """

    corners: Matrix
    checker: CollisionChecker
    edges: Edges
    by_ompl: bool = True

    def is_free(self, corners: Matrix) -> bool:
        """Whether another path, given by its corners of shape (n, dof), rad, is free."""
        return is_path_free(self.edges, corners)

    def is_dense_path_free(self, rows: Matrix) -> bool:
        """Whether a dense path, of shape (n, dof), rad, is free by the compiled checks."""
        radii = self.checker.radii
        if not isinstance(self.edges, CompiledEdges):
            return False
        if not self.edges.is_dense_path_free(rows, radii):
            return False
        moved = np.abs(np.diff(rows, axis=0)) @ radii
        first = int((np.cumsum(moved) < _NEAR_ENDS_M).sum())
        last = int((np.cumsum(moved[::-1]) < _NEAR_ENDS_M).sum())
        return _is_confirmed(
            self.checker, rows, (*range(first), *range(len(rows) - last, len(rows)))
        )


def path_around(
    problem: PlanningProblem, abandoned: Callable[[], bool] = lambda: False
) -> PathSearch:
    """Collision-free path to one of the goals.

    Args:
        problem: Admitted problem whose straight path is not free.
        abandoned: Polled during the search; ends it when the plan is no longer needed.

    Raises:
        Failure: ``NO_PLAN``.
    """
    checker = problem.checker
    with contextlib.suppress(UnknownShapeError):
        edges = CompiledEdges(swept_arm(checker, (problem.start, *problem.goals)))
        arm = ArmChecks(checker, edges, problem.limits, Budget(abandoned))
        path = None
        if problem.planner == DEFAULT_PLANNER:
            path = _short_search(problem, arm)
            by_ompl = path is not None
            if path is None:
                path = _through_narrow_passages(problem, arm, edges)
        else:
            path = _long_search(problem, arm)
            by_ompl = True
        if path is None:
            raise _no_plan(problem, arm.budget)
        path = _shorter_straight(problem, edges, path)
        # MuJoCo has the last word on a path that compiled code has found.
        if _is_confirmed(checker, path):
            return PathSearch(path, checker, edges, by_ompl)
    sampled = SampledEdges(checker)
    arm = ArmChecks(checker, sampled, problem.limits, Budget(abandoned))
    path = _long_search(problem, arm)
    if path is None:
        raise _no_plan(problem, arm.budget)
    return PathSearch(_shorter_straight(problem, sampled, path), checker, sampled)


def _is_confirmed(checker: CollisionChecker, rows: Matrix, more: Sequence[int] = ()) -> bool:
    """Whether MuJoCo finds no contact in a sample of configurations, which includes both ends."""
    picked = np.linspace(0, len(rows) - 1, _SAMPLES).astype(int).tolist()
    return all(checker.free(rows[i]) for i in {*picked, *more})


def _short_search(problem: PlanningProblem, arm: ArmChecks) -> Matrix | None:
    """Shortest of a few paths to the preferred goal that OMPL finds soon; None if it finds none."""
    arm.budget.limit = min(_SHORT_CHECKS, problem.checks)
    paths: list[Matrix] = []
    while len(paths) < _PATHS and not arm.budget.is_spent():
        seed = problem.seed + 1 + len(paths)
        search = OmplSearch(arm, problem.start, problem.goals[:1], seed, _SHORT_RANGE)
        path = search.run(DEFAULT_PLANNER, _SHORT_EDGE)
        if path is None:
            break
        paths.append(path)
    return min(paths, key=lambda path: path_length(path, arm.checker.radii), default=None)


def _through_narrow_passages(
    problem: PlanningProblem, arm: ArmChecks, edges: CompiledEdges
) -> Matrix | None:
    """Path to one of the goals that the compiled RRT-Connect finds; None if it finds none."""
    radii = arm.checker.radii
    before = edges.checked
    search = CompiledRRTConnect(
        edges, problem.start, problem.goals, problem.limits, radii, problem.seed
    )
    path = search.path(problem.checks, arm.budget.is_abandoned)
    arm.budget.count_checks(edges.checked - before)
    return None if path is None else shortened(path, arm, problem.seed + 1)


def _long_search(problem: PlanningProblem, arm: ArmChecks) -> Matrix | None:
    """Path to one of the goals that the problem's planner of OMPL finds; None if it finds none.

    A short search to the preferred goal comes first, then longer ones to any goal.
    """
    seed = problem.seed
    for number, (longest_edge, share) in enumerate(_ATTEMPTS):
        goals = problem.goals if number else problem.goals[:1]
        arm.budget.limit = round(share * problem.checks)
        while not arm.budget.is_spent():
            seed += 1
            search = OmplSearch(arm, problem.start, goals, seed)
            path = search.run(problem.planner, longest_edge)
            if path is None:
                break  # on to the next edge length
            # Shortcuts split edges; samples of the parts are not those of the whole.
            if is_path_free(arm.edges, path):
                return path
    return None


def _shorter_straight(problem: PlanningProblem, edges: Edges, path: Matrix) -> Matrix:
    """Shortest free straight path to a goal if shorter than the given path; otherwise that path."""
    radii = problem.checker.radii
    straight = [np.array((problem.start, goal)) for goal in problem.goals]
    lengths = [path_length(corners, radii) for corners in straight]
    most = path_length(path, radii)
    for length, corners in sorted(zip(lengths, straight, strict=True), key=lambda pair: pair[0]):
        if length < most and is_path_free(edges, corners):
            return corners
    return path


def _no_plan(problem: PlanningProblem, budget: Budget) -> Failure:
    if budget.given_up:
        return Failure("INTERRUPTED", "this plan is no longer needed")
    goals = "" if len(problem.goals) == 1 else f" to any of {len(problem.goals)} configurations"
    return Failure(
        "NO_PLAN",
        f"no collision-free path{goals} was found "
        f"({problem.planner}, {budget.states} configurations)",
        planner=problem.planner,
        states=budget.states,
    )


def is_free(checker: CollisionChecker, corners: Matrix) -> bool:
    """Whether straight lines from corner to corner, of shape (n, dof), are free of collisions."""
    clear = is_clear(checker, corners)
    if clear is not None:
        return clear
    pieces = (interpolated(a, b, checker.radii, _STRAIGHT) for a, b in itertools.pairwise(corners))
    # Between two rows no point moves by more than that: too little to pass through a thin wall.
    return all(checker.first_contact(rows) is None for rows in pieces)


def rounded(corners: Matrix, radii: Vector, is_free: Callable[[Matrix], bool]) -> list[Matrix]:
    """Smooth pieces, each of shape (m, dof), rad, along a path given by its corners.

    At a corner that cannot be rounded without a collision, one piece ends and the next begins: the
    arm stops there.

    Args:
        corners: Corners of the path, of shape (n, dof), rad.
        radii: Largest motion of the arm per radian of each joint, of shape (dof,), m/rad.
        is_free: Whether a path of straight segments, given by its corners, is free.
    """
    pieces: list[list[Matrix]] = [[]]
    begin = corners[0]
    for i in range(1, len(corners) - 1):
        cut = _cut(corners[i - 1], corners[i], corners[i + 1], radii, is_free)
        end = corners[i] if cut is None else cut[0]
        pieces[-1].append(interpolated(begin, end, radii, _SPACING))
        if cut is None:
            pieces.append([])
            begin = corners[i]
        else:
            pieces[-1].append(cut)
            begin = cut[-1]
    pieces[-1].append(interpolated(begin, corners[-1], radii, _SPACING))
    return [np.vstack(piece) for piece in pieces]


def _cut(
    before: Vector,
    corner: Vector,
    after: Vector,
    radii: Vector,
    is_free: Callable[[Matrix], bool],
) -> Matrix | None:
    """Longest free blend of a corner between its two segments; None if there is none."""
    arriving = before - corner
    leaving = after - corner
    # Equal shares of motion on both sides, so that the blend is symmetric in the arm's motion.
    length = min(np.abs(arriving) @ radii, np.abs(leaving) @ radii)
    for share in _CUTS:
        start = corner + arriving * (share * length / (np.abs(arriving) @ radii))
        end = corner + leaving * (share * length / (np.abs(leaving) @ radii))
        curve = corner_curve(start, corner, end)
        if is_free(curve):
            return curve
    return None


def refuse_contact(checker: CollisionChecker, path: Matrix | Trajectory) -> None:
    """Check configurations as they will be sent, every `FINE` meters.

    Contacts that exist at neither end are not tolerated in between, however shallow: of a thin
    obstacle between two checks, either may show no more than a shallow contact. Neither are
    contacts of the arm with itself that exist at the end only.

    Args:
        checker: Collision checker.
        path: Configurations, of shape (n, dof), rad, or a trajectory.

    Raises:
        Failure: ``IN_COLLISION`` at the first configuration in contact.
    """
    radii = checker.radii
    rows = outline(path, radii, FINE) if isinstance(path, Trajectory) else path
    start = rows[0]
    strict = checker.without_new_contacts((start, rows[-1]), start)
    if is_clear(strict, rows):
        return
    last = rows[0]
    for i, q in enumerate(rows):
        # Skip a row if the next one is still within FINE of the last one checked; never an end.
        if 0 < i < len(rows) - 1:
            moved = abs(q - last) @ radii
            ahead = float(abs(rows[i + 1] - rows[i]) @ radii)
            if moved + ahead <= FINE:
                continue
        last = q
        contact = strict.contact(q)
        if contact is not None:
            raise contact.failure()


def refuse_infeasible(motion: Trajectory, robot: Robot, period: float) -> None:
    """Check that an arm can follow a motion: skills may have made it in any way.

    Args:
        motion: The motion.
        robot: Description of the arm.
        period: Seconds between two set-points of its controller.

    Raises:
        Failure: ``INVALID_TARGET`` with the reason; ``JOINT_LIMIT``.
    """
    q, v, a = motion.q, motion.v, motion.a
    dof = robot.dof
    why = ""
    if q.shape[1] != dof:
        why = (
            f"it has {q.shape[1]} angles at each set-point, and {robot.full_name} has {dof} joints"
        )
    elif abs(motion.dt - period) > _SAME_S:
        why = f"its set-points are {motion.dt:g} s apart, and those of the arm {period:g} s"
    elif not all(np.isfinite(part).all() for part in (q, v, a)):
        why = "it has set-points that are not numbers"
    elif float(np.abs(v[-1]).max()) > _AT_REST_RAD_S:
        why = f"it ends at {np.degrees(np.abs(v[-1]).max()):.3g}°/s instead of at rest"
    elif not keeps_rates(np.stack((q, v, a)), period, robot.limits):
        why = "it exceeds the velocity, acceleration or jerk limits of a joint"
    elif _is_broken(q, v, period):
        why = "its positions do not change by its velocities"
    if why:
        raise Failure("INVALID_TARGET", f"the arm cannot follow the motion: {why}")
    beyond = np.maximum(robot.limits.lower - q, q - robot.limits.upper).max(axis=1)
    if beyond.max() > _BEYOND_RAD:
        refuse_beyond(robot.joints, q[int(beyond.argmax())], robot.limits)


def _is_broken(q: Matrix, v: Matrix, period: float) -> bool:
    """Whether positions, of shape (n, dof), rad, change otherwise than velocities say, rad/s."""
    expected = 0.5 * period * (v[1:] + v[:-1])
    return bool(np.abs(np.diff(q, axis=0) - expected).max(initial=0.0) > _SAME_RAD)


def outline(motion: Trajectory, radii: Vector, most: float) -> Matrix:
    """Configurations of a motion, of shape (n, dof), rad; a subset if the motion is long.

    In the subset, no point of the arm moves more than half of ``most`` between two rows.

    Args:
        motion: Motion.
        radii: Largest motion of the arm per radian of each joint, of shape (dof,), m/rad.
        most: Distance, m.
    """
    if len(motion) <= LONG:
        return motion.q
    # Bisect between rows until they are dense enough: slow parts of a long motion need few.
    index = np.linspace(0, len(motion) - 1, LONG).astype(int)
    rows = motion.rows(index)[0]
    while True:
        wide = np.abs(np.diff(rows, axis=0)) @ radii > 0.5 * most
        wide &= np.diff(index) > 1
        if not wide.any():
            return rows
        middle = (index[:-1][wide] + index[1:][wide]) // 2
        after = np.flatnonzero(wide) + 1
        index = np.insert(index, after, middle)
        rows = np.insert(rows, after, motion.rows(middle)[0], axis=0)


def joint_path(arm: Kinematics, path: CartesianPath, near: Vector) -> Matrix:
    """Configurations along all passes of a tool path: the first of `joint_paths`.

    Raises:
        Failure: As ``Kinematics.follow``.
    """
    return next(joint_paths(arm, path, near))


def joint_paths(arm: Kinematics, path: CartesianPath, near: Vector) -> Iterator[Matrix]:
    """Configurations along all passes of a tool path, in each branch that allows the whole path.

    A closed path is solved once and repeated.

    Yields:
        Configurations of shape (n, dof), rad, without jumps; the preferred branch comes first, see
        `Kinematics.branches_along`.

    Raises:
        Failure: As ``Kinematics.follow``, if there is no such branch.
    """
    for once in arm.branches_along(path.poses, near, free=path.free):
        if path.closed:
            once[-1] = once[0]  # equal poses; removes the solver's rounding, below 1e-9 rad
        yield np.vstack((once, *(once[1:] for _ in range(path.repeats - 1))))


def trace(
    arm: Kinematics, path: CartesianPath, near: Vector, limits: JointLimits, dt: float
) -> TimedPath:
    """Joint motion that takes the tool along a path, from rest to rest.

    Its first set-point may be far from ``near``, in another branch: check before it is sent.

    Args:
        arm: Kinematics of the arm.
        path: Path of the tool, in the world.
        near: Configuration before the path, of shape (dof,), rad.
        limits: Joint limits, scaled by the speed.
        dt: Time between set-points, s.

    Raises:
        Failure: ``UNREACHABLE``, ``PATH_BROKEN`` or ``SINGULAR``.
    """
    rows = joint_path(arm, path, near)
    return timed_path(rows, limits, dt, path.closed)


def yielding_configurations(
    checker: CollisionChecker,
    others: Sequence[Vector],
    postures: Sequence[Vector],
    limits: JointLimits,
    rng: np.random.Generator,
) -> list[Vector]:
    """Configurations in which the arm is far from other arms' bases, the best one first.

    The targets of the other arms are not known; wherever they go, they reach from their bases. The
    arm is in their way where it is, so it has to be elsewhere: some part of it by `_ELSEWHERE_M`.

    Args:
        checker: Collision checker of the arm.
        others: Base positions of the other arms, each of shape (3,), m.
        postures: Candidate configurations, each of shape (dof,), rad.
        limits: Joint limits.
        rng: Random generator of further candidates.

    Returns:
        At most three configurations, each of shape (dof,), rad, free of collisions.
    """
    lower = np.maximum(limits.lower, -np.pi)
    upper = np.minimum(limits.upper, np.pi)
    checker.place(checker.present)
    here = checker.data.geom_xpos[checker.moving]
    worth: list[tuple[float, Vector]] = []
    candidates = postures
    for _ in range(_YIELD_DRAWS):
        drawn = rng.uniform(lower, upper, (_YIELD_SAMPLES, len(lower)))
        # The wrist hardly affects the distance, but its motion takes time. Where it is was
        # measured: at a limit, noise may be beyond it.
        drawn[:, 4:] = np.clip(checker.present, limits.lower, limits.upper)[4:]
        for q in (*candidates, *drawn):
            if checker.free(q):
                moved = np.linalg.norm(checker.data.geom_xpos[checker.moving] - here, axis=1)
                if moved.max() < _ELSEWHERE_M:
                    continue
                turn = float(np.abs(q - checker.present).max())
                worth.append((_distance(checker, others) - _TURN_COST * turn, q))
        if worth:
            break
        candidates = ()
    worth.sort(key=lambda pair: -pair[0])
    return [q for _, q in worth[:_CHOICES]]


def _distance(checker: CollisionChecker, others: Sequence[Vector]) -> float:
    """Distance of the nearest base from the arm's geoms as the checker placed them last, m."""
    shapes = checker.data.geom_xpos[checker.moving]
    away = np.linalg.norm(shapes[:, None] - np.array(others), axis=2)
    return float((away - checker.model.geom_rbound[checker.moving, None]).min())
