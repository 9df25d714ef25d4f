"""Outcomes and results of runs, arms and leaves; attachments of objects; slow ticks."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt

from bt_dualarm.behaviors.report import BoundedLog, LeafReport, StatusName
from bt_dualarm.core.errors import Number
from bt_dualarm.core.pose import Vector
from bt_dualarm.runtime.notebook import html_table, metrics_text
from bt_dualarm.runtime.series import Sample, Series
from bt_dualarm.spec.problems import Named

_log = logging.getLogger(__name__)


class Outcome(StrEnum):
    """Outcome of an arm's tree, or of the whole run."""

    SUCCESS = "SUCCESS"
    FAILURE = "FAILURE"
    UNFINISHED = "UNFINISHED"
    """The run ended first: a signal, the duration, the time limit, a divergence."""
    REMOVED = "REMOVED"
    """The arm was removed from the world before its tree had ended."""
    NOT_SPAWNED = "NOT_SPAWNED"
    """Declared as not spawned, and no leaf spawned it: its tree never began."""


class Ending(StrEnum):
    """Why the run ended."""

    FINISHED = "every tree has ended"
    DURATION = "the requested duration has passed"
    TIME_LIMIT = "the file's time limit was reached"
    STOPPED = "a stop was requested"
    CLOSED = "the run was closed early"
    DIVERGED = "the simulation diverged"
    OVERRUN = "skill code did not return in time"
    ERROR = "an internal error"


@dataclass(frozen=True)
class Leniency:
    """Exceptions that a file grants to an arm.

    Attributes:
        removable: Whether it may be removed before its tree has ended.
        last_life_counts: Whether only the stay since its last spawn counts.
    """

    removable: bool = False
    last_life_counts: bool = False

    def outcome_of(self, lives: Sequence[Outcome]) -> Outcome:
        """Worst outcome of the stays that count, of at least one."""
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
"""No exceptions: any stay that fails or is cut short prevents SUCCESS."""


def combined(outcomes: Sequence[Outcome]) -> Outcome:
    """Outcome of a run, from the outcomes of its arms.

    One FAILURE makes it FAILURE; an arm that was removed before its tree had ended makes it
    UNFINISHED (the caller leaves out arms that may be removed). An arm that was never spawned does
    not count. At least one tree must have succeeded: a run in which nothing happened is UNFINISHED.
    """
    if Outcome.FAILURE in outcomes:
        return Outcome.FAILURE
    cut_short = Outcome.UNFINISHED in outcomes or Outcome.REMOVED in outcomes
    if cut_short or Outcome.SUCCESS not in outcomes:
        return Outcome.UNFINISHED
    return Outcome.SUCCESS


class Attached(Protocol):
    """A current attachment of an object to an arm, as the world reports it."""

    @property
    def arm(self) -> str:
        """Name of the arm."""

    @property
    def object(self) -> str:
        """Name of the object."""

    @property
    def since(self) -> float:
        """Simulated time in seconds at which it was attached."""


class HoldingWorld(Protocol):
    """The world, as the attachments are read."""

    @property
    def attachments(self) -> Iterable[Attached]:
        """All current attachments."""


MOST_HOLDINGS = 1000
"""Attachments kept from the start of a run, and as many of the latest."""


@dataclass
class Holding:
    """One attachment, from attaching to releasing.

    Attributes:
        arm: Name of the arm.
        object: Name of the object.
        attached_s: Simulated time in seconds.
        released_s: Simulated time in seconds, None while it is still held.
        lifted_m: Meters by which the object rose while it was held.
    """

    arm: str
    object: str
    attached_s: float
    released_s: float | None = None
    lifted_m: float = 0.0

    def during(self, time: Vector) -> npt.NDArray[np.bool_]:
        """Mask of the simulated times, of shape (n,), s, at which the object was held."""
        until = np.inf if self.released_s is None else self.released_s
        return (time >= self.attached_s) & (time <= until)


class _Lift:
    """Measures how far an attached object is lifted.

    Args:
        holding: The attachment to update.
    """

    def __init__(self, holding: Holding) -> None:
        self.holding = holding
        self._start_height: float | None = None

    def update(self, sample: Sample) -> None:
        """Update the lifted height from a sample taken while the object was held."""
        point = sample.point(f"object_{self.holding.object}")
        if point is None or sample.time < self.holding.attached_s:
            return
        height = float(point[2])
        if self._start_height is None:
            self._start_height = height
        self.holding.lifted_m = max(self.holding.lifted_m, height - self._start_height)


