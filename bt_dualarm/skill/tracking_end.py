"""When tracking ends: with what a leaf asks for, or with why it did not come about.

Pictures may show anything: a target that comes and goes, jumps, or is there in noise only. None of
that may put off the end forever. Time during which the target is not followed is therefore summed
up until it is: interruptions by shorter sightings do not start the sum anew.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

from bt_dualarm.core.errors import Failure
from bt_dualarm.skill.following_error import FollowingError

APART_S: Final = 30.0
"""Least time that a tool has to arrive at a target within reach, also after each loss, s."""

APART_LOSSES: Final = 10.0
"""The same as a multiple of `EndConditions.lost_timeout`; the longer time counts."""


@dataclass(frozen=True)
class EndConditions:
    """What ends tracking; all times in s.

    Attributes:
        duration: Time after which a followed target means success; None for no such end.
        until_still: Time at rest after which a followed target that has moved means success.
        wait: Longest wait for a target that went out of view before it was ever within reach.
        reach_timeout: Longest wait for a target out of reach.
        move_timeout: Longest wait of ``until_still`` for a target within reach to move.
        rest_timeout: Longest time of ``until_still`` until the target rests.
        lost_timeout: Longest time without the target.
        reach: Largest distance of the tool from its start, m.
    """

    duration: float | None
    until_still: float | None
    wait: float
    reach_timeout: float
    move_timeout: float
    rest_timeout: float
    lost_timeout: float
    reach: float

    @property
    def apart(self) -> float:
        """Longest time without following a target within reach, s."""
        return max(APART_S, APART_LOSSES * self.lost_timeout)


class TrackingStatus(NamedTuple):
    """What is known of target and tool at one time.

    Attributes:
        time: Simulated time, s.
        in_view: Whether the newest sighting is fresh enough to follow.
        arrived: Whether the target is followed within the bound on the error.
        is_beyond: Whether the target, or the way to it, is out of reach.
        is_waiting: Whether the arm waits for it as at the start, see `EndConditions.wait`.
        has_moved: Whether it has moved.
        still_for: Time since it came to rest after a motion, s.
        unseen_for: Time without it, s.
        refused: Why an object of its color in view is not the target; empty if there is none.
        obstacle: What is in the way to a target not yet reached, if anything.
    """

    time: float
    in_view: bool
    arrived: bool
    is_beyond: bool = False
    is_waiting: bool = False
    has_moved: bool = False
    still_for: float = 0.0
    unseen_for: float = 0.0
    refused: str = ""
    obstacle: Failure | None = None

    @property
    def not_it(self) -> str:
        """Clause for a message: why an object of its color in view is not it; may be empty."""
        if not self.refused:
            return ""
        return f"; an object of its color in view is not the target: {self.refused}"


class TrackingEnd:
    """Decides whether tracking is over, from one tick to the next.

    Whatever it is given, it ends ``duration`` within that time and twice the sum of ``wait``,
    ``reach_timeout`` and `EndConditions.apart`; ``until_still`` within ``wait`` and
    ``rest_timeout``. With neither it ends by failures only: a target that is followed is followed
    for as long as the caller wants.

    Args:
        conditions: What ends it.
        error: Monitor of the tracking error, which knows causes.
        began: Time at which following began, s.
    """

    def __init__(self, conditions: EndConditions, error: FollowingError, began: float) -> None:
        self._until = conditions
        self._error = error
        self._began = self._rests_since = self._time = began
        # Times since the target was last followed, s: in all, and those that are not `_apart`.
        self._waited = self._beyond = self._apart = self._unseen = 0.0
        self._hidden = 0.0  # time without the target while it rests, s
        self._was_followed = False

    @property
    def progress(self) -> float | None:
        """Fraction of ``duration`` that has passed; None without one."""
        duration = self._until.duration
        return None if duration is None else min(1.0, (self._time - self._began) / duration)

    def is_over(self, status: TrackingStatus) -> bool:
        """Whether it ends in success.

        Args:
            status: Status, later than all before.

        Raises:
            Failure: ``LOST``, ``NOT_SEEN``, ``UNREACHABLE``, ``NOT_FOLLOWING``, ``NOT_MOVED`` or
                ``NOT_STILL``, or what is in the way to the target.
        """
        self._sum_up(status)
        until = self._until
        refuse_lost(status, until.lost_timeout)
        self._refuse_not_followed(status)
        time = self._time
        followed_for = time - self._began
        if status.has_moved or status.is_beyond:
            self._rests_since = time
        elif until.until_still is not None and time - self._rests_since > until.move_timeout:
            waited = time - self._rests_since
            reason = f"the target has not moved for {waited:.1f} s"
            if self._hidden > 0.0:
                reason += (
                    f"; it was out of view for {self._hidden:.1f} s of that, but then where it "
                    "had been"
                )
            raise Failure("NOT_MOVED", reason, waited_s=waited, unseen_s=self._hidden)
        if status.arrived:
            if until.duration is not None and followed_for >= until.duration:
                return True
            if until.until_still is not None and status.still_for >= until.until_still:
                return True
        if until.until_still is not None and followed_for > until.rest_timeout:
            raise Failure(
                "NOT_STILL",
                f"in {followed_for:.1f} s the target has not rested for {until.until_still:.2g} s",
                followed_s=followed_for,
            )
        return False

    def _sum_up(self, status: TrackingStatus) -> None:
        passed = status.time - self._time
        self._time = status.time
        if status.has_moved or status.is_beyond:
            self._hidden = 0.0
        elif not status.in_view:
            self._hidden += passed
        if status.arrived:
            self._waited = self._beyond = self._apart = self._unseen = 0.0
            self._was_followed = True
        elif status.is_waiting:
            self._waited += passed
            if not self._was_followed:
                self._began = status.time
        elif status.is_beyond:
            self._beyond += passed
        else:
            self._apart += passed
            if not status.in_view:
                self._unseen += passed

    def _refuse_not_followed(self, status: TrackingStatus) -> None:
        until = self._until
        if self._waited > until.wait:
            raise Failure(
                "NOT_SEEN",
                "the target went out of view before it came within reach, and has not been "
                f"seen for {self._waited:.1f} s{status.not_it}",
                waited_s=self._waited,
            )
        if self._beyond > until.reach_timeout:
            if status.obstacle is not None:
                raise status.obstacle
            raise Failure(
                "UNREACHABLE",
                f"the target has been more than {until.reach:.2f} m away from where the arm "
                f"began to follow for {self._beyond:.1f} s",
                beyond_s=self._beyond,
            )
        if self._apart > until.apart:
            if self._unseen > 0.5 * self._apart:
                raise Failure(
                    "LOST",
                    f"of {self._apart:.1f} s since the target was last followed, it was out of "
                    f"view for {self._unseen:.1f} s{status.not_it}",
                    unseen_s=self._unseen,
                )
            self._error.refuse_apart(self._apart, self._unseen)


def refuse_lost(status: TrackingStatus, lost_timeout: float) -> None:
    """Check the time without the target.

    Raises:
        Failure: ``LOST``.
    """
    unseen = status.unseen_for
    if unseen > lost_timeout:
        reason = f"the target was last seen {unseen:.1f} s ago{status.not_it}"
        raise Failure("LOST", reason, unseen_s=unseen)
