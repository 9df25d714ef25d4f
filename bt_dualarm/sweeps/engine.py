"""Engines that run the trials of a sweep: worker processes of this machine, or Dask.

A worker runs one trial after the other in a process of its own, which may die: by a segmentation
fault, the system's out-of-memory killer or ``kill -9``. That costs the time of one trial, which is
tried again in a new process, up to `ATTEMPTS` times. A trial that ends with FAILURE has a result
and is never repeated.
"""

from __future__ import annotations

import math
import os
import queue
import re
import select
import signal
import socket
import subprocess
import sys
import time
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from fcntl import F_SETFL, fcntl
from importlib import import_module
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, Protocol

from bt_dualarm.sweeps.job import Job, Row
from bt_dualarm.sweeps.manifest import SweepError

ATTEMPTS: Final = 3
"""Times that a trial is tried whose worker dies."""

MOST_MEMORY_MB: Final = 1500.0
"""Peak memory of a trial after which its worker is replaced, so that memory stays bounded."""

_LAST_BYTES: Final = 4096
"""Bytes of a dead worker's messages that are read."""

_PROGRAM: Final = "import sys; from bt_dualarm.sweeps.worker import serve; serve(sys.argv[1])"
_ROOT: Final = str(Path(__file__).parents[2])
ONE_THREAD: Final = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"
)
"""Environment of workers: one BLAS thread each, as there is one worker per core."""


@dataclass(frozen=True)
class Task:
    """A trial to run, and where not to.

    Attributes:
        job: The trial.
        audit_of: Row of the same trial from another worker that this run has to confirm, or None.
        avoid: Worker that has run the trial before; empty for none.
    """

    job: Job
    audit_of: Row | None = None
    avoid: str = ""


@dataclass(frozen=True)
class Done:
    """A finished task.

    Attributes:
        task: The task.
        row: Row of the trial.
        worker: Name of the worker that has run it.
    """

    task: Task
    row: Row
    worker: str


class Engine(Protocol):
    """Runs tasks in any order."""

    @property
    def slots(self) -> int:
        """Number of tasks that can run at the same time now; 0 while there is no worker."""

    def submit(self, task: Task) -> None:
        """Queue a task; returns at once."""

    def completed(self, timeout: float) -> Sequence[Done]:
        """Tasks that have finished since the last call; waits for the first for some seconds.

        Raises:
            DualArmError: The engine cannot continue; the message states why.
        """

    def close(self) -> None:
        """End all workers at once; unfinished tasks are lost."""


