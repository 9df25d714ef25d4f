"""Outcomes and results of runs, arms and leaves, with the quantities measured over time.

Results are shown as HTML tables in notebooks. `Series` are measured by skills; `Tracks` are sampled
paths of tools and objects. Also attachments of objects, and slow ticks.
"""

from __future__ import annotations

import html
import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from fractions import Fraction
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from bt_dualarm.behaviors.report import BoundedLog, LeafReport, StatusName
from bt_dualarm.core.errors import Number
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.runtime.clock import Periodic, exact
from bt_dualarm.sim.world import World
from bt_dualarm.skill.skill import Samples
from bt_dualarm.spec.faults import FaultEvent
from bt_dualarm.spec.node_types import counted
from bt_dualarm.spec.problems import Named

_MOST_METRICS = 6
"""Metrics that one row shows; the result itself has all of them."""


def html_table(caption: str, header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Table of texts as HTML; every text is escaped, none is markup.

    Args:
        caption: One line above the table.
        header: Titles of the columns.
        rows: Texts of the cells, as many in each row as there are titles.
    """
    lines = [f"<table><caption>{html.escape(caption)}</caption>"]
    lines.append(f"<thead>{_row('th', header)}</thead><tbody>")
    lines += [_row("td", row) for row in rows]
    lines.append("</tbody></table>")
    return "\n".join(lines)


def metrics_text(metrics: Mapping[str, object]) -> str:
    """Names and values of the first metrics, to four digits, and how many more there are."""
    parts = [
        f"{name} = {value:.4g}" if isinstance(value, float) else f"{name} = {value}"
        for name, value in metrics.items()
    ]
    more = len(parts) - _MOST_METRICS
    return ", ".join(parts[:_MOST_METRICS]) + (f", and {more} more" if more > 0 else "")


def _row(tag: str, cells: Sequence[str]) -> str:
    # Jupyter aligns cells to the right otherwise, where the indentation of nodes cannot be seen.
    begin = f'<{tag} style="text-align: left">'
    texts = "".join(f"{begin}{html.escape(cell)}</{tag}>" for cell in cells)
    return f"<tr>{texts}</tr>"


MOST_SAMPLES = 1 << 15
"""Largest number of samples kept per series: two minutes at 250 Hz."""


@dataclass(frozen=True, eq=False, repr=False)
class Series:
    """One quantity of one leaf over time; beyond 32,768 samples it is thinned by powers of two.

    Attributes:
        arm: Name of the arm.
        leaf: Path of the leaf in its tree.
        name: ``planned``, ``executed``, ``target``, ... for positions; a scalar's name ends with
            its unit (``error_m``, ``offset_px``). If a leaf has a scalar whose name begins with
            ``error``, plots show no other distance.
        time: Simulated seconds, of shape (n,).
        values: Positions in the world in meters, of shape (n, 3); or scalars, of shape (n, 1).
    """

    arm: str
    leaf: str
    name: str
    time: Vector
    values: Matrix

    @property
    def is_position(self) -> bool:
        """Whether the values are positions in the world rather than scalars."""
        return int(self.values.shape[1]) == 3

    def __repr__(self) -> str:
        return f"<Series {self.arm}:{self.leaf} {self.name}, {counted(len(self.time), 'sample')}>"


class SeriesLog:
    """All series of a run, in the order of their first samples."""

    def __init__(self) -> None:
        self._series: dict[tuple[str, str, str], _Samples] = {}

    def add(
        self, arm: str, leaf: str, name: str, time: npt.ArrayLike, values: npt.ArrayLike
    ) -> None:
        """Add one sample or n samples to a series, which is created with its first sample.

        Args:
            arm: Name of the arm.
            leaf: Path of the leaf in its tree.
            name: Name of the series, as in `Series`.
            time: Simulated seconds, a number or of shape (n,).
            values: A number or a point of shape (3,); or of shape (n,) or (n, 3).

        Raises:
            SkillError: The shapes do not match, or the times do not follow the earlier samples.
        """
        samples = Samples.of(name, time, values)
        if len(samples.time):
            key = (arm, leaf, name)
            series = self._series.get(key) or _Samples(name)
            series.add(samples)
            self._series[key] = series  # only now, so that every series has a sample

    def __iter__(self) -> Iterator[Series]:
        for key, samples in self._series.items():
            yield Series(*key, *samples.arrays())

    def of(self, arm: str) -> dict[str, dict[str, Series]]:
        """Series of one arm, by leaf and by name."""
        found: dict[str, dict[str, Series]] = {}
        for series in self:
            if series.arm == arm:
                found.setdefault(series.leaf, {})[series.name] = series
        return found


class _Samples:
    """Growing samples of a series, thinned when they become too many.

    Args:
        name: Name of the series.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._rows = np.empty((0, 0))
        self._kept = 0
        self._seen = 0
        self._stride = 1
        self._last = 0.0

    def add(self, samples: Samples) -> None:
        """Add samples.

        Raises:
            SkillError: The samples do not match the earlier ones.
        """
        if self._seen:
            samples.refuse_after(self._name, self._last, self._rows.shape[1] - 1)
        self._last = float(samples.time[-1])
        rows = np.column_stack((samples.time, samples.values))
        first = -self._seen % self._stride
        self._seen += len(rows)
        self._append(rows[first :: self._stride])

    def arrays(self) -> tuple[Vector, Matrix]:
        rows = self._rows[: self._kept]
        return rows[:, 0].copy(), rows[:, 1:].copy()

    def _append(self, rows: Matrix) -> None:
        needed = self._kept + len(rows)
        if needed > len(self._rows):
            grown = np.empty((max(needed, 2 * len(self._rows)), rows.shape[1]))
            if self._kept:
                grown[: self._kept] = self._rows[: self._kept]
            self._rows = grown
        self._rows[self._kept : needed] = rows
        self._kept = needed
        while self._kept > MOST_SAMPLES:
            self._rows = self._rows[: self._kept : 2].copy()
            self._kept = len(self._rows)
            self._stride *= 2


SAMPLE_PERIOD = Fraction(1, 100)
"""Seconds between two samples."""

MOST_POINTS = 1 << 17
"""Largest number of positions kept for plots: four minutes of eight objects."""

_FEWEST = 4
"""Smallest number of positions that a sample counts as, because samples also have a fixed cost."""


@dataclass(frozen=True, eq=False)
class Sample:
    """Positions of all tools and objects at one time.

    Attributes:
        time: Simulated time in seconds.
        names: ``tool_<arm>`` and ``object_<name>`` of the arms and objects that are present.
        points: Their positions in the world, of shape (n, 3), m.
    """

    time: float
    names: tuple[str, ...]
    points: Matrix

    def point(self, name: str) -> Vector | None:
        """Position of one tool or object, of shape (3,), m; None if it was not in the world."""
        return self.points[self.names.index(name)] if name in self.names else None


class Tracks:
    """World positions of tools and objects at 100 Hz of simulated time, thinned for plots.

    Its memory is bounded: in a long run it keeps every second sample, then every fourth, and so on.

    Args:
        world: The world, in which arms and objects may appear and disappear.

    Attributes:
        bases: Base positions of all arms so far in the world, each of shape (3,), m.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._due = Periodic(SAMPLE_PERIOD, exact(world.timestep))
        self._steps = 0
        self._bound_to = -1
        self._names: tuple[str, ...] = ()
        self._sites: list[int] = []
        self._bodies: list[int] = []
        self._kept: list[Sample] = []
        self._seen = 0
        self._stride = 1
        self.bases: dict[str, Vector] = {}

    def after_step(self) -> Sample | None:
        """Take a sample if one is due."""
        due = self._due.due(self._steps)
        self._steps += 1
        if not due:
            return None
        if self._bound_to != self._world.generation:
            self._bind()
        data = self._world.data
        points = np.concatenate([data.site_xpos[self._sites], data.xpos[self._bodies]])
        # The world's steps end with `mj_step1`: Cartesian positions are up to date, too.
        sample = Sample(self._world.time, self._names, points)
        self._keep(sample)
        return sample

    @property
    def time(self) -> Vector:
        """Simulated seconds of the samples that are kept, of shape (n,)."""
        return np.array([sample.time for sample in self._kept])

    def positions(self) -> dict[str, Matrix]:
        """Positions in the world, each of shape (n, 3), m, NaN while an object was not present.

        Keys are ``tool_<arm>`` and ``object_<name>``, in the order of first appearance.
        """
        found: dict[str, Matrix] = {}
        for row, sample in enumerate(self._kept):
            for name, point in zip(sample.names, sample.points, strict=True):
                if name not in found:
                    found[name] = np.full((len(self._kept), 3), np.nan)
                found[name][row] = point
        return found

    def _keep(self, sample: Sample) -> None:
        if self._seen % self._stride == 0:
            self._kept.append(sample)
        self._seen += 1
        if len(self._kept) * max(len(sample.names), _FEWEST) > MOST_POINTS:
            self._kept = self._kept[::2]
            self._stride *= 2

    def _bind(self) -> None:
        world = self._world
        self._bound_to = world.generation
        self._sites = [body.tool_site for body in world.arms.values()]
        self.bases |= {name: body.base.position for name, body in world.arms.items()}
        self._bodies = [world.object_body(name) for name in world.objects]
        self._names = (
            *(f"tool_{name}" for name in world.arms),
            *(f"object_{name}" for name in world.objects),
        )


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
    INVARIANT = "an invariant was violated"
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

    def __init__(self, world: World) -> None:
        self._world = world
        self._kept: BoundedLog[Holding] = BoundedLog(MOST_HOLDINGS)
        self._held: dict[tuple[str, str, float], _Lift] = {}

    def after_ticks(self, time: float) -> None:
        """Add attachments and releases since the last call; ``time`` in s."""
        now = {(held.arm, held.object, held.since) for held in self._world.attachments}
        for key in sorted(now - self._held.keys()):
            self._held[key] = _Lift(Holding(*key))
            self._kept.add(self._held[key].holding)
        for key in self._held.keys() - now:
            self._held.pop(key).holding.released_s = time

    def sampled(self, sample: Sample) -> None:
        """Update the lifted heights of held objects."""
        for lift in self._held.values():
            lift.update(sample)

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
        """Code of its failure, ``HALTED`` if it was halted, otherwise empty."""
        return self.runs[-1].code

    @property
    def reason(self) -> str:
        """Sentence on its failure, otherwise empty."""
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
        fault: Sentence on an error of the tree itself rather than of a leaf, otherwise empty.
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
        runs: Every run of every leaf, in the order of their start; for a leaf that runs many times,
            the first 200 and the last 200.
        runs_left_out: Number of dropped runs.
        fault: Sentence on an error of the tree itself rather than of a leaf, otherwise empty.
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


@dataclass(frozen=True)
class GoalResult:
    """Whether a goal of the file was met in the true world at the end of a run.

    Attributes:
        met: Whether it was met.
        reason: Sentence on what was not met, otherwise empty.
    """

    met: bool
    reason: str = ""


@dataclass(frozen=True, repr=False)
class RunResult:
    """Result of the whole run.

    Attributes:
        ending: Why it ended.
        sim_time_s: Simulated seconds, including the time to stop the arms.
        wall_time_s: Wall-clock seconds of the same.
        arms: Result of each arm, by its name, in the order of the file.
        at_rest: Whether every arm was at rest at the end.
        error: Sentence on the error that ended the run, otherwise empty.
        name: Name of the tree file.
        seed: Seed of all random numbers.
        renderer: ``gl``, ``ray``, or None if no arm has a camera.
        reality: Deviations of each arm from its nominal model, by the arm's name: settings that
            differ from the ideal, as below ``reality`` in a file.
        state_sha256: Hash of the states of the simulation, in hexadecimal: equal for bitwise equal
            runs.
        goals: Result of each goal of the file, by name; empty if it declares none.
        faults: Injected faults that have started or ended, in order; the first 1000.
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
    goals: Mapping[str, GoalResult] = field(default_factory=dict)
    faults: tuple[FaultEvent, ...] = ()

    @property
    def goals_met(self) -> bool:
        """Whether every goal of the file was met."""
        return all(goal.met for goal in self.goals.values())

    @property
    def is_false_success(self) -> bool:
        """Whether the trees report SUCCESS, but a goal was not met."""
        return self.outcome is Outcome.SUCCESS and not self.goals_met

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
