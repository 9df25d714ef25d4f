"""Dispatch of jobs to an engine: keeps all workers busy, and writes rows as they come."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Generator, Iterator
from typing import Final

from bt_dualarm.sweeps.engine import Done, Engine, Task
from bt_dualarm.sweeps.job import REFUSED, Job, Row
from bt_dualarm.sweeps.manifest import SweepError
from bt_dualarm.sweeps.table import RowStore

_WRITE_S: Final = 1.0
"""Wall-clock seconds between two writes of rows: what a killed sweep loses at most."""

_WAIT_S: Final = 0.2
_AHEAD: Final = 2
"""Tasks queued per slot, so that no worker waits for this process."""


def run_jobs(
    jobs: Iterator[Job],
    engine: Engine,
    store: RowStore,
    take: Callable[[Done], Row | Task],
) -> Generator[float, None, None]:
    """Run jobs; yields the wall-clock seconds since the begin after each wait for results.

    Args:
        jobs: The jobs; the next one is asked for once a worker is free for it.
        engine: Engine to run them on; the caller closes it.
        store: Where rows are written; closing the iterator writes all that have come.
        take: Called with each finished task; returns the row to write, or the task that has to run
            before there is one.

    Raises:
        SweepError: A worker has other code or files, or ``take`` raised it.
    """
    began = time.monotonic()
    unwritten: list[Row] = []
    written_at = began
    again: deque[Task] = deque()
    outstanding = 0
    more = True
    try:
        while more or outstanding or again:
            while outstanding < _AHEAD * max(engine.slots, 1) and (again or more):
                task = again.popleft() if again else _next(jobs)
                if task is None:
                    more = False
                    break
                engine.submit(task)
                outstanding += 1
            for done in engine.completed(_WAIT_S):
                outstanding -= 1
                _raise_if_refused(done)
                taken = take(done)
                if isinstance(taken, Task):
                    again.append(taken)
                else:
                    unwritten.append(taken)
            now = time.monotonic()
            if unwritten and now - written_at >= _WRITE_S:
                store.add(unwritten)
                unwritten = []
                written_at = now
            yield now - began
    finally:
        store.add(unwritten)
        store.merge()


def _next(jobs: Iterator[Job]) -> Task | None:
    job = next(jobs, None)
    return None if job is None else Task(job)


def _raise_if_refused(done: Done) -> None:
    if done.row.get("outcome") == REFUSED:
        raise SweepError(
            f"{done.row.get('machine')} ({done.worker}) cannot run {done.task.job.label}: "
            f"{done.row.get('reason')}. All workers need the same environment and files, which "
            "must not change while a sweep runs; finished trials are kept"
        )
