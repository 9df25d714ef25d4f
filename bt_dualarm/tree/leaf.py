"""The leaf: a py_trees behaviour that runs a skill and lets none of its exceptions out."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Iterator, Mapping
from types import MappingProxyType
from typing import Protocol

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_dualarm.errors import RAISED_BY_SKILLS, Failure, Number, Overrun, SkillError
from bt_dualarm.skill.skill import Skill
from bt_dualarm.spec.wording import one_line
from bt_dualarm.tree.forgetful import Forgetful
from bt_dualarm.tree.leaf_reports import LeafReports
from bt_dualarm.tree.report import LeafReport
from bt_dualarm.tree.skill_run import SkillRun
from bt_dualarm.tree.watched import NAMES, Teller

_log = logging.getLogger(__name__)

_OF_OTHERS = (SystemExit, KeyboardInterrupt, GeneratorExit)
"""What Python raises to end programs and generators, and no skill has a use for."""


class HeldArm(Protocol):
    """The arm of a leaf, as far as the leaf itself deals with it."""

    def enter(self, *, anew: bool) -> None:
        """Note that this thread ticks or halts the leaf, and whether a new run of it begins."""

    def trouble(self) -> BaseException | None:
        """What has gone wrong between ticks with what the leaf has begun.

        It is raised in the skill where it waits, so that no skill has to ask.
        """

    def release(self) -> None:
        """Stop the motion that the leaf has begun, if there is one."""

    def touched(self, asked: Collection[str]) -> Mapping[str, Number]:
        """Metrics of what the arm touched while the leaf moved it, but for what it was asked to."""


class Leaf(Forgetful):
    """Runs a skill.

    ``tick`` and ``stop`` replace py_trees' own, which cost 4 to 7 times as much, mostly for log
    lines that nobody reads.

    Args:
        name: Name that people are shown.
        begin: Maker of a new skill for a new run; may raise, as every call into a skill may.
        arm: Arm in the hands of this leaf.
        reports: Taker of a report of each run.
    """

    def __init__(
        self,
        name: str,
        begin: Callable[[], Skill],
        arm: HeldArm,
        reports: LeafReports,
    ) -> None:
        self.path = name
        self.kind = name
        self.since = 0.0
        self.code = ""
        self.reason = ""
        self._run: SkillRun | None = None
        self._begin = begin
        self._held_arm = arm
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
            self._held_arm.enter(anew=self._run is None)
            if self._run is None:
                trouble, self._run = None, self._start()
            else:
                trouble = self._held_arm.trouble()
            goes_on = self._run.step(trouble)
        except Failure as failure:
            self._fail(failure.code, failure.reason, failure.numbers)
        except SkillError as error:
            self._log_problem(str(error))
            self._close()
            cause = error.__cause__
            numbers = cause.numbers if isinstance(cause, Failure) else {}
            self._fail("EXCEPTION", str(error), numbers)
        except Overrun as overrun:
            self._fail("OVERRUN", str(overrun), {})
        except RAISED_BY_SKILLS as error:
            self._log_exception("in its run")
            self._fail("EXCEPTION", _one_line(error), {})
        else:
            if not goes_on:
                self._let_go()  # a motion that was left running has nobody to watch it any more
                self._end(Status.SUCCESS)
            elif self.status is not Status.RUNNING:
                self._become(Status.RUNNING, {})
        yield self

    def update(self) -> Status:
        """Not used: `tick` does it all."""
        return self.status

    def stop(self, new_status: Status = Status.INVALID) -> None:
        """Halt the skill if it is running; harmless at any time."""
        if self._run is not None:
            self._held_arm.enter(anew=False)
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
        """Share done of a running skill that knows it."""
        return None if self._run is None else self._run.progress

    def _start(self) -> SkillRun:
        self.code = self.reason = ""
        time = self._teller.clock() if self._teller else 0.0
        self._report = LeafReport(self.path, self.kind, "RUNNING", time)
        self._reports.add(self._report)
        return SkillRun(self._begin)

    def _close(self) -> str:
        """Let the skill clean up; returns what went wrong with that."""
        try:
            if self._run is not None:
                self._run.close()
        except Overrun as overrun:
            return f"its clean-up was interrupted: {overrun}"
        except RAISED_BY_SKILLS as error:
            self._log_exception("in its clean-up")
            return f"its clean-up raised {_one_line(error)}"
        finally:
            self._let_go()
        return ""

    def _let_go(self) -> None:
        try:
            self._held_arm.release()
        except RAISED_BY_SKILLS:
            self._log_exception("while its arm was released")

    def _fail(self, code: str, reason: str, numbers: Mapping[str, Number]) -> None:
        self.code, self.reason = code, one_line(reason)
        self._let_go()
        self._end(Status.FAILURE, numbers)

    def _end(self, status: Status, numbers: Mapping[str, Number] = MappingProxyType({})) -> None:
        metrics = self._measured(numbers)
        self._run = None
        self._become(status, metrics)
        if self._report is not None:
            self._report.status = NAMES[status]
            self._report.ended_s = self.since
            self._report.code, self._report.reason = self.code, self.reason
            self._report.metrics = metrics

    def _measured(self, numbers: Mapping[str, Number]) -> Mapping[str, Number]:
        """Metrics of the skill, numbers of its failure; those that are none are told."""
        if self._run is None:  # it failed before there was a skill
            return numbers
        metrics, problems = self._run.measured(numbers)
        for problem in problems:
            self._log_problem(problem)
        return {**metrics, **self._held_arm.touched(self._run.names)}

    def _become(self, new: Status, metrics: Mapping[str, Number]) -> None:
        old, self.status = self.status, new
        if new is Status.INVALID and old is not Status.RUNNING:
            self.code = self.reason = ""
        if self._teller is not None:
            self.since = self._teller.clock()
        if self._teller is not None and new is not old:
            self._teller.tell(self, old, new, metrics)

    def _log_exception(self, when: str) -> None:
        _log.exception("%s: %s: the skill raised %s", self._arm, self.path, when)

    def _log_problem(self, problem: str) -> None:
        _log.error("%s: %s: %s", self._arm, self.path, problem)

    @property
    def _arm(self) -> str:
        return self._teller.arm if self._teller else "?"


def _one_line(error: BaseException) -> str:
    try:
        text = one_line(str(error))
    except Exception:  # noqa: BLE001 - of a skill's own, or with a number too long to be written
        text = "its text cannot be made"
    name = type(error).__name__
    sentence = f"{name}: {text}" if text else name
    if isinstance(error, _OF_OTHERS):
        sentence += ' (a skill ends no program: it returns, or raises Failure("CODE", "why"))'
    return sentence
