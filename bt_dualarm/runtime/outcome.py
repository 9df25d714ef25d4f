"""How a tree and a run can end."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum


class Outcome(StrEnum):
    """What became of an arm's tree, and of the run."""

    SUCCESS = "SUCCESS"
    FAILURE = "FAILURE"
    UNFINISHED = "UNFINISHED"
    """The run ended first: a signal, the duration, the time limit, a divergence."""
    REMOVED = "REMOVED"
    """The arm was taken out of the world while its tree was running."""
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
    ERROR = "an internal error"


def combined(outcomes: Sequence[Outcome]) -> Outcome:
    """One failure fails the run; an arm removed or never spawned on purpose does not count.

    At least one tree must have succeeded: a run in which nothing happened is unfinished.
    """
    if Outcome.FAILURE in outcomes:
        return Outcome.FAILURE
    if Outcome.UNFINISHED in outcomes or Outcome.SUCCESS not in outcomes:
        return Outcome.UNFINISHED
    return Outcome.SUCCESS
