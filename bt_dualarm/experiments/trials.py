"""Trials of many cells, side by side in processes of their own where asked."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from functools import cache
from multiprocessing import get_context
from multiprocessing.connection import Connection
from threading import Thread
from typing import Final

from bt_dualarm.errors import DualArmError
from bt_dualarm.experiments.cases import Cell
from bt_dualarm.experiments.trial import Trial, TrialError, run_trial
from bt_dualarm.runtime.signals import StopRequest
from bt_dualarm.skill.registry import Registry

_LOOK_S: Final = 0.1
"""Between two looks whether the end was asked for, while others compute."""


def usable_cores() -> int:
    """How many processes can run side by side here."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def run_trials(
    runs: Sequence[tuple[Cell, int]],
    registry: Registry,
    jobs: int = 1,
    stop: StopRequest | None = None,
) -> Iterator[Trial | TrialError]:
    """The trial of each cell with its seed, in order as they come, or why there is none.

    Args:
        runs: Pairs of a cell and a seed.
        registry: Installed skills; other processes find them again.
        jobs: Number of processes side by side; with one, no other process is started.
        stop: Request to end early; what is not complete then does not come.

    Raises:
        DualArmError: A file or the renderer cannot be used, or a process has died.
    """
    request = stop or StopRequest()
    if jobs == 1 or len(runs) < 2:
        for cell, seed in runs:
            trial = _tried(cell, seed, registry, request)
            if request.asked:
                return
            yield trial
    else:
        yield from _side_by_side(runs, min(jobs, len(runs)), request)


def _side_by_side(
    runs: Sequence[tuple[Cell, int]], jobs: int, stop: StopRequest
) -> Iterator[Trial | TrialError]:
    """The same in processes that end with this one, however it ends."""
    context = get_context("spawn")
    theirs, ours = context.Pipe(duplex=False)
    pool = ProcessPoolExecutor(jobs, context, _end_with_parent, (theirs,))
    try:
        coming = [pool.submit(_tried_elsewhere, cell, seed) for cell, seed in runs]
        for trial in coming:
            while not wait([trial], _LOOK_S).done:
                if stop.asked:
                    return
            yield _outcome(trial)
        pool.shutdown()
    finally:
        ours.close()
        pool.shutdown(cancel_futures=True)


def _outcome(trial: Future[Trial | TrialError]) -> Trial | TrialError:
    try:
        return trial.result()
    except BrokenProcessPool as error:
        words = "a process that runs experiments has died; --jobs 1 runs them in this one"
        raise DualArmError(words) from error


def _end_with_parent(parent: Connection) -> None:
    """End this process when the other end of a pipe is closed, which a killed parent's is, too.

    The pool's own processes would wait for work for ever. Ctrl-C, which all processes of a
    terminal get, is left to the parent.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_wait_for_end, args=(parent,), daemon=True).start()


def _wait_for_end(parent: Connection) -> None:
    parent.poll(None)
    os.kill(os.getpid(), signal.SIGKILL)


@cache
def _registry() -> Registry:
    """One a process."""
    return Registry.load()


def _tried_elsewhere(cell: Cell, seed: int) -> Trial | TrialError:
    """A trial in a process of its own, whose errors are sent as what every process knows."""
    try:
        return _tried(cell, seed, _registry(), StopRequest())
    except DualArmError as error:
        raise DualArmError(str(error)) from None


def _tried(cell: Cell, seed: int, registry: Registry, stop: StopRequest) -> Trial | TrialError:
    """A trial, or why there is none."""
    try:
        return run_trial(cell, seed, registry, stop=stop)
    except TrialError as error:
        return error
