"""The programming interface of sweeps: sweep a tree, merge shards, compare two sweeps."""

from __future__ import annotations

import json
import math
import os
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from functools import cache, partial
from numbers import Real
from pathlib import Path
from typing import Any, Final, TypeAlias, get_args

import numpy as np

from bt_dualarm.core.share import kind_at
from bt_dualarm.experiments.trials import usable_cores
from bt_dualarm.runtime.api import GivenFaults, Tree, faults_input, tree_input
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.runtime.options import (
    checked_params,
    checked_path,
    checked_seconds,
    checked_seed,
    listed,
)
from bt_dualarm.spec.yaml_reader import is_yaml
from bt_dualarm.sweeps.comparison import Comparison
from bt_dualarm.sweeps.comparison import compare as compare_folders
from bt_dualarm.sweeps.engine import DaskEngine, Engine, ProcessEngine
from bt_dualarm.sweeps.manifest import (
    Grid,
    Manifest,
    SamplerName,
    SweepError,
    Values,
    checked,
    is_manifest,
    read_manifest,
    seeds_of,
    shard_of,
    values_of,
)
from bt_dualarm.sweeps.report import title_of, write_report
from bt_dualarm.sweeps.search import search_boundary
from bt_dualarm.sweeps.sweep import Progress, StopCondition, SweepResult, run_sweep
from bt_dualarm.sweeps.table import (
    MANIFEST,
    TABLE,
    RowStore,
    digest,
    ordered,
    read_rows,
    write_table,
)
from bt_dualarm.sweeps.trial import RECORDS, Keep

PathLike: TypeAlias = str | os.PathLike[str]

DEFAULT_SEEDS: Final = 10
"""Number of seeds if none are given."""