class Holdings:
    """Log of attachments, updated after each tick, because only skills attach.

    Its memory is bounded: it keeps the first and the last attachments.

    Args:
        world: World with the current attachments.
    """

    def __init__(self, world: HoldingWorld) -> None:
        self._world = world
        self._kept: BoundedLog[Holding] = BoundedLog(MOST_HOLDINGS)
        self._held: dict[tuple[str, str, float], _Lift] = {}
        self._released: list[_Lift] = []

    def after_ticks(self, time: float) -> None:
        """Add attachments and releases since the last call; ``time`` in s."""
        now = {(held.arm, held.object, held.since) for held in self._world.attachments}
        for key in sorted(now - self._held.keys()):
            self._held[key] = _Lift(Holding(*key))
            self._kept.add(self._held[key].holding)
        for key in self._held.keys() - now:
            released = self._held.pop(key)
            released.holding.released_s = time
            self._released.append(released)

    def sampled(self, sample: Sample) -> None:
        """Update the lifted heights of held objects."""
        for lift in self._held.values():
            lift.update(sample)
        # A sample dates from before the step, so it may belong to an object released since.
        for lift in self._released:
            if sample.time <= (lift.holding.released_s or 0.0):
                lift.update(sample)
        self._released.clear()

    def of(self, arm: str) -> list[Holding]:
        """Attachments of one arm that are kept, in the order of attachment."""
        return [held for held in self._kept if held.arm == arm]

    @property
    def left_out(self) -> int:
        """Number of dropped attachments."""
        return self._kept.left_out

    def as_dicts(self) -> list[dict[str, Number | None]]:
        """All attachments that are kept, JSON-ready."""
        return [dict(vars(held)) for held in self._kept]


@dataclass(frozen=True, repr=False)
class LeafResult:
    """Result of one leaf; the properties of a leaf that ran several times are of its last run.

    Attributes:
        runs: Every run of the leaf, as in `ArmResult`, in the order of their start; at least one.
        series: Quantities that the leaf measured over time in all its runs, by name.
    """

    runs: tuple[LeafReport, ...]
    series: Mapping[str, Series] = field(default_factory=dict)

    @property
    def path(self) -> str:
        """Names from the root of the tree down, joined by ``/``."""
        return self.runs[-1].path

    @property
    def skill(self) -> str:
        """Name of its skill in YAML."""
        return self.runs[-1].skill

    @property
    def status(self) -> StatusName:
        """SUCCESS, FAILURE, or INVALID if the leaf was halted."""
        return self.runs[-1].status

    @property
    def code(self) -> str:
        """Code of its failure, ``HALTED`` if it was halted, else empty."""
        return self.runs[-1].code

    @property
    def reason(self) -> str:
        """Sentence on its failure, else empty."""
        return self.runs[-1].reason

    @property
    def metrics(self) -> Mapping[str, Any]:  # Any: a number or text, by its name
        """Metrics that it measured, including those of its failure; names end with units."""
        return self.runs[-1].metrics

    @property
    def started_s(self) -> float:
        """Simulated time of the first tick of its last run in seconds."""
        return self.runs[-1].started_s

    @property
    def ended_s(self) -> float | None:
        """Simulated time of the end of its last run in seconds."""
        return self.runs[-1].ended_s

    def __repr__(self) -> str:
        code = f" {self.code}" if self.code else ""
        times = f", run {len(self.runs)} times" if len(self.runs) > 1 else ""
        return f"<LeafResult {self.path}: {self.status}{code}{times}>"


@dataclass(frozen=True)
class ArmLife:
    """One stay of an arm in the world; an arm that is spawned again restarts its tree.

    Attributes:
        outcome: Outcome of its tree in this stay.
        ended_s: Simulated time in seconds at which its tree ended; None if it did not.
        fault: Sentence on an error of the tree itself rather than of a leaf, else empty.
    """

    outcome: Outcome
    ended_s: float | None = None
    fault: str = ""


@dataclass(frozen=True)
class SlowTick:
    """A tick of an arm's tree that took a long wall-clock time.

    Attributes:
        time_s: Simulated time in seconds.
        wall_s: Wall-clock duration in seconds.
        leaves: Paths of the leaves that ran in it.
    """

    time_s: float
    wall_s: float
    leaves: tuple[str, ...]


@dataclass(frozen=True, repr=False)
class ArmResult:
    """Result of one arm.

    Attributes:
        name: Name of the arm in the file.
        robot: Name of its robot in the catalog, or title of its own description file.
        outcome: Outcome of its tree; if the arm was spawned several times, the worst one, or the
            last one if the file sets ``last_life_counts``.
        ended_s: Simulated time in seconds at which its tree ended last; None if it did not.
        clipped_setpoints: Number of set-points that its controller had to clip to its limits.
        runs: Every run of every leaf, in the order of their start; of a leaf that runs many times
            the first 200 and the last 200.
        runs_left_out: Number of dropped runs.
        fault: Sentence on an error of the tree itself rather than of a leaf, else empty.
        lives: Each of its stays in the world, or the first 50 and the last 51; empty if the arm
            was never spawned.
        lives_left_out: Number of dropped stays.
        removable: Whether the file allows its removal before its tree has ended.
        guard: Smallest distances while it moved, and interventions of its guard.
        series: Quantities that its leaves measured over time, by the leaf's path and by name.
        slow_ticks: The slowest of its slow ticks, in chronological order.
    """

    name: str
    robot: str
    outcome: Outcome
    ended_s: float | None = None
    clipped_setpoints: int = 0
    runs: tuple[LeafReport, ...] = ()
    runs_left_out: int = 0
    fault: str = ""
    lives: tuple[ArmLife, ...] = ()
    lives_left_out: int = 0
    removable: bool = False
    guard: Mapping[str, Any] = field(default_factory=dict)  # Any: a number or text, by its name
    series: Mapping[str, Mapping[str, Series]] = field(default_factory=dict)
    slow_ticks: tuple[SlowTick, ...] = ()

    @property
    def leaves(self) -> Mapping[str, LeafResult]:
        """Results of the leaves that ran, by path in the tree, in the order of their start."""
        found: dict[str, list[LeafReport]] = {}
        for run in self.runs:
            found.setdefault(run.path, []).append(run)
        return Named(
            "leaf",
            {
                path: LeafResult(tuple(runs), Named("series", self.series.get(path, {})))
                for path, runs in found.items()
            },
        )

    def __repr__(self) -> str:
        return f"<ArmResult {self.name} ({self.robot}): {self.outcome}, {len(self.leaves)} leaves>"


