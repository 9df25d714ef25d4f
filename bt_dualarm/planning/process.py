"""Planning in a separate process, so that a search does not hold up the world.

Requests go in through one pipe, motions come back through another; `serve` is the program at the
other end. It ends when its parent closes the pipe or dies, even in the middle of a search. Threads
would not do: OMPL keeps Python's lock while it searches.
"""

from __future__ import annotations

import itertools
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bt_dualarm.core.errors import Failure, Number
from bt_dualarm.planning.path_constraints import ConstrainedProblem
from bt_dualarm.planning.problem import PlanningProblem, motion_around
from bt_dualarm.trajectory.trajectory import Trajectory

if TYPE_CHECKING:
    from multiprocessing.connection import Connection


LONGEST_S: Final = 120.0
"""Longest wait for an answer, s of wall-clock time; a search without success takes a few."""

_POLL_S = 0.5
"""Wall-clock time between two checks whether the process is still running, s."""

_DYING_S = 5.0
"""Wall-clock time for a process to end once it has closed its pipe, s."""

_PROGRAM = "from bt_dualarm.planning.process import serve; serve()"

_ROOT = str(Path(__file__).parents[2])
"""Directory of the package that the process is to import: this one."""


@dataclass(frozen=True)
class PlanningRequest:
    """Request to solve a problem, or to drop the one with its number.

    Attributes:
        number: Number of the problem.
        problem: Pickled `PlanningProblem` or `ConstrainedProblem`; None to drop the problem.
    """

    number: int
    problem: bytes | None = None


@dataclass(frozen=True)
class PlanningRefusal:
    """Failure as it is sent between processes.

    Attributes:
        code: Code of the failure.
        reason: Reason for people.
        numbers: Numbers of the failure by name.
    """

    code: str
    reason: str
    numbers: dict[str, Number]


@dataclass(frozen=True)
class PlanningAnswer:
    """Answer to a request.

    Attributes:
        number: Number of the problem.
        outcome: Motion that was found, or why none was.
    """

    number: int
    outcome: Trajectory | PlanningRefusal


class PlanningProcess:
    """One process for all arms of a run, started by the first problem that needs a search.

    If it dies, its pending problems fail, and the next problem gets a new process. A process that
    has solved all its problems when its run ends is left to the next run of this Python process:
    starting one takes one to two seconds of CPU. At most one idle process is kept; it ends with
    this Python process. An outcome depends on its problem only, not on those before it.
    """

    def __init__(self) -> None:
        self._line: _Line | None = None

    @property
    def pid(self) -> int | None:
        """Process id; None if there is no process."""
        return None if self._line is None else self._line.process.pid

    def solve(self, problem: PlanningProblem | ConstrainedProblem) -> PendingMotion:
        """Begin to plan a motion around obstacles, or with a constraint; returns at once.

        Args:
            problem: Admitted problem whose straight path is not free, or breaks a constraint.

        Raises:
            Failure: ``NO_PLAN`` if no process can be started.
        """
        if self._line is not None and self._line.process.poll() is not None:
            self.close()  # it has died since the last problem
        if self._line is None:
            try:
                self._line = _idle_line() or _Line()
            except OSError as error:
                reason = f"no planning process can be started: {error}"
                raise Failure("NO_PLAN", reason, planner=problem.planner) from error
        number = self._line.ask(pickle.dumps(problem, pickle.HIGHEST_PROTOCOL))
        return PendingMotion(self._line, number, problem)

    def close(self) -> None:
        """End the process if it has pending problems, which fail; otherwise leave it idle."""
        line, self._line = self._line, None
        if line is None:
            return
        if line.is_idle and not _idle:
            _idle.append(line)
        else:
            line.end()


class PendingMotion:
    """Motion that is being planned."""

    def __init__(
        self, line: _Line, number: int, problem: PlanningProblem | ConstrainedProblem
    ) -> None:
        self._line = line
        self._number = number
        self._problem = problem

    def result(self) -> Trajectory:
        """Wait for the motion, for at most `LONGEST_S` of wall-clock time.

        Raises:
            Failure: ``NO_PLAN``, also if the process died, was stopped, or gave no answer.
        """
        try:
            outcome = self._line.outcome(self._number)
        except EOFError:
            raise self._died() from None
        except TimeoutError as error:
            # It may be lost in this problem for good: end it, so that the next gets a new one.
            self._line.end()
            raise self._given_up(str(error)) from None
        if isinstance(outcome, PlanningRefusal):
            raise Failure(outcome.code, outcome.reason, **outcome.numbers)
        return outcome

    def abandon(self) -> None:
        """Drop the problem: its motion is no longer needed. Harmless once it has been found."""
        self._line.drop(self._number)

    def _died(self) -> Failure:
        code = self._line.exit_code()
        how = f"was killed by signal {-code}" if code < 0 else f"ended with exit code {code}"
        return self._given_up(how).noting(exit_code=code)

    def _given_up(self, how: str) -> Failure:
        planner = self._problem.planner
        return Failure(
            "NO_PLAN",
            f"the planning process {how} while it solved this problem with {planner}",
            planner=planner,
        )


