"""Making room: an arm that waits for others moves aside if it is in the way of what it waits for.

It does so only where the run would otherwise end the wait with ``DEADLOCK``, at most `ASIDES` times
a wait, straight and without turning its tool, and it returns before its tree goes on, or at least
before the next leaf that begins where the arm is. An arm that holds a part of a fixture, or whose
hand or held object touches something, stays where it is.
"""

from __future__ import annotations

import itertools
from collections.abc import Generator, Iterator, Sequence
from typing import Final

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.arm.past_others import PastOthers
from bt_dualarm.arm.state import BACKOFF_S
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.skill.cell import CellState, CellWait, Return
from bt_dualarm.skill.skill import Skill, Ticks

ASIDES: Final = 3
"""How often an arm moves aside in one wait: one place may be as much in the way as another."""

_SPEED: Final = 0.4  # fraction of the arm's limits
_LOST: Final = ("IN_COLLISION", "NO_PLAN", "TIMED_OUT", "DEADLOCK")
_STOPPED: Final = ("IN_COLLISION", "TIMED_OUT", "NO_PLAN")  # on the way aside: try another one

_ASIDE_M: Final = (0.1, 0.15, 0.2, 0.3, 0.4)
"""Lengths of the straight motion aside, m."""

_LEAST_DIRECTION: Final = 0.1  # length of a sum of unit vectors below which they cancel each other
_ELSEWHERE_RAD: Final = 0.05  # difference of two configurations that are places of their own
_LINES_ASIDE: Final = 4  # lines that are tried where the guard stops the arm at once


class WaitingPlace:
    """Where an arm waits for others, and to which it returns.

    Args:
        arm: Arm of the leaf that waits.
        cell: What the trees share.
    """

    def __init__(self, arm: Arm, cell: CellState) -> None:
        self._arm = arm
        self._cell = cell
        self._places: list[Vector] = []
        self._for = ""

    @property
    def is_left(self) -> bool:
        """Whether the arm has moved aside, and has not returned."""
        return bool(self._places)

    def make_room(self, wait: CellWait) -> Iterator[None]:
        """Move aside for the arm that asks for it; yields once per tick.

        Args:
            wait: The wait, which is asked.
        """
        arm = self._arm
        self._places.append(arm.setpoint.q.copy())
        moving = move_aside(arm.past_others(_SPEED), wait.asked_by, self._places)
        moved = False
        try:
            while True:
                try:
                    next(moving)
                except StopIteration as end:
                    moved = bool(end.value)
                    return
                yield
        finally:
            if moved:
                self._for = wait.asked_by
            else:
                self._places.pop()
            self._cell.made_room(wait, moved=moved)

    def come_back(self) -> Iterator[None]:
        """Return to where the arm was when it began to wait; yields once per tick.

        Raises:
            Failure: ``DEADLOCK`` if others stay there; as motions.
        """
        if self._places:
            yield from _return(self._arm, Return(self._places[0], self._for))
            self._places.clear()

    def come_back_or_go_on(self) -> Iterator[None]:
        """Return, or leave that to the next leaf that begins where the arm is; once per tick.

        What those who stay there wait for may be possible from where the arm is now: then it need
        not return.

        Raises:
            Failure: As motions.
        """
        if not self._places:
            return
        arm = self._arm
        self._cell.returning.add(arm.name)
        try:
            yield from self.come_back()
        except Failure as failure:
            if failure.code != "DEADLOCK":
                raise
            self._cell.unreturned[arm.name] = Return(self._places[0], self._for)
        finally:
            self._cell.returning.discard(arm.name)


def _return(arm: Arm, owed: Return) -> Iterator[None]:
    """Return to where an arm was before it made room; yields once per tick.

    Raises:
        Failure: ``DEADLOCK`` if others stay there; as motions.
    """
    try:
        for _ in arm.travel([owed.place], _SPEED):
            yield
    except Failure as failure:
        if failure.code not in _LOST:
            raise
        raise Failure(
            "DEADLOCK",
            f"{arm.name} moved aside for {owed.made_room_for} while it waited, and cannot "
            f"return: {failure.reason}",
        ) from failure


