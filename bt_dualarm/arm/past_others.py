"""Motions of an arm in a world in which other arms move: waiting, yielding and replanning."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias, TypeVar

import numpy as np

from bt_dualarm.arm.motions import PLANNING_S, REPLANS, WAIT_S, ArmMotions
from bt_dualarm.arm.state import BACKOFF_S, Backoff
from bt_dualarm.arm.traffic import Traffic
from bt_dualarm.collision.distance import PLANNING_MARGIN_M
from bt_dualarm.core.errors import BlockedFailure, CollisionFailure, Failure
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.planning.path_constraints import PathConstraint
from bt_dualarm.planning.path_search import DEFAULT_PLANNER, Planner
from bt_dualarm.planning.problem import CHECKS, QUICK_CHECKS, yielding_configurations
from bt_dualarm.trajectory.trajectory import Trajectory

_QUICK_CHECKS = (QUICK_CHECKS, 10_000)
"""Checks of a first and of a repeated plan while another arm may be the reason that there is none:
about a second of computing, and a third of one."""

_THOROUGH = (4, 16, 64)
"""Numbers of the attempts that check as many configurations as a plan without other arms."""

_STEPS_BACK_M = (0.15, 0.08, 0.04)
"""Lengths of a straight motion out of a narrow place, tried in this order, m."""

_MOST_WANTED = 12  # configurations of a blocked arm by which another one chooses where to go

_WAITS_ON = ("IN_COLLISION", "TIMED_OUT", "NO_PLAN")  # failures of yielding: wait at this pose

Planning: TypeAlias = Callable[[], Generator[None, None, Trajectory]]
"""Plans a motion from the current configuration, in the current world; yields once per tick."""

Following: TypeAlias = Callable[[Trajectory, float], Iterator[float | None]]
"""Executes a motion, and waits so many simulated seconds for another arm; yields once per tick."""

_Found = TypeVar("_Found")


@dataclass(frozen=True, eq=False)
class PastOthers:
    """Motions of one leaf in a world in which other arms move.

    Attributes:
        arm: Arm of the leaf.
        backoff: Time that the arm waits before it tries again.
        traffic: Right of way among the arms.
        speed: Fraction of the limits, above 0 to 1.
        ignore: Names of the objects that may be touched.
        search: Planner to use if the straight path is blocked.
        give_way: Whether the arm moves aside if one that has waited longer waits for it.
        wait_s: Simulated seconds after which it no longer waits or replans.
        keep: Constraint along the paths of `go`, if there is one.
        turns: Whether `go` may end in a goal with joints rotated by whole turns if there is no
            motion to the goals themselves.
    """

    arm: ArmMotions
    backoff: Backoff
    traffic: Traffic
    speed: float
    ignore: frozenset[str] = frozenset()
    search: Planner = DEFAULT_PLANNER
    give_way: bool = True
    wait_s: float = WAIT_S
    keep: PathConstraint | None = None
    turns: bool = False

    def go(self, goals: Sequence[Vector], began_s: float | None = None) -> Iterator[float | None]:
        """Plan and execute a motion to one of several goals; yields once per tick.

        Args:
            goals: Configurations, each of shape (dof,), rad, the preferred one first.
            began_s: Simulated time at which the caller began the first plan, s; by default now.

        Raises:
            Failure: As `Arm.plan` and `Arm.follow`.
        """
        starts = [began_s]

        def planned() -> Generator[None, None, Trajectory]:
            began = starts.pop() if starts else None
            paths = [q[None] for q in goals] if self.turns else []
            turned = [q for (q,) in self.arm.turned(paths)]
            return self.arm.plan(
                goals, self.speed, self.ignore, self.search, self.keep, began, turned
            )

        return self.along(planned)

    def straight(self, end: Pose, *, known_free: bool = False) -> Iterator[float | None]:
        """Move the tool straight to a pose in the world, as `along`; yields once per tick.

        Args:
            end: Pose of the tool.
            known_free: Whether only another arm can be in the way of the whole line.

        Raises:
            Failure: As `Arm.line_on`, `Arm.time_path` and `Arm.follow`; ``IN_COLLISION``.
        """
        start = self.arm.setpoint.q

        def planned() -> Generator[None, None, Trajectory]:
            yield from self.arm.come_to_rest()  # the motion of a halted leaf may still be braking
            rows = self.arm.line_on(end)
            # After an interruption the line begins elsewhere, where it has not been checked.
            has_not_moved = bool(np.array_equal(self.arm.setpoint.q, start))
            yield from self.checked(rows, known_free and has_not_moved)
            return self.arm.time_path(rows, self.speed)

        # From another configuration the line may differ or not exist: the others move aside.
        return replace(self, give_way=False).along(planned)

    def to_line(
        self,
        planning: Planning,
        make_path: Callable[[], Matrix | Trajectory],
        touched: frozenset[str] = frozenset(),
    ) -> Iterator[float | None]:
        """Move to the beginning of a path, and wait there until no other arm blocks it.

        If an arm with the right of way waits for this one meanwhile, it moves aside and comes back.
        Yields once per tick.

        Args:
            planning: Makes the plan to the beginning, each time.
            make_path: Returns configurations along the path, of shape (n, dof), rad, or the motion
                along it, after the last plan; only other arms can be in its way.
            touched: Names of the objects that may be touched along the path.

        Raises:
            Failure: As `along`; ``IN_COLLISION`` with an arm that stays in the way of the path.
        """
        line = replace(self, ignore=touched)
        try:
            while True:
                yield from self._along(planning)
                start = self.arm.setpoint.q
                path = make_path()

                def attempt(
                    start: Vector = start, path: Matrix | Trajectory = path
                ) -> Generator[None, None, bool]:
                    if not np.array_equal(self.arm.setpoint.q, start):
                        return False  # already moved aside
                    yield from line.checked(path, known_free=True)
                    return True

                until = self.arm.time + self.wait_s
                if (yield from self._when_clear(attempt, until)):
                    return
        finally:
            self.traffic.arrive(self.arm.name, self.arm.leaf)

    def along(self, planning: Planning, follow: Following | None = None) -> Iterator[float | None]:
        """Plan and execute the plan to its end; yields once per tick.

        If another arm is at the goal or in the path, the arm waits for that to change. If something
        moves into the path during the motion, it stops and replans from its current configuration:
        once at least, and again within ``wait_s``.

        Args:
            planning: Makes the plan, each time.
            follow: Executes it; by default `Arm.follow`.

        Raises:
            Failure: As ``planning`` and ``follow``; ``INVALID_TARGET`` if another arm holds what
                this one holds.
        """
        self.arm.refuse_shared()
        try:
            yield from self._along(planning, follow)
        finally:
            self.traffic.arrive(self.arm.name, self.arm.leaf)

    def _along(self, planning: Planning, follow: Following | None = None) -> Iterator[float | None]:
        """Plan and execute, and keep the arm's rank at the end."""
        until = self.arm.time + self.wait_s
        replans = REPLANS
        stuck_at = np.empty(0)
        while True:
            motion = yield from self._when_clear(planning, until)
            try:
                # If it is held up longer, another plan may lead past the obstacle.
                wait_s = self.backoff.renew()
                if follow is None:
                    yield from self.arm.follow(motion, self.ignore, wait_s)
                else:
                    yield from follow(motion, wait_s)
            except BlockedFailure as failure:
                # A plan that got no farther past an arm that stays will not do so the next time.
                is_stuck = failure.stays and np.array_equal(self.arm.setpoint.q, stuck_at)
                stuck_at = self.arm.setpoint.q.copy()
                is_over = self.arm.time > until or is_stuck or failure.code == "DEADLOCK"
                if replans <= 0 and is_over:
                    raise
            else:
                return
            replans -= 1
            yield from self.arm.halt()

    def when_clear(
        self, attempt: Callable[[], Generator[None, None, _Found]]
    ) -> Generator[float | None, None, _Found]:
        """Repeat an attempt to plan while another arm makes it fail; yields once per tick.

        Args:
            attempt: Plans in the current world, each time.

        Returns:
            What ``attempt`` returned.

        Raises:
            Failure: That of ``attempt``, if no arm is the reason, or one that stays there or is
                still there after ``wait_s``; ``DEADLOCK``; as motions.
        """
        try:
            return (yield from self._when_clear(attempt, self.arm.time + self.wait_s))
        finally:
            self.traffic.arrive(self.arm.name, self.arm.leaf)

    def make_way(self) -> Iterator[float | None]:
        """Move aside if another arm waits for this one to leave its path; yields once per tick.

        For an arm that waits for something else: it is not blocked itself.

        Raises:
            Failure: ``BUSY``, ``TRACKING_ERROR``.
        """
        if self.traffic.is_in_the_way(self.arm.name):
            yield from self._yield_to_others()

    def may_clear(self, refusal: Failure) -> bool:
        """Whether another arm, or what it holds, is or may be the reason of a failure."""
        return bool(self.blockers(refusal))

    def may_leave(self, refusal: Failure) -> bool:
        """Whether another arm is the reason of a failure, and has not ended where it is."""
        return bool(self.blockers(refusal) - self.arm.resting)

    def blockers(self, refusal: Failure, were_near: frozenset[str] = frozenset()) -> frozenset[str]:
        """Names of the arms that are, themselves or with what they hold, or may be, the reason.

        A search without success does not tell what was in the way: it may be any arm that is where
        this one can come.

        Args:
            refusal: The failure.
            were_near: Names of the arms that were there when the attempt began.
        """
        neighbors = frozenset(self.arm.controller.neighbors)
        found = set[str]()
        for one in _reasons(refusal):
            if isinstance(one, CollisionFailure):
                found.add(self.arm.world.arm_of(one.obstacle))
            elif one.code == "NO_PLAN":
                return neighbors & (were_near | self._near())
        return neighbors & found

    def _near(self) -> frozenset[str]:
        """Names of the arms that are where this one can come, as far as plans keep from them."""
        return self.arm.controller.in_reach(PLANNING_MARGIN_M)

    def _when_clear(
        self, attempt: Callable[[], Generator[None, None, _Found]], until: float
    ) -> Generator[float | None, None, _Found]:
        """Repeat an attempt while another arm makes it fail, until a simulated time.

        A search without success takes seconds of computing. While other arms may be the reason,
        most attempts therefore search less: those arms will stand elsewhere at the next one. The
        last attempt before the failure is a thorough one.
        """
        arm = self.arm
        staying: frozenset[str] = frozenset()
        is_last = has_stepped_back = is_called = False
        number = 0
        while True:
            number += 1
            is_thorough = is_last or number in _THOROUGH or not arm.controller.neighbors
            arm.checks = CHECKS if is_thorough else _QUICK_CHECKS[number > 1]
            arm.resting = staying
            arm.may_turn = is_last or not arm.controller.neighbors
            were_near = self._near()
            try:
                found = yield from attempt()
            except Failure as refusal:
                blockers = self.blockers(refusal, were_near)
                theirs = _collisions_with(blockers, refusal, arm)
                why = theirs[0].reason if theirs else refusal.reason
                if blockers <= staying or arm.time > until:
                    if not _is_without_plan(refusal):
                        raise
                    if is_thorough:
                        has_tried = has_stepped_back or not self.give_way
                        if has_tried or not arm.controller.neighbors:
                            raise
                        has_stepped_back = True
                        if not (yield from self._step_back()):
                            raise
                    is_last = True
                    continue
            else:
                self.traffic.advance(arm.name)
                return found
            finally:
                arm.checks = CHECKS
                arm.resting = frozenset()
                arm.may_turn = True
            self.traffic.block(
                arm.name,
                arm.leaf,
                blockers,
                may_yield=self.give_way,
                has_other_path=self.give_way,
                wanted=[np.array(one.at) for one in theirs if one.at],
                why=why,
            )
            if is_called and not theirs:
                # Nothing else can go on, and a search without success does not tell what was in
                # the way: it must not be a deadlock with arms that are not.
                yield from self._refuse_without(blockers, attempt)
            yield from self._wait_for_others(until)
            is_called = self.traffic.is_called(arm.name)
            if arm.refuse_deadlock():
                staying |= blockers

    def _refuse_without(
        self, others: frozenset[str], attempt: Callable[[], Generator[None, None, _Found]]
    ) -> Generator[None, None, None]:
        """Refuse what is not possible without other arms, either: they are not the reason.

        Args:
            others: Names of these arms.
            attempt: Plans in the current world.

        Raises:
            Failure: That of ``attempt``.
        """
        self.arm.left_out = others
        try:
            yield from attempt()
        finally:
            self.arm.left_out = frozenset()

    def _wait_for_others(self, until: float) -> Iterator[float | None]:
        """Wait before the next attempt, aside if an arm with the right of way waits for this one.

        Args:
            until: Simulated time in s after which it no longer waits.
        """
        arm = self.arm
        again = arm.time + self.backoff.renew()
        aside = arm.time
        while not self.traffic.is_called(arm.name) and (
            arm.time < again or (self.traffic.must_yield(arm.name) and arm.time <= until)
        ):
            if arm.time >= aside and self.traffic.must_yield(arm.name):
                yield from self._yield_to_others()
                # By then the other arm has tried again: if it still cannot pass, move elsewhere.
                aside = arm.time + BACKOFF_S[1] + 2.0 * PLANNING_S
            yield None

    def _yield_to_others(self) -> Iterator[float | None]:
        """Move away from the other arms, as far as that is possible."""
        arm = self.arm
        others = [arm.world.arms[name].base.position for name in arm.controller.neighbors]
        if not others:  # removed meanwhile
            return
        goals = yielding_configurations(
            arm.checker(self.ignore),
            others,
            tuple(arm.robot.postures.values()),
            arm.robot.limits,
            self.backoff.rng,
        )
        if not goals:
            return
        arm.checks = _QUICK_CHECKS[0]
        try:
            motion = yield from arm.plan(goals, self.speed, self.ignore, DEFAULT_PLANNER)
            yield from arm.follow(motion, self.ignore, self.backoff.renew())
        except Failure as failure:
            if failure.code not in _WAITS_ON:
                raise
            yield from arm.halt()
            if failure.code == "NO_PLAN":
                yield from self._step_back()
        finally:
            arm.checks = CHECKS

    def _step_back(self) -> Generator[float | None, None, bool]:
        """Move the tool straight out of a narrow place among other arms, if that is possible.

        Where the arm may hardly come nearer to others on any side, only few of the edges that a
        search draws are free. Returns whether the arm has moved.
        """
        arm = self.arm
        here = arm.commanded_tool_pose
        back = -here.rotation_matrix[:, 2]
        up = np.array((0.0, 0.0, 1.0))
        others = [arm.tool_pose_of(name).position for name in arm.controller.neighbors]
        if not others:  # removed meanwhile
            return False
        nearest = min(others, key=lambda one: float(np.linalg.norm(here.position - one)))
        away = here.position - nearest
        away /= max(float(np.linalg.norm(away)), 1e-9)
        for length in _STEPS_BACK_M:
            for direction in (back, back + up, up, away, away + up):
                shift = length * direction / max(float(np.linalg.norm(direction)), 1e-9)
                try:
                    rows = arm.line_on(here.shifted(shift))
                    arm.refuse_collision_along(rows, self.ignore)
                except Failure:
                    continue
                try:
                    motion = arm.time_path(rows, self.speed)
                    yield from arm.follow(motion, self.ignore, self.backoff.renew())
                except Failure as failure:
                    if failure.code not in _WAITS_ON:
                        raise
                    yield from arm.halt()
                return True
        return False

    def checked(self, path: Matrix | Trajectory, known_free: bool) -> Generator[None, None, None]:
        """Refuse a blocked path; if it is known to be free, only one that an arm blocks.

        Args:
            path: Configurations along the path, of shape (n, dof), rad, or a motion.
            known_free: Whether only another arm can be in the way.

        Raises:
            Failure: ``IN_COLLISION``.
        """
        yield from ()
        if known_free and not self.arm.controller.neighbors:
            return
        try:
            self.arm.refuse_collision_along(path, self.ignore)
        except CollisionFailure as refusal:
            if not known_free or self.may_clear(refusal):
                raise


def _reasons(refusal: Failure) -> Iterator[Failure]:
    """The failures of all attempts that made one fail; itself, if there was a single attempt."""
    attempts = refusal.__cause__
    if not isinstance(attempts, ExceptionGroup):
        yield refusal
        return
    for one in attempts.exceptions:
        if isinstance(one, Failure):
            yield from _reasons(one)


def _collisions_with(
    blockers: frozenset[str], refusal: Failure, arm: ArmMotions
) -> list[CollisionFailure]:
    """Collisions with other arms, or what they hold, among the reasons of a failure."""
    found = (one for one in _reasons(refusal) if isinstance(one, CollisionFailure))
    met = (one for one in found if arm.world.arm_of(one.obstacle) in blockers)
    return list(itertools.islice(met, _MOST_WANTED))


def _is_without_plan(refusal: Failure) -> bool:
    """Whether a search without success is the reason of a failure, or one of several reasons."""
    return any(one.code == "NO_PLAN" for one in _reasons(refusal))
