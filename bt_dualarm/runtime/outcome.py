"""How a tree and a run can end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum


class Outcome(StrEnum):
    """What became of an arm's tree, and of the run."""

    SUCCESS = "SUCCESS"
    FAILURE = "FAILURE"
    UNFINISHED = "UNFINISHED"
    """The run ended first: a signal, the duration, the time limit, a divergence."""
    REMOVED = "REMOVED"
    """The arm was taken out of the world before its tree had ended."""
    NOT_SPAWNED = "NOT_SPAWNED"
    """Declared as not spawned, and no leaf spawned it: its tree never began."""


class Ending(StrEnum):
    """Why the run ended."""

    FINISHED = "every tree has ended"
    DURATION = "the given duration is over"
    TIME_LIMIT = "the time limit of the file is reached"
    STOPPED = "it was asked to stop"
    CLOSED = "it was closed before its end"
    DIVERGED = "the simulation diverged"
    OVERRUN = "code of a skill did not return in time"
    ERROR = "an internal error"


@dataclass(frozen=True)
class Leniency:
    """What a file forgives an arm.

    Attributes:
        removable: Whether it may be taken away before its tree has ended.
        last_life_counts: Whether what it did before it was spawned anew does not matter.
    """

    removable: bool = False
    last_life_counts: bool = False

    def outcome_of(self, lives: Sequence[Outcome]) -> Outcome:
        """What an arm comes to that had so many lives, one at least: the worst that counts."""
        counted = list(lives[-1:] if self.last_life_counts else lives)
        if self.removable:
            counted = [one for one in counted if one is not Outcome.REMOVED] or [Outcome.REMOVED]
        return min(counted, key=_WORST_FIRST.index)


_WORST_FIRST = (
    Outcome.FAILURE,
    Outcome.UNFINISHED,
    Outcome.REMOVED,
    Outcome.NOT_SPAWNED,
    Outcome.SUCCESS,
)

STRICT = Leniency()
"""Forgives nothing: any life that fails or is cut short keeps the run from SUCCESS."""


def combined(outcomes: Sequence[Outcome]) -> Outcome:
    """What a run comes to, from what its arms have come to.

    One failure fails it, and an arm that was removed before its tree had ended leaves it
    unfinished: those whose removal the file forgives are not among the outcomes. An arm that was
    never spawned does not count. At least one tree must have succeeded: a run in which nothing
    happened is unfinished.
    """
    if Outcome.FAILURE in outcomes:
        return Outcome.FAILURE
    cut_short = Outcome.UNFINISHED in outcomes or Outcome.REMOVED in outcomes
    if cut_short or Outcome.SUCCESS not in outcomes:
        return Outcome.UNFINISHED
    return Outcome.SUCCESS
