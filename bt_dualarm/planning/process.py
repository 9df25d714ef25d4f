"""The planning process: requests go in by a pipe, motions come back by another."""

from __future__ import annotations

import itertools
import os
import pickle
import queue
import subprocess
import sys
import threading
import time
import weakref
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bt_dualarm.core.errors import Failure, Number
from bt_dualarm.planning.problem import PlanningProblem
from bt_dualarm.trajectory.trajectory import Trajectory

if TYPE_CHECKING:
    from multiprocessing.connection import Connection


# What goes between a run and the process that plans for it.


@dataclass(frozen=True)
class PlanningRequest:
    """A problem, pickled, under a number; without it the problem of that number is dropped."""

    number: int
    problem: bytes | None = None


@dataclass(frozen=True)
class PlanningRefusal:
    """A failure on its way to the other process."""

    code: str
    reason: str
    numbers: dict[str, Number]


@dataclass(frozen=True)
class PlanningAnswer:
    """What came of the problem of that number."""

    number: int
    outcome: Trajectory | PlanningRefusal


# The process that plans as its parent sees it: how it is started, and whether it is stopped.


_PROGRAM = "from bt_dualarm.planning.worker import serve; serve()"

_ROOT = str(Path(__file__).parents[2])
"""Where the package lies that the process shall import: this one."""