@dataclass(frozen=True, repr=False)
class RunResult:
    """Result of the whole run.

    Attributes:
        ending: Why it ended.
        sim_time_s: Simulated seconds, including the time to stop the arms.
        wall_time_s: Wall-clock seconds of the same.
        arms: Result of each arm, by its name, in the order of the file.
        at_rest: Whether every arm was at rest at the end.
        error: Sentence on the error that ended the run, else empty.
        name: Name of the tree file.
        seed: Seed of all random numbers.
        renderer: ``gl``, ``ray``, or None if no arm has a camera.
        reality: Deviations of each arm from its nominal model, by the arm's name: settings that
            differ from the ideal, as below ``reality`` in a file.
        state_sha256: Hash of the states of the simulation, in hexadecimal: equal for bitwise equal
            runs.
    """

    ending: Ending
    sim_time_s: float
    wall_time_s: float
    arms: Mapping[str, ArmResult]
    at_rest: bool
    error: str = ""
    name: str = ""
    seed: int = 0
    renderer: str | None = None
    reality: Mapping[str, Mapping[str, object]] = field(default_factory=dict)
    state_sha256: str = ""

    @property
    def outcome(self) -> Outcome:
        """SUCCESS, FAILURE or UNFINISHED, from all trees in all stays of their arms."""
        return combined(
            [
                arm.outcome
                for arm in self.arms.values()
                if not (arm.removable and arm.outcome is Outcome.REMOVED)
            ]
        )

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds per wall-clock second; 0 for a run that took no time."""
        return self.sim_time_s / self.wall_time_s if self.wall_time_s > 0 else 0.0

    def __repr__(self) -> str:
        arms = ", ".join(f"{arm.name} {arm.outcome}" for arm in self.arms.values())
        return (
            f"<RunResult {self.name}: {self.outcome} after {self.sim_time_s:.3f} s, "
            f"{self.ending} ({arms})>"
        )

    def _repr_html_(self) -> str:
        """Table for notebooks: a row for each arm, and below it one for each leaf that ran."""
        rows = []
        for arm in self.arms.values():
            rows.append((f"{arm.name} ({arm.robot})", arm.outcome.value, arm.fault))
            for path, leaf in arm.leaves.items():
                status = f"{leaf.status} {leaf.code}".rstrip()
                rows.append((path, status, leaf.reason or metrics_text(leaf.metrics)))
        caption = (
            f"{self.name}, seed {self.seed}: {self.outcome} after {self.sim_time_s:.2f} s, "
            f"{self.error or self.ending}"
        )
        return html_table(caption, ("arm, leaf", "outcome", "metrics, or why it failed"), rows)


SLOW_S: Final = 2.0
"""Wall-clock seconds from which a tick counts as slow; a usual tick takes milliseconds."""

MOST: Final = 20
"""Number of slow ticks that are kept."""


class SlowTicks:
    """Logs the slow ticks of one arm's tree, and keeps the slowest ones for the summary.

    Args:
        arm: Name of the arm.
    """

    def __init__(self, arm: str) -> None:
        self._arm = arm
        self._slowest: list[SlowTick] = []

    @property
    def slowest(self) -> tuple[SlowTick, ...]:
        """Slow ticks that are kept, in chronological order."""
        return tuple(sorted(self._slowest, key=lambda tick: tick.time_s))

    def check(self, time: float, wall_s: float, leaves: Iterable[LeafReport]) -> None:
        """Log and keep a finished tick if it was slow.

        Args:
            time: Simulated time in seconds.
            wall_s: Wall-clock duration of the tick in seconds.
            leaves: Reports of the tree, from which the leaves that ran in the tick are selected.
        """
        if wall_s < SLOW_S:
            return
        ran = tuple(leaf.path for leaf in leaves if leaf.ended_s in (None, time))
        named = ", ".join(ran) or "no leaf"
        _log.warning("%s: the tick at %.3f s took %.1f s (%s)", self._arm, time, wall_s, named)
        self._slowest.append(SlowTick(time, wall_s, ran))
        if len(self._slowest) > MOST:
            self._slowest.remove(min(self._slowest, key=lambda tick: tick.wall_s))
