"""One trial of a sweep: a run, its result as a row, and the record and cause of a failure.

A trial runs without a record, which would take time. If it does not succeed, it runs again with
one, which gives its cause; as runs are bit-for-bit repeatable, the second run is the same, and if
it is not, the row is marked.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Final, Literal, TypeAlias

from bt_dualarm.behaviors.report import StatusChange
from bt_dualarm.core.errors import DualArmError, Overrun
from bt_dualarm.diagnosis.story import stories
from bt_dualarm.replay.record import Record
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.runtime.file_check import check as check_tree
from bt_dualarm.runtime.file_check import checked_faults
from bt_dualarm.runtime.options import RunOptions, checked_reality
from bt_dualarm.runtime.outcome import Outcome, RunResult
from bt_dualarm.runtime.rules import RuleCheck
from bt_dualarm.runtime.run import Run
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.yaml_reader import TreeInput
from bt_dualarm.sweeps.inputs import inputs_of
from bt_dualarm.sweeps.job import (
    Cell,
    Costs,
    Row,
    difference,
    flat,
    lost_columns,
    refused_columns,
    short,
)
from bt_dualarm.sweeps.manifest import TrialSpec

Keep: TypeAlias = Literal["failures", "all", "none"]
"""Which records a sweep keeps."""

Rules: TypeAlias = Literal["none", "contact", "all"]
"""Which rules of every run are checked: none, no contact between arms, or all of `RuleCheck`."""

Branch: TypeAlias = tuple[str, str]
"""Path of a node, and SUCCESS or FAILURE: what its parent does next depends on which it returns."""

RECORDS: Final = "records"
"""Folder of the records below the output folder, each named by its trial's identity."""

FALSE_SUCCESS: Final = "FALSE_SUCCESS"
"""Outcome of a trial whose trees report SUCCESS although a goal of the file is not met."""


@dataclass(frozen=True)
class TrialJob:
    """What a worker needs to run a trial: a `job.Job`.

    Attributes:
        tree: The tree.
        folder: Folder from which relative paths of a text or mapping start.
        skills: Folders of additional skills.
        trial: The trial.
        duration: Simulated seconds at most, or None.
        watchdog: Wall-clock budget of a tick, s, or None.
        keep: Which records to keep.
        records: Folder for the records.
        faults: Faults in addition to the tree's, or None.
        rules: Which rules of every run to check, as fault injection does.
        inputs: Digests of code, tree and files that the worker must find the same; empty for any.
    """

    tree: TreeInput
    folder: Path | None
    skills: tuple[Path, ...]
    trial: TrialSpec
    duration: float | None
    watchdog: float | None
    keep: Keep
    records: Path
    faults: TreeInput | None = None
    rules: Rules = "none"
    inputs: Mapping[str, str] = field(default_factory=dict)

    @property
    def index(self) -> int:
        """Number of the trial in its sweep, from 0."""
        return self.trial.index

    @property
    def identity(self) -> str:
        """Hash of everything that determines the trial's result."""
        return self.trial.identity

    @property
    def label(self) -> str:
        """Name of the trial in messages."""
        return f"trial {self.trial.index}"

    def run(self) -> Row:
        """Run the trial, as `run_trial`."""
        return run_trial(self)

    def lost_row(self, reason: str, attempts: int) -> Row:
        """Row of the trial if its worker died each time."""
        return lost_row(self.trial, reason, attempts)


def run_trial(job: TrialJob) -> Row:
    """Run a trial and return its row; an error of the run becomes part of the row."""
    costs = Costs()
    trial = job.trial
    row = _columns_of(trial)
    try:
        foreign = _foreign_inputs(job)
        if foreign:
            return {**row, **refused_columns(foreign)}
        record = job.records / trial.identity if job.keep == "all" else None
        result, broken, branches = _run(job, record)
        row |= _of_result(result)
        if job.rules != "none":
            row |= {"broken_rule": broken}
            for arm, taken in branches.items():
                lines = (f"{path}\t{status}\t{s:.3f}" for (path, status), s in taken.items())
                row[f"branches.{arm}"] = "\n".join(lines)
        if record is None and (result.outcome is not Outcome.SUCCESS or not result.goals_met):
            row |= _cause(job, result)
        elif record is not None:
            row |= _diagnosis(record) if result.outcome is not Outcome.SUCCESS else {}
    except DualArmError as error:
        # The tree does not fit these parameters, or the world cannot be composed with them.
        text = str(error).strip().splitlines() or [""]
        row |= {"outcome": "ERROR", "code": type(error).__name__, "reason": short(text[0])}
    except Overrun as overrun:
        row |= {"outcome": "UNFINISHED", "code": "OVERRUN", "reason": short(str(overrun))}
    return {**row, **costs.columns()}


def lost_row(trial: TrialSpec, reason: str, attempts: int) -> Row:
    """Row of a trial whose worker died each time."""
    return {**_columns_of(trial), **lost_columns(reason, attempts)}


def _columns_of(trial: TrialSpec) -> dict[str, Cell]:
    """Columns that name the trial."""
    return {
        "trial": trial.index,
        "identity": trial.identity,
        **{f"param.{name}": flat(value) for name, value in trial.params.items()},
        "seed": trial.seed,
        "reality": trial.reality or "",
    }


@lru_cache(maxsize=4)
def _registry(skills: tuple[Path, ...]) -> Registry:
    return Registry.load(skills)


_files: dict[str, TreeFile] = {}
"""Checked tree files of this process, by their parameters: each is read once."""

_MOST_FILES: Final = 64