class _Line:
    """A process and the two pipes to it.

    A thread writes the problems: a process that is still starting does not read yet, and the run
    must not wait for it. The thread refers to the pipe only, not to this object, which can
    therefore be collected.
    """

    def __init__(self) -> None:
        from multiprocessing.connection import Connection

        self.process, writing, reading = spawn()
        self._answers = Connection(reading, writable=False)
        self._outbox: queue.SimpleQueue[PlanningRequest | None] = queue.SimpleQueue()
        self._numbers = itertools.count()
        self._open: set[int] = set()
        self._dropped: set[int] = set()
        self._found: dict[int, Trajectory | PlanningRefusal] = {}
        requests = Connection(writing, readable=False)
        threading.Thread(target=_write, args=(self._outbox, requests), daemon=True).start()
        self.end = weakref.finalize(self, _end, self.process, self._outbox, self._answers)

    @property
    def is_idle(self) -> bool:
        """Whether the process is running and every problem has been answered."""
        return not self._open and self.process.poll() is None

    def ask(self, problem: bytes) -> int:
        """Queue a pickled problem; returns its number at once."""
        number = next(self._numbers)
        self._open.add(number)
        self._outbox.put(PlanningRequest(number, problem))
        return number

    def drop(self, number: int) -> None:
        """Discard the answer to a problem, whether it has come or not."""
        if self._found.pop(number, None) is None:
            self._dropped.add(number)
            self._outbox.put(PlanningRequest(number))

    def outcome(self, number: int) -> Trajectory | PlanningRefusal:
        """Wait for the answer to a problem.

        Raises:
            EOFError: The process has ended.
            TimeoutError: It has been stopped, or gave no answer in time; the message states which.
        """
        latest = time.monotonic() + LONGEST_S
        while number not in self._found:
            if self._is_answering(latest):
                self._take()
        return self._found.pop(number)

    def _is_answering(self, latest: float) -> bool:
        """Whether an answer or the end of the pipe can be read; waits for some time.

        Raises:
            EOFError: The pipe is closed.
            TimeoutError: No answer is to be expected.
        """
        # Stopped before and after the wait: a process that is stopped only for a moment continues.
        was_stopped = stopping_signal(self.process.pid)
        try:
            if self._answers.poll(_POLL_S):
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
        self._open.discard(answer.number)
        if answer.number in self._dropped:
            self._dropped.remove(answer.number)
        else:
            self._found[answer.number] = answer.outcome

    def exit_code(self) -> int:
        """Exit code of a process that has closed its pipe; negative for a signal."""
        try:
            return self.process.wait(_DYING_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()


_idle: Final[list[_Line]] = []
"""The idle process that a run has left, if any."""


def _idle_line() -> _Line | None:
    """Take over the idle process, if there is one that still runs."""
    while _idle:
        line = _idle.pop()
        if line.is_idle and not stopping_signal(line.process.pid):
            return line
        line.end()
    return None


def _forget_idle() -> None:
    """In a forked child: the idle process is its parent's alone."""
    for line in _idle:
        line.end.detach()
    _idle.clear()


os.register_at_fork(after_in_child=_forget_idle)


def spawn() -> tuple[subprocess.Popen[bytes], int, int]:
    """Start the process; returns it and the descriptors to write to it and to read from it.

    It has a process group of its own: Ctrl-C in a terminal is for the run alone.
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
    """Signal by which a child process is stopped now; 0 if it is running or has ended."""
    # WNOWAIT leaves the child waitable: subprocess must still see its exit code.
    try:
        state = os.waitid(os.P_PID, pid, os.WSTOPPED | os.WNOHANG | os.WNOWAIT)
    except ChildProcessError:
        return 0
    return 0 if state is None else state.si_status


def _write(outbox: queue.SimpleQueue[PlanningRequest | None], requests: Connection) -> None:
    """Write queued requests, until None is queued or the pipe is closed."""
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
    """End the thread and the process."""
    outbox.put(None)
    process.kill()
    process.wait()
    answers.close()


def serve() -> None:
    """Solve one problem after the other, until the pipe is closed."""
    from multiprocessing.connection import Connection

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # for the parent, which then closes the pipe
    inbox = Inbox(Connection(os.dup(0), writable=False))
    answers = Connection(os.dup(1), readable=False)
    os.dup2(2, 1)  # keeps prints of libraries out of the answers
    for request in inbox:
        try:
            answers.send(PlanningAnswer(request.number, _outcome(request, inbox)))
        except BrokenPipeError:
            return


def _outcome(request: PlanningRequest, inbox: Inbox) -> Trajectory | PlanningRefusal:
    problem: PlanningProblem | ConstrainedProblem = pickle.loads(  # noqa: S301 - the run's own
        request.problem or b""
    )
    try:
        if isinstance(problem, ConstrainedProblem):
            return problem.motion(inbox.is_abandoned)
        return motion_around(problem, inbox.is_abandoned)
    except Failure as failure:
        return PlanningRefusal(failure.code, failure.reason, dict(failure.numbers))
    except Exception as error:  # noqa: BLE001 - reported to the parent
        reason = f"the planner raised {type(error).__name__}: {error}"
        return PlanningRefusal("NO_PLAN", reason, {"planner": problem.planner})


class Inbox:
    """Problems that have arrived and are still needed.

    Args:
        connection: Pipe from which they are read.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._waiting: deque[PlanningRequest] = deque()
        self._current: int | None = None
        self._closed = False

    def __iter__(self) -> Iterator[PlanningRequest]:
        """Problems in order of arrival, until the pipe is closed."""
        while True:
            while not self._waiting and not self._closed:
                self._take()
            if self._closed:
                return
            request = self._waiting.popleft()
            self._current = request.number
            yield request

    def is_abandoned(self) -> bool:
        """Whether the current problem is no longer needed; polled during a search."""
        while not self._closed and self._connection.poll():
            self._take()
        return self._closed or self._current is None

    def _take(self) -> None:
        try:
            request: PlanningRequest = self._connection.recv()
        except EOFError:
            self._closed = True
            return
        if request.problem is not None:
            self._waiting.append(request)
            return
        self._waiting = deque(kept for kept in self._waiting if kept.number != request.number)
        if self._current == request.number:
            self._current = None
