"""Plans in a process of its own, so that a search does not hold up the world."""

from __future__ import annotations

import itertools
import os
import pickle
import queue
import subprocess
import sys
import threading
import weakref
from pathlib import Path
from typing import TYPE_CHECKING

from bt_dualarm.errors import Failure
from bt_dualarm.motion.planning.messages import Answer, Refusal, Request
from bt_dualarm.motion.planning.problem import PlanningProblem
from bt_dualarm.motion.timing.trajectory import Trajectory

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

_PROGRAM = "from bt_dualarm.motion.planning.worker import serve; serve()"

_ROOT = str(Path(__file__).parents[3])
"""Where the package lies that the process shall import: this one."""

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
        self._line.send(Request(number, pickle.dumps(problem, pickle.HIGHEST_PROTOCOL)))
        return PendingMotion(self._line, number, problem)

    def close(self) -> None:
        """End the process; what it was looking for is not found."""
        if self._line is not None:
            self._line.end()
            self._line = None


class PendingMotion:
    """A motion that is being looked for."""

    def __init__(self, line: _Line, number: int, problem: PlanningProblem) -> None:
        self._line, self._number, self._problem = line, number, problem

    def result(self) -> Trajectory:
        """The motion; waits for it, however long that takes on the wall.

        Raises:
            Failure: ``NO_PLAN``, also when the process died of it.
        """
        try:
            outcome = self._line.outcome(self._number)
        except EOFError:
            raise self._died() from None
        if isinstance(outcome, Refusal):
            raise Failure(outcome.code, outcome.reason, **outcome.numbers)
        return outcome

    def abandon(self) -> None:
        """Nobody waits for it any more; harmless when it was found long ago."""
        self._line.drop(self._number)

    def _died(self) -> Failure:
        code = self._line.exit_code()
        how = f"was killed by signal {-code}" if code < 0 else f"ended with exit code {code}"
        planner = self._problem.planner
        return Failure(
            "NO_PLAN",
            f"the planning process {how} while it had this problem for {planner}",
            planner=planner,
            exit_code=code,
        )


class _Line:
    """A process and the two pipes to it.

    Problems are written by a thread: a process that still starts does not read yet, and the run
    shall not wait for it. The thread knows the pipe only, so that all of this can be forgotten.
    """

    def __init__(self) -> None:
        from multiprocessing.connection import Connection

        self.process, writing, reading = _spawn()
        self._answers = Connection(reading, writable=False)
        self._outbox: queue.SimpleQueue[Request | None] = queue.SimpleQueue()
        self._dropped: set[int] = set()
        self._found: dict[int, Trajectory | Refusal] = {}
        requests = Connection(writing, readable=False)
        threading.Thread(target=_write, args=(self._outbox, requests), daemon=True).start()
        self.end = weakref.finalize(self, _end, self.process, self._outbox, self._answers)

    def send(self, request: Request) -> None:
        """Have it written; returns at once."""
        self._outbox.put(request)

    def drop(self, number: int) -> None:
        """Say that nobody waits for the answer of that number."""
        if self._found.pop(number, None) is None:
            self._dropped.add(number)
            self.send(Request(number))

    def outcome(self, number: int) -> Trajectory | Refusal:
        """Wait for the answer of that number.

        Raises:
            EOFError: The process has ended.
        """
        while number not in self._found:
            try:
                answer: Answer = self._answers.recv()
            except OSError:
                raise EOFError from None
            if answer.number in self._dropped:
                self._dropped.remove(answer.number)
            else:
                self._found[answer.number] = answer.outcome
        return self._found.pop(number)

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


def _spawn() -> tuple[subprocess.Popen[bytes], int, int]:
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


def _write(outbox: queue.SimpleQueue[Request | None], requests: Connection) -> None:
    """Write what is to be sent, until there is no more or nobody reads it."""
    with requests:
        while (request := outbox.get()) is not None:
            try:
                requests.send(request)
            except OSError:
                return


def _end(
    process: subprocess.Popen[bytes],
    outbox: queue.SimpleQueue[Request | None],
    answers: Connection,
) -> None:
    outbox.put(None)
    process.kill()
    process.wait()
    answers.close()
