"""What runs in the process that plans: problems come in by a pipe, motions go out by another.

Apart from the run, as OMPL keeps Python's lock while it searches. The process ends when the one
that has started it closes the pipe or dies, in the middle of a search too.
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


class Inbox:
    """Problems that have come and are still wanted.

    Args:
        connection: Pipe that they come from.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._waiting: deque[PlanningRequest] = deque()
        self._current: int | None = None
        self._closed = False

    def __iter__(self) -> Iterator[PlanningRequest]:
        """One after the other, as they come, for as long as somebody can send one."""
        while True:
            while not self._waiting and not self._closed:
                self._take()
            if self._closed:
                return
            request = self._waiting.popleft()
            self._current = request.number
            yield request

    def is_abandoned(self) -> bool:
        """Whether the one that came last is not wanted any more."""
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
        self._waiting = deque(one for one in self._waiting if one.number != request.number)
        if self._current == request.number:
            self._current = None


def serve() -> None:
    """Solve one problem after the other, until nobody can send one any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it asks the run to end, which ends this
    inbox = Inbox(Connection(os.dup(0), writable=False))
    answers = Connection(os.dup(1), readable=False)
    os.dup2(2, 1)  # nothing that a library prints gets between the answers
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
    except Exception as error:  # noqa: BLE001 - told to whoever waits for the plan
        reason = f"the planner raised {type(error).__name__}: {error}"
        return PlanningRefusal("NO_PLAN", reason, {"planner": problem.planner})
