"""Trials of many cells, side by side in processes of their own where asked."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from multiprocessing import get_context

from bt_dualarm.experiments.cases import Cell
from bt_dualarm.experiments.trial import Trial, TrialError, run_trial
from bt_dualarm.registry import Registry


def usable_cores() -> int:
    """How many processes can run side by side here."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def run_trials(
    runs: Sequence[tuple[Cell, int]], registry: Registry, jobs: int = 1
) -> Iterator[Trial | TrialError]:
    """The trial of each cell with its seed, in order as they come, or why there is none.

    Args:
        runs: Cells and seeds.
        registry: The installed skills; other processes find them again.
        jobs: Processes side by side; with one, no other process is started.

    Raises:
        DualArmError: A file or the renderer cannot be used.
    """
    if jobs == 1 or len(runs) < 2:
        yield from (_tried(cell, seed, registry) for cell, seed in runs)
        return
    pool = ProcessPoolExecutor(min(jobs, len(runs)), get_context("spawn"))
    try:
        yield from pool.map(_tried, *zip(*runs, strict=True))
    finally:
        pool.shutdown(cancel_futures=True)


@cache
def _registry() -> Registry:
    """One a process."""
    return Registry.load()


def _tried(cell: Cell, seed: int, registry: Registry | None = None) -> Trial | TrialError:
    """A trial, or why there is none; for a process of its own without a registry."""
    try:
        return run_trial(cell, seed, registry or _registry())
    except TrialError as error:
        return error