def spawn() -> tuple[subprocess.Popen[bytes], int, int]:
    """A process, the descriptor to write to it, and the one to read from it.

    In a process group of its own: Ctrl-C in a terminal is for the run alone.
    """
    child_in, writing = os.pipe()
    reading, child_out = os.pipe()
    paths = [_ROOT, os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
    try:
        process = subprocess.Popen(  # noqa: S603 - this interpreter, a fixed program
            [sys.executable, "-P", "-c", _PROGRAM],
            stdin=child_in,
            stdout=child_out,
            stderr=subprocess.DEVNULL,
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
    return process, writing, reading


def stopping_signal(pid: int) -> int:
    """The signal by which a child is stopped now, 0 where it goes on or has ended."""
    try:
        state = os.waitid(os.P_PID, pid, os.WSTOPPED | os.WNOHANG | os.WNOWAIT)
    except ChildProcessError:
        return 0
    return 0 if state is None else state.si_status


# Plans in a process of its own, so that a search does not hold up the world.


LONGEST_S: Final = 120.0
"""Seconds on the wall that are waited for an answer; a search that finds nothing takes a few."""

_LOOK_S = 0.5
"""Seconds on the wall from one look at the process that is waited for to the next."""

_DYING_S = 5.0
"""Seconds on the wall that a process gets to end once it has closed its pipe."""


class PlanningProcess:
    """One process for all arms of a run, started by the first problem that needs a search.

    When it dies, the problems that it had fail, and the next problem gets a new process.
    """

    def __init__(self) -> None:
        self._numbers = itertools.count()
        self._line: _Line | None = None

    @property
    def pid(self) -> int | None:
        """Of the process, if there is one."""
        return None if self._line is None else self._line.process.pid

    def solve(self, problem: PlanningProblem) -> PendingMotion:
        """Begin to look for the motion around what is in the way; returns at once.

        Args:
            problem: Admitted; its straight way is not free.

        Raises:
            Failure: ``NO_PLAN`` where no process can be started.
        """
        if self._line is not None and self._line.process.poll() is not None:
            self.close()
        if self._line is None:
            self._line = _started(problem)
        number = next(self._numbers)
        self._line.send(PlanningRequest(number, pickle.dumps(problem, pickle.HIGHEST_PROTOCOL)))
        return PendingMotion(self._line, number, problem)

    def close(self) -> None:
        """End the process; what it was looking for is not found."""
        if self._line is not None:
            self._line.end()
            self._line = None


class PendingMotion:
    """A motion that is being looked for."""

    def __init__(self, line: _Line, number: int, problem: PlanningProblem) -> None:
        self._line = line
        self._number = number
        self._problem = problem

    def result(self) -> Trajectory:
        """The motion; waits for it, for at most `LONGEST_S` on the wall.

        Raises:
            Failure: ``NO_PLAN``, also when the process died of it, was stopped, or is lost in it.
        """
        try:
            outcome = self._line.outcome(self._number)
        except EOFError:
            raise self._died() from None
        except TimeoutError as error:
            self._line.end()
            raise self._given_up(str(error)) from None
        if isinstance(outcome, PlanningRefusal):
            raise Failure(outcome.code, outcome.reason, **outcome.numbers)
        return outcome

    def abandon(self) -> None:
        """Nobody waits for it any more; harmless when it was found long ago."""
        self._line.drop(self._number)

    def _died(self) -> Failure:
        code = self._line.exit_code()
        how = f"was killed by signal {-code}" if code < 0 else f"ended with exit code {code}"
        return self._given_up(how).noting(exit_code=code)

    def _given_up(self, how: str) -> Failure:
        planner = self._problem.planner
        return Failure(
            "NO_PLAN",
            f"the planning process {how} while it had this problem for {planner}",
            planner=planner,
        )


class _Line:
    """A process and the two pipes to it.

    Problems are written by a thread: a process that still starts does not read yet, and the run
    shall not wait for it. The thread knows the pipe only, so that all of this can be forgotten.
    """

    def __init__(self) -> None:
        from multiprocessing.connection import Connection

        self.process, writing, reading = spawn()
        self._answers = Connection(reading, writable=False)
        self._outbox: queue.SimpleQueue[PlanningRequest | None] = queue.SimpleQueue()
        self._dropped: set[int] = set()
        self._found: dict[int, Trajectory | PlanningRefusal] = {}
        requests = Connection(writing, readable=False)
        threading.Thread(target=_write, args=(self._outbox, requests), daemon=True).start()
        self.end = weakref.finalize(self, _end, self.process, self._outbox, self._answers)

    def send(self, request: PlanningRequest) -> None:
        """Have it written; returns at once."""
        self._outbox.put(request)

    def drop(self, number: int) -> None:
        """Say that nobody waits for the answer of that number."""
        if self._found.pop(number, None) is None:
            self._dropped.add(number)
            self.send(PlanningRequest(number))

    def outcome(self, number: int) -> Trajectory | PlanningRefusal:
        """Wait for the answer of that number.

        Raises:
            EOFError: The process has ended.
            TimeoutError: It has been stopped, or finds no end; the message says which.
        """
        latest = time.monotonic() + LONGEST_S
        while number not in self._found:
            if self._is_answering(latest):
                self._take()
        return self._found.pop(number)

    def _is_answering(self, latest: float) -> bool:
        """Whether there is something to read, or the end; waits for some time.

        Raises:
            TimeoutError: Nothing more is to be expected.
        """
        was_stopped = stopping_signal(self.process.pid)
        try:
            if self._answers.poll(_LOOK_S):
                return True
        except OSError:
            raise EOFError from None
        if was_stopped and stopping_signal(self.process.pid):
            raise TimeoutError(f"was stopped by signal {was_stopped}")
        if time.monotonic() > latest:
            raise TimeoutError(f"gave no answer for {LONGEST_S:g} s")
        return False

    def _take(self) -> None:
        try:
            answer: PlanningAnswer = self._answers.recv()
        except OSError:
            raise EOFError from None
        if answer.number in self._dropped:
            self._dropped.remove(answer.number)
        else:
            self._found[answer.number] = answer.outcome

    def exit_code(self) -> int:
        """Of a process that has closed its pipe."""
        try:
            return self.process.wait(_DYING_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()


def _started(problem: PlanningProblem) -> _Line:
    try:
        return _Line()
    except OSError as error:
        raise Failure(
            "NO_PLAN", f"no planning process can be started: {error}", planner=problem.planner
        ) from error


def _write(outbox: queue.SimpleQueue[PlanningRequest | None], requests: Connection) -> None:
    """Write what is to be sent, until there is no more or nobody reads it."""
    with requests:
        while (request := outbox.get()) is not None:
            try:
                requests.send(request)
            except OSError:
                return


def _end(
    process: subprocess.Popen[bytes],
    outbox: queue.SimpleQueue[PlanningRequest | None],
    answers: Connection,
) -> None:
    outbox.put(None)
    process.kill()
    process.wait()
    answers.close()
