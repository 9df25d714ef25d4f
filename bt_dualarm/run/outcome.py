"""How a run ended: for each arm, and altogether."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

from bt_dualarm.errors import Number
from bt_dualarm.tree.report import LeafReport


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
    STOPPED = "a signal asked it to stop"
    DIVERGED = "the simulation diverged"
    ERROR = "an internal error"


@dataclass(frozen=True)
class ArmResult:
    """What one arm did.

    Attributes:
        name: Its name in the file.
        robot: Its name in the catalogue, or the title of a page beside the tree file.
        outcome: Of its tree.
        ended_s: Simulated time in seconds at which its tree ended; None if it did not.
        clipped_setpoints: How many set-points its controller had to clip to its limits.
        leaves: Every run of every leaf, in the order in which they began.
        fault: What broke the tree itself rather than a leaf of it, else empty.
        guard: Smallest distances while it moved, and what its guard did.
    """

    name: str
    robot: str
    outcome: Outcome
    ended_s: float | None = None
    clipped_setpoints: int = 0
    leaves: tuple[LeafReport, ...] = ()
    fault: str = ""
    guard: Mapping[str, Number] = field(default_factory=dict)


@dataclass(frozen=True)
class RunResult:
    """What the whole run did.

    Attributes:
        ending: Why it ended.
        sim_time_s: Simulated seconds, with the time that stopping the arms took.
        wall_time_s: Seconds on the clock for the same.
        arms: In the order of the file.
        at_rest: Every arm stood still at the end.
        error: Sentence on what broke the run, else empty.
    """

    ending: Ending
    sim_time_s: float
    wall_time_s: float
    arms: tuple[ArmResult, ...]
    at_rest: bool
    error: str = ""

    @property
    def outcome(self) -> Outcome:
        """SUCCESS, FAILURE or UNFINISHED of all trees together."""
        return combined([arm.outcome for arm in self.arms])

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds a second on the clock; 0 for a run that took no time."""
        return self.sim_time_s / self.wall_time_s if self.wall_time_s > 0 else 0.0


def combined(outcomes: Sequence[Outcome]) -> Outcome:
    """One failure fails the run; an arm removed or never spawned on purpose does not count.

    At least one tree must have succeeded: a run in which nothing happened is unfinished.
    """
    if Outcome.FAILURE in outcomes:
        return Outcome.FAILURE
    if Outcome.UNFINISHED in outcomes or Outcome.SUCCESS not in outcomes:
        return Outcome.UNFINISHED
    return Outcome.SUCCESS
