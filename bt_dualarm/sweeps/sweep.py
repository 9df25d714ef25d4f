"""A sweep: runs what is missing of a manifest, and writes rows, table and report."""

from __future__ import annotations

import json
import math
import re
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING

from bt_dualarm.core.share import write_text
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.spec.node_types import counted
from bt_dualarm.spec.yaml_reader import read_tree
from bt_dualarm.sweeps.dispatch import run_jobs
from bt_dualarm.sweeps.engine import Done, Engine, Task
from bt_dualarm.sweeps.job import CRASHED, Job, Row
from bt_dualarm.sweeps.manifest import Manifest, NoTrials, SweepError, TrialSpec
from bt_dualarm.sweeps.statistics import Boundary, SuccessRate
from bt_dualarm.sweeps.table import (
    FAULTS,
    MANIFEST,
    TABLE,
    RowStore,
    digest,
    ordered,
    read_rows,
    write_table,
)
from bt_dualarm.sweeps.trial import RECORDS, Keep, Rules, TrialJob

if TYPE_CHECKING:
    import pyarrow as pa


@dataclass
class Progress:
    """What a sweep has done so far.

    Attributes:
        total: Number of trials of the manifest (of the shard).
        known: Trials that had a row before.
        done: Trials that have a row now.
        successes: Trials with SUCCESS.
        outcomes: Trials by outcome.
        failures: Trials without SUCCESS, by code and leaf.
        retried: Trials whose worker died at least once.
        audited: Trials that were confirmed by a second run on another worker.
        processors: Trials by the kind of processor that ran them.
        running_s: Wall-clock seconds of this sweep.
        workers: Number of trials that can run at the same time now; 0 while a cluster has no
            worker.
    """

    total: int
    known: int = 0
    done: int = 0
    successes: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    failures: Counter[str] = field(default_factory=Counter)
    retried: int = 0
    audited: int = 0
    processors: Counter[str] = field(default_factory=Counter)
    running_s: float = 0.0
    workers: int = 1

    @property
    def rate(self) -> SuccessRate:
        """Success rate so far."""
        return SuccessRate(self.successes, self.done)

    @property
    def left_s(self) -> float:
        """Remaining wall-clock seconds at the current pace; infinity before the first trial."""
        new = self.done - self.known
        return (self.total - self.done) * self.running_s / new if new else math.inf

    def count(self, row: Row) -> None:
        """Count a row."""
        self.done += 1
        outcome = str(row.get("outcome"))
        self.outcomes[outcome] += 1
        self.processors[str(row.get("processor"))] += 1
        if outcome == "SUCCESS":
            self.successes += 1
        else:
            what = " ".join(
                filter(None, (str(row.get("code") or outcome), str(row.get("leaf") or "")))
            )
            self.failures[what] += 1
        attempts = row.get("attempts")
        if isinstance(attempts, int) and attempts > 1:
            self.retried += 1


@dataclass(frozen=True)
class StopCondition:
    """Condition that ends a sweep early: an interval that is narrow enough.

    Attributes:
        width: Width of the widest Wilson interval of all combinations of parameters and reality.
    """

    width: float

    @classmethod
    def of(cls, text: str) -> StopCondition:
        """Condition from text, ``ci<0.02``.

        Raises:
            SweepError: The text is not of this form.
        """
        match = re.fullmatch(r"\s*ci\s*<\s*(0?\.\d+|1(?:\.0*)?)\s*", str(text))
        if match is None or float(match[1]) <= 0:
            raise SweepError(f"until: {text!r} is not a condition such as ci<0.02, a 2 % interval")
        return cls(float(match[1]))


@dataclass(frozen=True, eq=False)
class SweepResult:
    """Result of a sweep.

    Attributes:
        folder: Output folder, absolute.
        table: Rows in the order of the trials, a ``pyarrow.Table``; ``to_pandas()`` and
            ``to_pylist()`` convert it.
        sha256: Hash of all results without the costs, the same for every engine and order.
        complete: Whether every trial of the manifest (of the shard) has a row.
        enough: Whether the requested interval was reached before all trials had run.
        progress: Numbers of trials, in all and by outcome.
        boundary: Boundary of success, if it was searched.
    """

    folder: Path
    table: pa.Table
    sha256: str
    complete: bool
    enough: bool
    progress: Progress
    boundary: Boundary | None = None

    @property
    def rate(self) -> SuccessRate:
        """Success rate of the trials in the table."""
        outcomes = self.table["outcome"].to_pylist()
        return SuccessRate(outcomes.count("SUCCESS"), len(outcomes))

    def __repr__(self) -> str:
        state = "" if self.complete else ", incomplete"
        return f"<SweepResult {counted(len(self.table), 'trial')}{state}: {self.rate} succeed>"

    def _repr_html_(self) -> str:
        from bt_dualarm.sweeps.report import cells_of, html_cells

        return html_cells(cells_of(self.table))


