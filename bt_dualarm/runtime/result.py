"""What a run did: its arms, their leaves, what each leaf measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from bt_dualarm.runtime.named import Named
from bt_dualarm.runtime.outcome import Ending, Outcome, combined
from bt_dualarm.runtime.series import Series
from bt_dualarm.tree.report import LeafReport, StatusName


@dataclass(frozen=True, repr=False)
class LeafResult:
    """What one leaf did. A leaf that ran several times speaks of its last run.

    Attributes:
        runs: Every run of the leaf, as in `ArmResult`, in the order in which they began; at least
            one.
        series: What the leaf measured over time in all its runs, by name.
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
        """SUCCESS, FAILURE, or INVALID of a leaf that was halted."""
        return self.runs[-1].status

    @property
    def code(self) -> str:
        """Code of its failure, ``HALTED`` of a halted leaf, else empty."""
        return self.runs[-1].code

    @property
    def reason(self) -> str:
        """Sentence on its failure, else empty."""
        return self.runs[-1].reason

    @property
    def metrics(self) -> Mapping[str, Any]:  # Any: a number or text, by its name
        """What it measured, with the numbers of its failure; units are part of the names."""
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
    """One stay of an arm in the world; whoever is spawned anew begins its tree anew.

    Attributes:
        outcome: Outcome of its tree in this life.
        ended_s: Simulated time in seconds at which its tree ended; None if it did not.
        fault: What broke the tree itself rather than a leaf of it, else empty.
    """

    outcome: Outcome
    ended_s: float | None = None
    fault: str = ""


@dataclass(frozen=True)
class SlowTick:
    """A tick of an arm's tree that took long.

    Attributes:
        time_s: Simulated time in seconds.
        wall_s: Seconds on the clock that it took.
        leaves: Paths of the leaves that ran in it.
    """

    time_s: float
    wall_s: float
    leaves: tuple[str, ...]


@dataclass(frozen=True, repr=False)
class ArmResult:
    """What one arm did.

    Attributes:
        name: Name of the arm in the file.
        robot: Name of its robot in the catalogue, or the title of a page beside the tree file.
        outcome: Outcome of its tree; of an arm that was spawned several times the worst one, or
            the last one where the file says ``last_life_counts``.
        ended_s: Simulated time in seconds at which its tree ended last; None if it did not.
        clipped_setpoints: Number of set-points that its controller had to clip to its limits.
        runs: Every run of every leaf, in the order in which they began; of a leaf that runs over
            and over the first 200 and the last 200.
        runs_left_out: Number of runs in between that were dropped.
        fault: What broke the tree itself rather than a leaf of it, else empty.
        lives: Each of its stays in the world, or the first 50 and the last 51; none of an arm that
            was never spawned.
        lives_left_out: Number of lives in between that were dropped.
        removable: Whether the file forgives that it was taken away before its tree had ended.
        guard: Smallest distances while it moved, and what its guard did.
        series: What its leaves measured over time, by the leaf's path and by name.
        slow_ticks: The slowest of the ticks that took long on the clock, in the order of time.
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
        """The leaves that ran, by their paths in the tree, in the order in which they began."""
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
    """What the whole run did.

    Attributes:
        ending: Why it ended.
        sim_time_s: Simulated seconds, with the time that stopping the arms took.
        wall_time_s: Seconds on the clock for the same.
        arms: What each arm did, by its name, in the order of the file.
        at_rest: Whether every arm stood still at the end.
        error: Sentence on what broke the run, else empty.
        name: Name of the tree file.
        seed: Seed of everything random.
        renderer: ``gl``, ``ray``, or None where no arm has a camera.
        reality: How far each arm was from what was believed of it, by the arm's name: what differs
            from the ideal, as a file has it below ``reality``.
        state_sha256: Hash of the states that the simulation went through, in hexadecimal: equal
            for runs that are equal to the last bit.
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
        """SUCCESS, FAILURE or UNFINISHED of all trees together, in all lives of their arms."""
        return combined(
            [
                arm.outcome
                for arm in self.arms.values()
                if not (arm.removable and arm.outcome is Outcome.REMOVED)
            ]
        )

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds a second on the clock; 0 for a run that took no time."""
        return self.sim_time_s / self.wall_time_s if self.wall_time_s > 0 else 0.0

    def __repr__(self) -> str:
        arms = ", ".join(f"{arm.name} {arm.outcome}" for arm in self.arms.values())
        return (
            f"<RunResult {self.name}: {self.outcome} after {self.sim_time_s:.3f} s, "
            f"{self.ending} ({arms})>"
        )
