"""The leaf: a py_trees behaviour that runs a skill and lets none of its exceptions out."""

from __future__ import annotations

import logging
from collections.abc import Callable, Generator, Iterator, Mapping
from typing import Any

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_dualarm.errors import Failure, Number
from bt_dualarm.skill import Skill
from bt_dualarm.tree.report import LeafReport
from bt_dualarm.tree.watched import NAMES, Teller

_log = logging.getLogger(__name__)

# A skill that calls sys.exit must not end the run; a keyboard interrupt is not the skill's.
_ANY = (Exception, SystemExit)


class Leaf(Behaviour):
    """Runs a skill.

    ``tick`` and ``stop`` replace py_trees' own, which cost 4 to 7 times as much, mostly for log
    lines that nobody reads.

    Args:
        name: Shown to people.
        begin: Makes a new skill for a new run; may raise, as every call into a skill may.
        release: Stops the motion that this leaf has begun, if there is one.
        trouble: What has gone wrong between ticks with what this leaf has begun; raised in the
            skill where it waits, so that no skill has to ask.
        reports: Takes a record of each run.
    """

    def __init__(
        self,
        name: str,
        begin: Callable[[], Skill],
        release: Callable[[], None],
        reports: list[LeafReport],
        trouble: Callable[[], Exception | SystemExit | None] = lambda: None,
    ) -> None:
        self.path = name
        self.kind = name
        self.since = 0.0
        self.code = ""
        self.reason = ""
        self.skill: Skill | None = None
        self._steps: Iterator[float | None] | None = None
        self._progress: float | None = None
        self._begin = begin
        self._release = release
        self._trouble = trouble
        self._reports = reports
        self._report: LeafReport | None = None
        self._teller: Teller | None = None
        super().__init__(name)

    def place(self, teller: Teller, path: str, kind: str) -> None:
        """Take a place in an arm's tree."""
        self._teller = teller
        self.path = path
        self.kind = kind

    def tick(self) -> Iterator[Behaviour]:
        """Run the skill to its next ``yield``."""
        try:
            if self._steps is None:
                self._steps = self._start()
                progress = next(self._steps)
            elif (trouble := self._trouble()) is None:
                progress = next(self._steps)
            else:
                progress = _raise_in(self._steps, trouble)
            if progress is not None and self.skill is not None:
                self.skill.progress = progress
        except StopIteration:
            self._let_go()  # a motion that was left running has nobody to watch it any more
            self._end(Status.SUCCESS)
        except Failure as failure:
            self._fail(failure.code, failure.reason, failure.numbers)
        except _ANY as error:
            self._log_exception("in its run")
            self._fail("EXCEPTION", _one_line(error), {})
        else:
            if progress is not None:
                self._progress = progress
            if self.status is not Status.RUNNING:
                self._become(Status.RUNNING, {})
        yield self

    def update(self) -> Status:
        """Not used: `tick` does it all."""
        return self.status

    def stop(self, new_status: Status = Status.INVALID) -> None:
        """Halt the skill if it is running; harmless at any time."""
        if self._steps is not None:
            problem = self._close()
            self.code, self.reason = "HALTED", problem
            self._end(new_status)
        elif self.status is not new_status:
            self._become(new_status, {})

    @property
    def halted(self) -> bool:
        """Whether the last run was halted before its end."""
        return self.status is Status.INVALID and self.code == "HALTED"

    @property
    def progress(self) -> float | None:
        """Share done of a running skill that knows it: what it yielded last, or noted."""
        if self.skill is None:
            return None
        try:
            progress = self.skill.progress if self._progress is None else self._progress
            return None if progress is None else min(1.0, max(0.0, float(progress)))
        except _ANY:
            return None

    def _start(self) -> Iterator[float | None]:
        self.code = self.reason = ""
        self._progress = None
        time = self._teller.clock() if self._teller else 0.0
        self._report = LeafReport(self.path, self.kind, "RUNNING", time)
        self._reports.append(self._report)
        try:
            self.skill = self._begin()
            steps = self.skill.run()
        except StopIteration as error:  # outside of the generator it would pass for its end
            raise RuntimeError("StopIteration was raised before the first step") from error
        if not isinstance(steps, Iterator):
            raise TypeError(f"run() of {type(self.skill).__name__} has no yield")
        return steps

    def _close(self) -> str:
        """Let the skill clean up; returns what went wrong with that."""
        try:
            close: Any = getattr(self._steps, "close", None)
            if close is not None:
                close()
        except _ANY as error:
            self._log_exception("in its clean-up")
            return f"its clean-up raised {_one_line(error)}"
        finally:
            self._let_go()
        return ""

    def _let_go(self) -> None:
        try:
            self._release()
        except _ANY:
            self._log_exception("while its arm was released")

    def _fail(self, code: str, reason: str, numbers: Mapping[str, Number]) -> None:
        self.code, self.reason = code, reason
        self._let_go()
        self._end(Status.FAILURE, numbers)

    def _end(self, status: Status, numbers: Mapping[str, Number] | None = None) -> None:
        self._steps = None
        metrics = {**_metrics(self.skill), **_plain(numbers or {})}
        self.skill = None
        self._become(status, metrics)
        if self._report is not None:
            self._report.status = NAMES[status]
            self._report.ended_s = self.since
            self._report.code, self._report.reason = self.code, self.reason
            self._report.metrics = metrics

    def _become(self, new: Status, metrics: Mapping[str, Number]) -> None:
        old, self.status = self.status, new
        if new is Status.INVALID and old is not Status.RUNNING:
            self.code = self.reason = ""
        if self._teller is not None:
            self.since = self._teller.clock()
        if self._teller is not None and new is not old:
            self._teller.tell(self, old, new, metrics)

    def _log_exception(self, when: str) -> None:
        arm = self._teller.arm if self._teller else "?"
        _log.exception("%s: %s: the skill raised %s", arm, self.path, when)


def _raise_in(steps: Iterator[float | None], trouble: BaseException) -> float | None:
    """Raise in a generator where it waits; others than generators cannot answer it."""
    if isinstance(steps, Generator):
        progress: float | None = steps.throw(trouble)
        return progress
    raise trouble


def _metrics(skill: Skill | None) -> dict[str, Number]:
    """What a skill measured; what its author may have put there is not trusted."""
    try:
        return _plain(skill.metrics) if skill is not None else {}
    except _ANY:
        _log.exception("%s has no usable metrics", type(skill).__name__)
        return {}


def _plain(numbers: Mapping[str, Any]) -> dict[str, Number]:
    """Numbers as JSON knows them; numpy's have an ``item``."""
    return {
        str(name): value if isinstance(value, (bool, int, float, str)) else _scalar(value)
        for name, value in numbers.items()
    }


def _scalar(value: Any) -> Number:
    item = value.item() if hasattr(value, "item") and getattr(value, "size", 0) == 1 else value
    return item if isinstance(item, (bool, int, float, str)) else str(item)


def _one_line(error: BaseException) -> str:
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