def from_its_place(skill: Skill, steps: Ticks) -> Ticks:
    """Steps of a skill, from where the arm was before it made room if the skill begins there.

    Args:
        skill: The skill, which has not begun.
        steps: What its `run` has returned.
    """
    owed = skill.context.cell.shared.unreturned
    if not owed:
        return steps
    back = owed.pop(skill.arm.name, None)
    return steps if back is None or skill.begins_anywhere else _after(back, skill.arm, steps)


def _after(back: Return, arm: Arm, steps: Ticks) -> Ticks:
    yield from _return(arm, back)
    yield from steps


def move_aside(
    move: PastOthers, other: str, places: Sequence[Vector]
) -> Generator[float | None, None, bool]:
    """Move the tool straight aside, not turned, to let a blocked arm pass; yields once per tick.

    The arm, with or without an object in its hand, goes where most of what the other arm was to do
    becomes possible, and not far.

    Args:
        move: Motions of the leaf that waits.
        other: Name of the arm to let pass.
        places: Configurations of shape (dof,), rad, in which this arm is in its way.

    Returns:
        Whether the arm has moved.

    Raises:
        Failure: As motions.
    """
    arm = move.arm
    if other not in arm.world.arms or not _is_free_to_move(move):
        return False
    start = arm.setpoint.q
    for rows in itertools.islice(_lines_aside(move, other, places), _LINES_ASIDE):
        try:
            motion = arm.time_path(rows, move.speed)
            yield from arm.follow(motion, move.ignore, BACKOFF_S[0])
        except Failure as failure:
            if failure.code not in _STOPPED:
                raise
            yield from arm.halt()
        if float(np.abs(arm.setpoint.q - start).max()) >= _ELSEWHERE_RAD:
            return True
    return False


def _is_free_to_move(move: PastOthers) -> bool:
    """Whether hand and held objects touch nothing else, and no other arm depends on this one."""
    arm = move.arm
    world = arm.world
    carriers = {one.carrier for one in world.attachments}
    for obj in arm.held:
        if world.objects[obj].joint is not None or len(world.attachments.holders(obj)) > 1:
            return False
        if obj in carriers:  # another arm takes something from it, or places it there
            return False
    return not move.traffic.followers(arm.name) and not arm.checker(move.ignore).is_touching


def _lines_aside(move: PastOthers, other: str, places: Sequence[Vector]) -> Iterator[Matrix]:
    """Straight lines of the tool, configurations of shape (n, dof), rad, the best one first."""
    arm = move.arm
    here = arm.commanded_tool_pose
    up = np.array((0.0, 0.0, 1.0))
    away = here.position - arm.tool_pose_of(other).position
    back = arm.kinematics.base.position - here.position
    wanted = move.traffic.wanted_by(other)
    body = arm.world.arms[other]
    checker = arm.checker(move.ignore)
    there = arm.checker(move.ignore)
    found = list[tuple[bool, int, float, int, Matrix]]()
    apart = away / max(float(np.linalg.norm(away)), 1e-9)
    level = [np.array((*one[:2], 0.0)) for one in (away, back)]
    sides = [one / max(float(np.linalg.norm(one)), 1e-9) for one in level]
    for direction in (up, *sides, *(one + up for one in sides), sides[0] + sides[1]):
        length = float(np.linalg.norm(direction))
        if length < _LEAST_DIRECTION:
            continue
        for away_m in _ASIDE_M:
            shift = away_m / length * direction
            try:
                rows = arm.line_on(here.shifted(shift))
            except Failure:
                break  # nor can it go farther
            if checker.first_contact(rows) is not None:
                break
            if any(float(np.abs(rows[-1] - one).max()) < _ELSEWHERE_RAD for one in places):
                continue
            free = 0
            for q in wanted:
                there.move_other(body, q)
                free += there.free(rows[-1])
            if free or not wanted:
                # The guard lets no arm come nearer to another one that is already near.
                toward = float(shift @ apart) < 0.0
                # Without any hint the farthest place is the best one.
                cost = away_m if wanted else -float(shift @ apart)
                found.append((toward, -free, cost, len(found), rows))
    for *_, rows in sorted(found, key=lambda one: one[:4]):
        yield rows
