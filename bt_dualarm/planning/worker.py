"""Program of the planning process: solves the problems that come in through a pipe.

The process ends when its parent closes the pipe or dies, even in the middle of a search.
"""

from __future__ import annotations

import os
import pickle
import signal
from collections import deque
from collections.abc import Iterator
from multiprocessing.connection import Connection

from bt_dualarm.core.errors import Failure
from bt_dualarm.planning.problem import PlanningProblem, motion_around
from bt_dualarm.planning.process import PlanningAnswer, PlanningRefusal, PlanningRequest
from bt_dualarm.trajectory.trajectory import Trajectory


def serve() -> None:
    """Solve one problem after the other, until the pipe is closed."""
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
    problem: PlanningProblem = pickle.loads(request.problem or b"")  # noqa: S301 - the run's own
    try:
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