def sweep(
    tree: Tree,
    *,
    out: PathLike,
    seeds: int | str | Iterable[int] | None = None,
    params: Mapping[str, object] | None = None,
    reality: str | Iterable[str] | None = None,
    jobs: int | None = None,
    keep: Keep = "failures",
    until: str | None = None,
    audit: float = 0.0,
    shard: str = "1/1",
    sample: SamplerName | None = None,
    samples: int = 0,
    sampling_seed: int = 0,
    search: int | None = None,
    duration: float | None = None,
    watchdog: float | None = None,
    timeout: float | None = None,
    dask: str | None = None,
    skills: Iterable[PathLike] = (),
    faults: GivenFaults | None = None,
    stop: StopRequest | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> SweepResult:
    """Run a tree over seeds, parameters and realities; trials that have run before are kept.

    Args:
        tree: A path, the name of a shipped tree, YAML text, a mapping, or a manifest file, which
            replaces ``seeds``, ``params``, ``reality``, the samples and ``duration``.
        out: Output folder for rows, table, report and records.
        seeds: Number of seeds from 0, text as for ``--seeds``, or seeds; None for 10.
        params: Values of parameters by name: a list or tuple of values, text as for ``--param``, or
            one value.
        reality: Names of realities; None for the tree's.
        jobs: Number of worker processes; None for one per core.
        keep: Which records to keep: ``failures``, ``all`` or ``none``.
        until: Condition for ending early, ``ci<0.02``.
        audit: Fraction of trials to confirm by a second run on another worker, 0 to 1.
        shard: Part of the trials to run here, ``1/4`` to ``4/4``.
        sample: Sampler for parameters that are ranges, ``FROM:TO``.
        samples: Number of samples.
        sampling_seed: Seed of the samples.
        search: Number of halvings of a search for the boundary of success in one or two parameters
            that are ranges; `SweepResult.boundary` has it.
        duration: Simulated seconds after which a trial ends.
        watchdog: Wall-clock budget of a tick of skill code, s.
        timeout: Wall-clock seconds after which a trial counts as hung.
        dask: Dask cluster to run on, ``tcp://HOST:PORT`` or ``local:N``.
        skills: Folders of additional skills.
        faults: Faults to inject in every trial in addition to the tree's: a file with a section
            ``faults``, or a mapping from names to faults.
        stop: Request to end early.
        progress: Called after each change, and some times a second while trials run.

    Raises:
        SweepError: An argument is invalid, or the folder cannot be written to.
        RunError: An argument has no value of its kind.
        SpecError, NoSuchTree, RegistryError: The tree, or a skill, cannot be used.
    """
    fields: dict[str, Any] = {  # Any: fields of `Manifest`
        "seeds": None if seeds is None else _seeds(seeds),
        "params": {name: _values(name, given) for name, given in checked_params(params).items()},
        "realities": None if reality is None else _names(reality),
        "sampler": sample,
        "samples": samples,
        "sampling_seed": sampling_seed,
        "search": search,
        "duration": duration,
        "watchdog": watchdog,
        "skills": tuple(checked_path(one, "skills") for one in listed(skills)),
        "faults": None if faults is None else faults_input(faults),
    }
    for what, seconds in (("duration", duration), ("watchdog", watchdog)):
        if seconds not in (None, math.inf):
            checked_seconds(seconds, what)
    if keep not in get_args(Keep):
        raise SweepError(f"keep: {keep!r} is not one of {', '.join(get_args(Keep))}")
    if stop is not None and not isinstance(stop, StopRequest):
        raise SweepError(f"stop: {stop!r} is not a StopRequest")
    if progress is not None and not callable(progress):
        raise SweepError(f"progress: {progress!r} cannot be called")
    folder = checked_path(out, "out")
    # What a manifest file may not be given besides; an empty list of seeds is an error of its own.
    defaults = {"params": {}, "samples": 0, "sampling_seed": 0, "search": 0, "skills": ()}
    given = {
        name: value
        for name, value in fields.items()
        if value is not None and (name not in defaults or value != defaults[name])
    }
    manifest = checked(_manifest_of(tree, given))
    condition = None if until is None else StopCondition.of(until)
    part = shard_of(shard)
    start = engine_of(jobs, timeout, dask)
    if manifest.search is not None and (condition is not None or part != (1, 1)):
        raise SweepError("a search has neither shards nor a condition for ending early")
    with ExitStack() as stack:

        @cache
        def engine() -> Engine:
            started = start()
            stack.callback(started.close)
            return started

        run = partial(
            run_sweep,
            out=folder,
            engine=engine,
            keep=keep,
            until=condition,
            audit=audit,
            shard=part,
            stop=stop,
            progress=progress,
        )
        result = run(manifest) if manifest.search is None else search_boundary(manifest, run)
    write_report(folder, result.table, manifest.title, result.boundary)
    return result


def merge(folders: Sequence[Path], out: Path) -> SweepResult:
    """Merge the trials of folders into one, with their records, and write table and report.

    Args:
        folders: Output folders of sweeps of the same tree with the same code.
        out: Folder to write to; it may be one of them, or one that has rows already.

    Returns:
        The result of all of them; it is complete if no trial of their manifests is missing.

    Raises:
        SweepError: A folder is not one of a sweep, they cannot be merged, or ``out`` cannot be
            written to.
    """
    wanted = _trials_of(folders)
    others = [folder for folder in folders if folder.resolve() != out.resolve()]
    table = read_rows(folders)
    if table is None:
        raise SweepError("the folders have no trials")
    store = RowStore(out)
    try:
        store.add(ordered(table).to_pylist())
        for folder in others:
            for record in sorted((folder / RECORDS).glob("*")):
                if record.is_dir() and not (out / RECORDS / record.name).exists():
                    shutil.copytree(record, out / RECORDS / record.name)
        if others and not (out / MANIFEST).exists() and (others[0] / MANIFEST).is_file():
            shutil.copy(others[0] / MANIFEST, out / MANIFEST)
        table = ordered(table)
        write_table(table, out / TABLE)
    except OSError as error:
        raise SweepError(f"cannot write to {out}: {error.strerror or error}") from error
    write_report(out, table, title_of(out))
    progress = Progress(len(table))
    for row in table.to_pylist():
        progress.count(row)
    progress.total = max(wanted, len(table))
    complete = len(table) >= wanted
    return SweepResult(out.absolute(), table, digest(table), complete, False, progress)


def _trials_of(folders: Sequence[Path]) -> int:
    """Number of trials of the largest manifest of the folders.

    Raises:
        SweepError: Their trials depend on different code or trees.
    """
    most = 0
    first: tuple[Path, Mapping[str, object]] | None = None
    for folder in folders:
        with suppress(OSError, ValueError):
            content = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
            most = max(most, int(content["trials"]))
            # Shards on different kinds of processors are allowed; the report says so.
            fixed = {name: v for name, v in content["depends_on"].items() if name != "processor"}
            first = first or (folder, fixed)
            differing = sorted(n for n in {*fixed, *first[1]} if fixed.get(n) != first[1].get(n))
            if differing:
                raise SweepError(
                    f"{first[0]} and {folder} are no parts of one sweep, because they differ in "
                    f"{', '.join(differing)}; bt-compare compares two sweeps"
                )
    return most


def compare(a: PathLike, b: PathLike) -> Comparison:
    """Compare the sweeps in two output folders, paired by seed, parameters and reality.

    Raises:
        SweepError: A folder is not one of a sweep, or no trials can be paired.
        RunError: An argument is not a path.
    """
    return compare_folders(checked_path(a, "a"), checked_path(b, "b"))


def engine_of(jobs: int | None, timeout: float | None, dask: str | None) -> Callable[[], Engine]:
    """Factory of the engine that the arguments select.

    Raises:
        SweepError: They contradict each other.
    """
    if timeout is not None and not (isinstance(timeout, Real) and timeout > 0):
        raise SweepError(f"timeout: {timeout!r} is not a number of seconds above 0")
    if dask is not None:
        if jobs is not None:
            raise SweepError("jobs and dask are mutually exclusive: Dask decides how many run")
        return lambda: DaskEngine(dask, timeout)
    if jobs is not None and not (isinstance(jobs, int) and 1 <= jobs <= 1024):
        raise SweepError(f"jobs: {jobs!r} is not a number of workers from 1 to 1024")
    return lambda: ProcessEngine(jobs or usable_cores(), timeout)


def _manifest_of(tree: Tree, given: dict[str, Any]) -> Manifest:  # Any: fields of `Manifest`
    """Manifest of a tree, or the one in a manifest file.

    Raises:
        SweepError: The fields contradict each other, or are given in addition to a manifest file.
        SpecError: The manifest file has errors.
    """
    is_path = isinstance(tree, os.PathLike) or (isinstance(tree, str) and not is_yaml(tree))
    if is_path and kind_at(Path(tree)) == "file" and is_manifest(Path(tree)):  # type: ignore[arg-type]
        beside = given.keys() - {"watchdog"}
        if beside:
            name = sorted(beside)[0]
            raise SweepError(f"{name}: the manifest file {tree} defines it; change it there")
        return replace(read_manifest(Path(tree)), **given)  # type: ignore[arg-type]
    return Manifest(tree_input(tree), **{"seeds": tuple(range(DEFAULT_SEEDS))} | given)


def _seeds(seeds: int | str | Iterable[int]) -> tuple[int, ...]:
    if isinstance(seeds, str):
        return seeds_of(seeds)
    if isinstance(seeds, int):
        if isinstance(seeds, bool) or seeds < 1:
            raise SweepError(f"seeds: {seeds!r} is not a number of seeds, at least 1")
        return tuple(range(seeds))
    if not isinstance(seeds, Iterable):
        raise SweepError(f"seeds: {seeds!r} is neither a number of seeds nor a list of them")
    return tuple(map(checked_seed, seeds))


def _names(reality: str | Iterable[str]) -> tuple[str, ...]:
    if isinstance(reality, str):
        return (reality,)
    if not isinstance(reality, Iterable):
        raise SweepError(f"reality: {reality!r} is neither a name nor a list of names")
    return tuple(reality)


def _values(name: str, given: object) -> Values:
    if isinstance(given, str):
        try:
            return values_of(given)
        except SweepError as error:
            raise SweepError(f"{name}: {error}") from error
    if isinstance(given, Grid):
        return given
    if isinstance(given, np.ndarray):
        return tuple(given.tolist())
    if isinstance(given, list | tuple):
        return tuple(given)
    return (given,)