def _file(job: TrialJob) -> TreeFile:
    key = repr((job.tree, job.folder, job.skills, sorted(job.trial.params.items())))
    if key not in _files:
        if len(_files) >= _MOST_FILES:
            _files.pop(next(iter(_files)))
        kinds = _registry(job.skills).kinds
        _files[key] = check_tree(
            job.tree, kinds, job.trial.params, folder=job.folder, build=False
        ).runnable()
    return _files[key]


_confirmed: set[str] = set()
"""Digests of inputs that this process has found the same."""


def _foreign_inputs(job: TrialJob) -> str:
    """What of a job's inputs this process finds different, as a list; empty if nothing is."""
    key = repr(sorted(job.inputs.items()))
    if not job.inputs or key in _confirmed:
        return ""
    if isinstance(job.tree, Path) and not job.tree.is_file():
        return f"it has no file {job.tree}"
    file = _file(job)
    differing = difference(inputs_of(file.texts.values(), file, job.skills), job.inputs)
    if differing:
        return differing
    _confirmed.add(key)
    return ""


class BranchObserver(IdleObserver):
    """Collects the branches of trees that a run takes.

    Attributes:
        taken: Branches by the name of the arm, in the order in which they were first taken, with
            the simulated seconds for which the node had run.
    """

    def __init__(self) -> None:
        self._began: dict[tuple[str, str], float] = {}
        self.taken: dict[str, dict[Branch, float]] = {}

    def on_event(self, change: StatusChange) -> None:
        """Note that a node has begun or ended."""
        place = change.arm, change.path
        if change.new == "RUNNING":
            self._began[place] = change.time
        else:
            seconds = change.time - self._began.pop(place, change.time)
            if change.new != "INVALID":
                taken = self.taken.setdefault(change.arm, {})
                taken.setdefault((change.path, change.new), seconds)


def _run(
    job: TrialJob, record: Path | None
) -> tuple[RunResult, str, Mapping[str, Mapping[Branch, float]]]:
    """Result of the run, a sentence on a broken rule, empty if none was, and the branches taken."""
    file = _file(job)
    reality = None if job.trial.reality is None else checked_reality(job.trial.reality)
    options = RunOptions(
        seed=job.trial.seed,
        duration=job.duration,
        reality=reality,
        record=record,
        watchdog=job.watchdog,
        faults={} if job.faults is None else checked_faults(file, job.faults),
    )
    if record is not None:
        shutil.rmtree(record, ignore_errors=True)  # left by a worker that died
    with Run(file, _registry(job.skills), options) as run:
        check = RuleCheck(run.world, of_motion=job.rules == "all")
        branches = BranchObserver()
        if job.rules != "none":
            run.watch(check)
            run.watch(branches)
        result = run.finish()
        if record is not None:
            # A second request skips the plots, which would take longer than a short run.
            run.stop()
            run.stop()
    return result, check.broken, branches.taken


def _of_result(result: RunResult) -> dict[str, Cell]:
    """Columns of a result: outcome, the deciding leaf by a simple rule, metrics."""
    row: dict[str, Cell] = {
        "outcome": FALSE_SUCCESS if result.is_false_success else str(result.outcome),
        "ending": str(result.ending),
        "sim_time_s": result.sim_time_s,
        "state_sha256": result.state_sha256,
        "code": "",
        "arm": "",
        "leaf": "",
        "reason": short(result.error),
        "cause": "",
    }
    for name, goal in result.goals.items():
        row[f"goal.{name}"] = goal.met
        if not goal.met and result.is_false_success and not row["code"]:
            row |= {"code": "GOAL_NOT_MET", "leaf": name, "reason": short(goal.reason)}
    for arm in result.arms.values():
        row[f"outcome.{arm.name}"] = str(arm.outcome)
        for path, leaf in arm.leaves.items():
            for name, value in leaf.metrics.items():
                cell = float(value) if type(value) in (int, float) else value
                if isinstance(cell, float | bool | str):
                    row[f"metric.{arm.name}.{path}.{name}"] = (
                        short(cell) if isinstance(cell, str) else cell
                    )
    failed = [
        (run.ended_s or 0.0, arm.name, run)
        for arm in result.arms.values()
        if arm.outcome is Outcome.FAILURE
        for run in arm.runs
        if run.status == "FAILURE"
    ]
    if failed:
        _, name, last = max(failed, key=lambda one: one[0])
        row |= {"arm": name, "leaf": last.path, "code": last.code, "reason": short(last.reason)}
    return row


def _cause(job: TrialJob, first: RunResult) -> dict[str, Cell]:
    """Repeat a failed trial with a record, and diagnose it."""
    with tempfile.TemporaryDirectory() as scratch:
        kept = job.keep == "failures"
        record = job.records / job.trial.identity if kept else Path(scratch) / "record"
        again, *_ = _run(job, record)
        if again.state_sha256 != first.state_sha256:
            hashes = f"{first.state_sha256[:12]} and {again.state_sha256[:12]}"
            return {"code": "NOT_REPEATABLE", "reason": f"two runs had the hashes {hashes}"}
        return _diagnosis(record)


def _diagnosis(record: Path) -> dict[str, Cell]:
    """The deciding leaf of a failure and its cause, as ``bt-why`` gives them."""
    found = stories(Record.read(record))
    if not found:
        return {}
    story = found[0]
    cause = story.causes[0]
    return {
        "arm": story.arm,
        "leaf": story.leaf,
        "code": story.code or story.status,
        "reason": short(story.reason or cause.sentence),
        "cause": cause.kind,
        "cause_sentence": short(cause.sentence),
    }