def run_sweep(
    manifest: Manifest,
    out: Path,
    engine: Callable[[], Engine],
    *,
    keep: Keep = "failures",
    until: StopCondition | None = None,
    audit: float = 0.0,
    shard: tuple[int, int] = (1, 1),
    rules: Rules = "none",
    stop: StopRequest | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> SweepResult:
    """Run the trials of a manifest that have no row yet.

    Args:
        manifest: Checked manifest.
        out: Output folder. Rows of other manifests in it are kept, and used where trials are equal.
        engine: Returns the engine; called only if something is left to run. The caller closes it.
        keep: Which records to keep, in `RECORDS` below the folder, named by the trial's identity.
        until: Condition for ending early. It is evaluated on the trials without a gap from the
            first on, so the result does not depend on the order in which they end.
        audit: Fraction of the new trials to run again on another worker, 0 to 1.
        shard: Number of the shard to run, from 1, and the number of shards.
        rules: Which rules of every run to check; the column ``broken_rule`` has what was found.
        stop: Request to end early; finished trials are kept.
        progress: Called after each change.

    Raises:
        SweepError: The folder cannot be written to, or an audit found another result.
    """
    if not isinstance(audit, Real) or not 0.0 <= audit <= 1.0:
        raise SweepError(f"audit: {audit!r} is not a fraction of trials, 0 to 1")
    stop = stop or StopRequest()
    store = RowStore(out)
    wanted = list(manifest.trials(shard))
    # Trials without a result are tried again: their machine may have been at fault.
    finished = {one: row for one, row in _rows_of(out).items() if row["outcome"] != CRASHED}
    _write_manifest(manifest, out)
    state = Progress(len(wanted))
    watch = _Watch(manifest, wanted, until)
    for trial in wanted:
        if trial.identity in finished:
            state.count(finished[trial.identity])
            watch.add(trial.index, finished[trial.identity])
    state.known = state.done
    tell = progress or (lambda _: None)
    tell(state)
    left = deque(trial for trial in wanted if trial.identity not in finished)
    if left and not watch.enough:
        jobs = (_job(manifest, trial, keep, rules, out) for trial in left)
        _run_all(jobs, engine(), store, watch, state, audit, stop, tell)
    table = _table_of(out, wanted, watch)
    write_table(table, out / TABLE)
    complete = len(table) == len(wanted)
    return SweepResult(out.absolute(), table, digest(table), complete, watch.enough, state)


def _job(manifest: Manifest, trial: TrialSpec, keep: Keep, rules: Rules, out: Path) -> TrialJob:
    """The trial for a worker, whose current folder may be another one."""
    tree = manifest.tree
    return TrialJob(
        tree.absolute() if isinstance(tree, Path) else tree,
        (manifest.folder or Path()).absolute(),
        tuple(folder.absolute() for folder in manifest.skills),
        trial,
        manifest.duration,
        manifest.watchdog,
        keep,
        (out / RECORDS).resolve(),
        manifest.faults,
        rules,
        manifest.inputs_at(trial.params),
    )


def _rows_of(out: Path) -> Mapping[str, Row]:
    """Rows in a folder by identity: only what counting needs."""
    table = read_rows([out])
    if table is None:
        return {}
    names = [
        name
        for name in ("identity", "outcome", "code", "leaf", "processor", "attempts")
        if name in table.column_names
    ]
    return {row["identity"]: row for row in table.select(names).to_pylist()}


def _table_of(out: Path, wanted: Sequence[TrialSpec], watch: _Watch) -> pa.Table:
    """Rows of the manifest's trials, numbered as in it; those before the end if it came early."""
    last = watch.ends_at
    index = {trial.identity: trial.index for trial in wanted if last is None or trial.index <= last}
    table = read_rows([out])
    if table is None:
        raise NoTrials("no trial has finished: there is nothing to report")
    table = ordered(table, index)
    if not len(table):
        raise NoTrials("no trial has finished: there is nothing to report")
    # An older manifest may have given the same trial another number.
    import pyarrow as pa

    numbers = pa.array([index[one] for one in table["identity"].to_pylist()], pa.int64())
    return ordered(table.set_column(table.column_names.index("trial"), "trial", numbers))


def _write_manifest(manifest: Manifest, out: Path) -> None:
    try:
        write_text(out / MANIFEST, json.dumps(manifest.as_dict(), indent=2) + "\n")
        if manifest.faults is None:
            (out / FAULTS).unlink(missing_ok=True)
        else:
            faults = read_tree(manifest.faults, manifest.folder).data
            write_text(out / FAULTS, json.dumps(faults, indent=2) + "\n")
    except OSError as error:
        raise SweepError(f"cannot write to {out}: {error.strerror or error}") from error


class _Watch:
    """Evaluates the condition for ending early, on trials without a gap from the first on."""

    def __init__(
        self, manifest: Manifest, wanted: Sequence[TrialSpec], until: StopCondition | None
    ) -> None:
        self._until = until
        self._order = deque(trial.index for trial in wanted)
        self._outcomes: dict[int, bool] = {}
        self._cells = len(manifest.points) * len(manifest.realities)
        # A shard may have trials of some combinations only.
        self._own_cells = {trial.index % self._cells for trial in wanted}
        self._rates: dict[int, SuccessRate] = {}
        self.ends_at: int | None = None

    @property
    def enough(self) -> bool:
        """Whether the condition holds."""
        return self.ends_at is not None

    def add(self, index: int, row: Row) -> None:
        """Count a trial's row."""
        if self._until is None or self.enough:
            return
        self._outcomes[index] = row.get("outcome") == "SUCCESS"
        while self._order and self._order[0] in self._outcomes:
            first = self._order.popleft()
            cell = first % self._cells
            before = self._rates.get(cell, SuccessRate(0, 0))
            self._rates[cell] = SuccessRate(
                before.successes + self._outcomes.pop(first), before.trials + 1
            )
            if len(self._rates) == len(self._own_cells) and self._is_narrow(self._until):
                self.ends_at = first
                return

    def _is_narrow(self, until: StopCondition) -> bool:
        return all(rate.width < until.width for rate in self._rates.values())


def _run_all(
    jobs: Iterator[Job],
    engine: Engine,
    store: RowStore,
    watch: _Watch,
    state: Progress,
    audit: float,
    stop: StopRequest,
    tell: Callable[[Progress], None],
) -> None:
    if stop.asked:
        return
    with closing(run_jobs(jobs, engine, store, partial(_taken, watch, state, audit))) as waits:
        for running_s in waits:
            state.running_s = running_s
            state.workers = engine.slots
            tell(state)
            if stop.asked or watch.enough:
                return


def _taken(watch: _Watch, state: Progress, audit: float, done: Done) -> Row | Task:
    """Count a finished task.

    Returns:
        Its row, or the task that is to confirm it, if it is chosen for that.

    Raises:
        SweepError: It was to confirm another run, and its result differs.
    """
    job = done.task.job
    first = done.task.audit_of
    if first is not None:
        _refuse_difference(first, done)
        state.audited += 1
        return {**first, "audited": True}
    state.count(done.row)
    watch.add(job.index, done.row)
    # The choice depends on the trial only, so that every machine chooses the same trials.
    chosen = int(job.identity[:8], 16) / 0x1_0000_0000 < audit
    if chosen and done.row.get("outcome") != CRASHED:
        return Task(job, done.row, done.worker)
    return done.row


def _refuse_difference(first: Row, done: Done) -> None:
    same = all(first.get(name) == done.row.get(name) for name in ("outcome", "state_sha256"))
    if same:
        return
    places = [
        f"{row.get('outcome')} {str(row.get('state_sha256'))[:12]} on {row.get('machine')} "
        f"(processor {row.get('processor')})"
        for row in (first, done.row)
    ]
    raise SweepError(
        f"{done.task.job.label} gave two results: {places[0]}, then {places[1]}. "
        "Processors of one kind give the same result; a skill that is random or reads the clock "
        "does not"
    )