class Worker:
    """A process that runs one trial after the other; a new one after its death.

    Args:
        name: Name of the worker in rows and messages.
        timeout: Wall-clock seconds after which a trial counts as hung and its process is killed;
            None for no limit.
    """

    def __init__(self, name: str, timeout: float | None = None) -> None:
        self.name = name
        self.task: Task | None = None
        self.timeout = timeout
        self._attempts = 0
        self._deadline = float("inf")
        self._process: subprocess.Popen[bytes] | None = None
        self._errors: int | None = None
        self._requests: Connection | None = None
        self._answers: Connection | None = None
        self._scratch: TemporaryDirectory[str] | None = None

    @property
    def answers(self) -> Connection | None:
        """Pipe on which the answer arrives; None while there is no process."""
        return self._answers

    @property
    def pid(self) -> int | None:
        """Process id, None while there is no process."""
        return None if self._process is None else self._process.pid

    @property
    def is_late(self) -> bool:
        """Whether the current trial has run for longer than the timeout."""
        return self.task is not None and time.monotonic() > self._deadline

    def begin(self, task: Task) -> None:
        """Start a task."""
        self.task = task
        self._attempts = 0
        self._try()

    def take(self) -> Row | None:
        """The row of the current task if it is there, else None; waits for nothing.

        Restarts the process if it has died, and gives up after `ATTEMPTS` deaths.
        """
        task = self.task
        if task is None or self._answers is None:
            return None
        reason = ""
        try:
            if self._answers.poll():
                row: Row = self._answers.recv()
                self.task = None
                memory = row.get("memory_mb")
                if isinstance(memory, float) and memory > MOST_MEMORY_MB:
                    self.end()
                return {**row, "attempts": self._attempts}
            if self.is_late:
                reason = f"gave no result within {self.timeout:g} s"
        except (EOFError, OSError):
            reason = self._how_it_ended()
        if not reason:
            return None
        self.end()
        if self._attempts >= ATTEMPTS:
            self.task = None
            sentence = f"each of {ATTEMPTS} worker processes died; the last one {reason}"
            return task.job.lost_row(sentence, self._attempts)
        self._try()
        return None

    def end(self) -> None:
        """Kill the process, if there is one."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
        for pipe in (self._requests, self._answers):
            if pipe is not None:
                pipe.close()
        if self._errors is not None:
            os.close(self._errors)
        if self._scratch is not None:
            self._scratch.cleanup()
        self._process = self._requests = self._answers = self._errors = self._scratch = None

    def _try(self) -> None:
        self._attempts += 1
        try:
            if self._process is None or self._process.poll() is not None:
                self.end()
                self._start()
            if self._requests is None or self._errors is None or self.task is None:
                raise AssertionError("a started process has a pipe, and there is a task")
            os.ftruncate(self._errors, 0)
            self._requests.send(self.task.job)
        except OSError as error:
            if self._process is None:
                raise SweepError(f"no worker process can be started: {error}") from error
            # The process has just died: `take` sees the end of its pipe.
        self._deadline = time.monotonic() + (self.timeout or float("inf"))

    def _start(self) -> None:
        # Temporary files of the process, which cannot delete them itself once it is killed.
        self._scratch = TemporaryDirectory(prefix="bt_sweep_", ignore_cleanup_errors=True)
        child_in, writing = os.pipe()
        reading, child_out = os.pipe()
        paths = [_ROOT, os.environ.get("PYTHONPATH", "")]
        # In memory, appended to by the process: the last lines say why it died.
        self._errors = os.memfd_create("errors")
        fcntl(self._errors, F_SETFL, os.O_APPEND)
        environment = os.environ | ONE_THREAD | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
        try:
            # A process group of its own: Ctrl-C in a terminal is for the sweep alone.
            self._process = subprocess.Popen(  # noqa: S603 - this interpreter, a fixed program
                [sys.executable, "-P", "-c", _PROGRAM, self._scratch.name],
                stdin=child_in,
                stdout=child_out,
                stderr=self._errors,
                env=environment,
                process_group=0,
            )
        except OSError:
            os.close(writing)
            os.close(reading)
            raise
        finally:
            os.close(child_in)
            os.close(child_out)
        self._requests = Connection(writing, readable=False)
        self._answers = Connection(reading, writable=False)

    def _how_it_ended(self) -> str:
        if self._process is None:
            return "ended"
        try:
            code = self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            return "closed its pipe"
        how = f"was killed by signal {-code}" if code < 0 else f"ended with exit code {code}"
        return f"{how}{self._last_words()}"

    def _last_words(self) -> str:
        """The error that the process printed last, for people; empty if it printed none."""
        if self._errors is None:
            return ""
        size = os.fstat(self._errors).st_size
        text = os.pread(self._errors, _LAST_BYTES, max(0, size - _LAST_BYTES))
        lines = [line.strip() for line in text.decode(errors="replace").splitlines()]
        fatal = [line for line in lines if line.startswith("Fatal Python error")]
        words = next(reversed(fatal or list(filter(None, lines))), "")
        return f": {words}" if words else ""


class ProcessEngine:
    """Worker processes of this machine.

    Args:
        jobs: Number of workers.
        timeout: Wall-clock seconds after which a trial counts as hung; None for no limit.
    """

    def __init__(self, jobs: int, timeout: float | None = None) -> None:
        self._workers = [Worker(f"worker {number + 1}", timeout) for number in range(jobs)]
        self._queue: deque[Task] = deque()

    @property
    def slots(self) -> int:
        """Number of workers."""
        return len(self._workers)

    @property
    def pids(self) -> tuple[int, ...]:
        """Process ids of the workers that have a process."""
        return tuple(worker.pid for worker in self._workers if worker.pid is not None)

    def submit(self, task: Task) -> None:
        """Queue a task."""
        self._queue.append(task)
        self._deal()

    def completed(self, timeout: float) -> Sequence[Done]:
        """Finished tasks, as `Engine.completed`."""
        # Asking each of many workers, or `multiprocessing.connection.wait`, would take longer than
        # everything else.
        poll = select.poll()
        busy = [worker for worker in self._workers if worker.task is not None]
        pipes = {w.answers.fileno(): w for w in busy if w.answers is not None}
        for pipe in pipes:
            poll.register(pipe, select.POLLIN)
        ready = {pipes[pipe] for pipe, _ in poll.poll(1000 * timeout)} if pipes else set()
        done = []
        for worker in busy:
            task = worker.task
            row = worker.take() if worker in ready or worker.is_late else None
            if row is not None and task is not None:
                done.append(Done(task, row, worker.name))
        self._deal()
        return done

    def close(self) -> None:
        """Kill all workers."""
        self._queue.clear()
        for worker in self._workers:
            worker.end()

    def _deal(self) -> None:
        for worker in self._workers:
            if worker.task is not None or not self._queue:
                continue
            task = next((one for one in self._queue if one.avoid != worker.name), None)
            if task is None:
                if len(self._workers) > 1:
                    continue
                # The only worker: a new process is another one as far as its state goes.
                worker.end()
                task = self._queue[0]
            self._queue.remove(task)
            worker.begin(task)


@dataclass
class _Slot:
    """A worker of a Dask worker process, and the inputs of the job that it ran last."""

    worker: Worker
    inputs: Mapping[str, str] = field(default_factory=dict)


@dataclass
class _Slots:
    """Workers of one Dask worker process, by thread."""

    by_thread: dict[int, _Slot] = field(default_factory=dict)


_slots = _Slots()


def dask_setup(worker: object) -> None:  # noqa: ARG001 - the name and argument are Dask's
    """Leave Ctrl-C in a terminal to the sweep; Dask calls this in each worker of ``local:N``."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def run_in_child(job: Job, timeout: float | None) -> tuple[Row, str]:
    """Run a trial in a child process of a Dask worker; returns its row and the worker's address.

    A Dask worker counts its own death against every task that was assigned to it, and its process
    may be daemonic; a trial therefore never runs in it.
    """
    import threading

    distributed: Any = import_module("distributed")  # Any: Dask has few types
    key = threading.get_ident()
    slot = _slots.by_thread.setdefault(key, _Slot(Worker(f"thread {key}", timeout)))
    if slot.inputs != job.inputs:
        # A cluster outlives sweeps, and a process keeps the code and tree that it has loaded.
        slot.worker.end()
    slot.inputs = job.inputs
    worker = slot.worker
    worker.timeout = timeout
    worker.begin(Task(job))
    while (row := worker.take()) is None:
        if worker.answers is not None:
            worker.answers.poll(0.5)
    return row, str(distributed.get_worker().address)


_ADDRESS: Final = re.compile(
    r"local:(?P<count>[1-9]\d{0,2}|10[01]\d|102[0-4])"
    r"|(?:tcp|tls)://(?P<host>\[[0-9a-fA-F:]+\]|[^\s:/]+):(?P<port>\d{1,5})"
)

_CONNECT_S: Final = 15.0
"""Wall-clock seconds that a scheduler has to accept a connection: it may still be starting."""

_MOST_LOSSES: Final = 10
"""Times that Dask may give up a trial because workers died, by default four deaths each."""

_COUNT_S: Final = 1.0
"""Wall-clock seconds between two counts of the workers of a cluster."""


def _await_scheduler(host: str, port: int) -> None:
    """Wait until something accepts connections at an address.

    Raises:
        OSError: Nothing does.
    """
    until = time.monotonic() + _CONNECT_S
    while True:
        try:
            socket.create_connection((host, port), timeout=_CONNECT_S).close()
        except socket.gaierror:
            raise
        except OSError:
            if time.monotonic() > until:
                raise
            time.sleep(0.5)
        else:
            return


class DaskEngine:
    """Workers of a Dask cluster, which must be able to import this package and read the tree.

    Args:
        address: ``tcp://HOST:PORT`` of a scheduler, or ``local:N`` for N workers of this machine.
        timeout: Wall-clock seconds after which a trial counts as hung; None for no limit.

    Raises:
        SweepError: Dask is not installed, or the scheduler does not answer.
    """

    def __init__(self, address: str, timeout: float | None = None) -> None:
        match = _ADDRESS.fullmatch(str(address))
        if match is None:
            raise SweepError(
                f"{address!r} is no Dask cluster: tcp://HOST:PORT of a scheduler, or local:N for N "
                "workers of this machine, at most 1024"
            )
        try:
            dask: Any = import_module("dask")  # Any: Dask has few types
            distributed: Any = import_module("distributed")
        except ImportError as error:
            raise SweepError("--dask needs Dask: pip install 'bt_dualarm[cluster]'") from error
        # A preempted machine is not a fault of the trials that were assigned to it.
        dask.config.set({"distributed.scheduler.allowed-failures": 1000})
        self._timeout = timeout
        self._cluster = None
        self._slots = 0
        self._counted_at = -math.inf
        try:
            if match["count"]:
                self._cluster = distributed.LocalCluster(
                    n_workers=int(match["count"]),
                    threads_per_worker=1,
                    processes=True,
                    # Any port: another cluster on this machine may have the usual one.
                    dashboard_address="127.0.0.1:0",
                    silence_logs=50,
                    preload=[__name__],
                )
                self._client = distributed.Client(self._cluster, set_as_default=False)
            else:
                # Dask's client, without an answer, waits half a minute more before it gives up.
                _await_scheduler(match["host"].strip("[]"), int(match["port"]))
                self._client = distributed.Client(address, timeout="15s", set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise SweepError(f"no Dask scheduler answers at {address}: {error}") from error
        self._running: dict[Any, Task] = {}  # Any: futures, which have no types
        self._finished: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._killed: type[Exception] = distributed.KilledWorker
        self._losses: Counter[str] = Counter()

    @property
    def slots(self) -> int:
        """Number of threads of all workers of the cluster, counted once a second."""
        if time.monotonic() - self._counted_at >= _COUNT_S:
            self._slots = int(self._client.scheduler_info(n_workers=1)["total_threads"])
            self._counted_at = time.monotonic()
        return self._slots

    def submit(self, task: Task) -> None:
        """Send a task to the scheduler."""
        others = None
        if task.avoid:
            info = self._client.scheduler_info(n_workers=-1)
            others = [address for address in info["workers"] if address != task.avoid] or None
        future = self._client.submit(
            run_in_child,
            task.job,
            self._timeout,
            pure=False,
            retries=0,
            workers=others,
            allow_other_workers=others is not None,
        )
        self._running[future] = task
        future.add_done_callback(self._finished.put)

    def completed(self, timeout: float) -> Sequence[Done]:
        """Finished tasks, as `Engine.completed`.

        Raises:
            SweepError: The connection to the scheduler is lost.
        """
        finished = []
        with suppress(queue.Empty):
            finished.append(self._finished.get(timeout=timeout))
            while True:
                finished.append(self._finished.get_nowait())
        if not finished and self._client.status != "running":
            raise SweepError(
                "the connection to the Dask scheduler is lost; finished trials are kept, and the "
                "same command goes on"
            )
        done = []
        for future in finished:
            task = self._running.pop(future)
            if future.status in ("cancelled", "lost"):
                self.submit(task)
                continue
            error = future.exception()
            identity = task.job.identity
            if isinstance(error, self._killed) and self._losses[identity] < _MOST_LOSSES:
                # The trial ran in a child, so it did not kill the worker: machines are preempted,
                # or run out of memory. A scheduler that runs elsewhere has its own limit of deaths.
                self._losses[identity] += 1
                self.submit(task)
                continue
            self._losses.pop(identity, None)
            if error is not None:
                row = task.job.lost_row(f"the Dask worker failed: {error}", ATTEMPTS)
                done.append(Done(task, row, "dask"))
                continue
            row, worker = future.result()
            done.append(Done(task, row, worker))
        return done

    def close(self) -> None:
        """Cancel what is left and disconnect."""
        self._client.cancel(list(self._running))
        self._running.clear()
        self._client.close()
        if self._cluster is not None:
            self._cluster.close()
