"""Leaves: skills run as py_trees behaviors that catch their exceptions; the language's leaves."""

from __future__ import annotations

import atexit
import logging
import traceback
from collections.abc import Callable, Collection, Generator, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import GeneratorType, MappingProxyType
from typing import Annotated, ClassVar, Final, Literal, Protocol, TypeAlias
from weakref import WeakSet

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from pydantic import Field, WithJsonSchema

from bt_dualarm.behaviors.node import NAMES, AcyclicNode, StatusReporter, reached
from bt_dualarm.behaviors.report import LeafReport, LeafReports
from bt_dualarm.core.errors import RAISED_BY_SKILLS, Failure, Number, Overrun, SkillError
from bt_dualarm.skill.condition import Condition
from bt_dualarm.skill.making_room import from_its_place
from bt_dualarm.skill.skill import (
    Skill,
    plain,
    progress_of,
    refuse_code,
    refuse_metrics,
    refuse_return,
    wrong_metrics,
)
from bt_dualarm.spec.expressions import same as same
from bt_dualarm.spec.node_types import (
    KEY,
    LanguageNode,
    PortModel,
    Template,
    WrittenKey,
    failure,
    in_words,
    one_line,
    port,
    success,
)
from bt_dualarm.spec.values import Duration
from bt_dualarm.spec.yaml_reader import Data

_PACKAGE: Final = Path(__file__).parents[1]
_UNCLOSED: Final[WeakSet[SkillRun]] = WeakSet()

_LONGEST_REASON: Final = 10_000
"""Characters of a reason that are kept: an exception may have the output of a program in it."""


class SkillRun:
    """One run of a skill: its generator, with what it yields, returns and raises checked.

    Args:
        make: Function that makes the skill; may raise, as every call of a skill may.

    Raises:
        RuntimeError: The skill has raised StopIteration before its first step.
        TypeError: Its ``run`` is not a generator.

    Attributes:
        progress: Last progress from 0 to 1 that it yielded or set; None if it reports none.
    """

    def __init__(self, make: Callable[[], Skill]) -> None:
        self.progress: float | None = None
        try:
            self._skill = make()
            steps = self._skill.run()
        except StopIteration as error:  # would look like the end of the generator
            raise RuntimeError("StopIteration was raised before the first step") from error
        if not isinstance(steps, Iterator):
            raise TypeError(f"run() of {type(self._skill).__name__} has no yield")
        # What does not move the arm leaves a return that is still to be made to a later leaf.
        is_language = isinstance(self._skill, LanguageLeaf)
        self._steps = steps if is_language else from_its_place(self._skill, steps)
        _UNCLOSED.add(self)

    @property
    def needs_held(self) -> bool:
        """Whether the skill works only while the arm holds an object."""
        return self._skill.needs_held

    @property
    def names(self) -> frozenset[str]:
        """Texts among its ports, and to what their poses are relative: all objects in its task."""
        values = self._skill.ports.__dict__.values()
        texts = frozenset(value for value in values if isinstance(value, str))
        return texts | self._skill.relative_to

    def step(self, fault: BaseException | None) -> bool:
        """Run to the next ``yield``; returns False at the end, which is success.

        Args:
            fault: Exception to raise at the waiting ``yield``, None for none.

        Raises:
            Failure: The skill fails.
            SkillError: It violates the protocol of skills.
            Exception: Any other exception of the skill.
        """
        try:
            yielded = next(self._steps) if fault is None else self._raise(fault)
        except StopIteration as end:
            try:
                refuse_return(self._skill, end.value)
                refuse_metrics(self._skill)
            except SkillError as error:
                raise _located(self._declared_at(), error) from error.__cause__
            return False
        except SkillError as error:
            at = _authors_line(error) or self._declared_at()
            raise _located(f"{at}: {type(self._skill).__name__}", error) from error.__cause__
        except Failure as failure:
            try:
                refuse_code(self._skill, failure)
            except SkillError as error:
                at = _authors_line(failure) or self._declared_at()
                raise _located(at, error) from error.__cause__
            raise
        try:
            if yielded is not None:
                self._skill.progress = progress_of(self._skill, yielded)
            self.progress = progress_of(self._skill, self._skill.progress)
        except SkillError as error:
            raise _located(self._waiting_at(), error) from error.__cause__
        return True

    def close(self) -> None:
        """Let the skill clean up; no effect after its end.

        Raises:
            Exception: Any exception of the cleanup.
        """
        _UNCLOSED.discard(self)
        if isinstance(self._steps, Generator):
            self._steps.close()

    def measured(self, numbers: Mapping[str, Number]) -> tuple[dict[str, Number], list[str]]:
        """Returns its metrics with the numbers of its failure, and the violations among them."""
        skill = self._skill
        metrics = {**plain(skill.metrics), **plain(numbers)}
        return metrics, [*wrong_metrics(skill, skill.metrics), *wrong_metrics(skill, numbers)]

    def _raise(self, fault: BaseException) -> float | None:
        """Raise at the waiting ``yield``; only generators can handle it."""
        if isinstance(self._steps, Generator):
            progress: float | None = self._steps.throw(fault)
            return progress
        raise fault

    def _declared_at(self) -> str:
        """Returns file and line at which ``run`` begins, of a condition ``check``."""
        kind = type(self._skill)
        # The `run` of a condition is the library's.
        code = (kind.check if issubclass(kind, Condition) else kind.run).__code__
        return f"{Path(code.co_filename).name}:{code.co_firstlineno}"

    def _waiting_at(self) -> str:
        """Returns file and line of the ``yield`` at which the skill waits."""
        steps: object = self._steps
        while isinstance(steps, GeneratorType) and isinstance(steps.gi_yieldfrom, GeneratorType):
            steps = steps.gi_yieldfrom
        if not isinstance(steps, GeneratorType):
            return self._declared_at()
        frame = steps.gi_frame
        code = steps.gi_code
        line = code.co_firstlineno if frame is None else frame.f_lineno
        return f"{Path(code.co_filename).name}:{line}"


def _located(location: str, error: SkillError) -> SkillError:
    """Returns the error with a location in the skill's file in front."""
    return SkillError(f"{location}: {error}")


def _authors_line(error: Exception) -> str:
    """Returns file and line of the last frame of an error outside this package; empty if none."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if not Path(frame.filename).is_relative_to(_PACKAGE)]
    return f"{Path(own[-1].filename).name}:{own[-1].lineno}" if own else ""


@atexit.register
def _close_all() -> None:
    """Let skills clean up that were not closed, while their modules can still be imported."""
    for left in tuple(_UNCLOSED):
        left.close()


_log = logging.getLogger(__name__)

_ENDS_PROGRAM: Final = (SystemExit, KeyboardInterrupt, GeneratorExit)
"""Exceptions that end programs and generators; skills have no use for them."""


class HeldArm(Protocol):
    """Interface of the arm that the leaf itself uses, in addition to its skill."""

    def enter(self, *, anew: bool) -> None:
        """Mark this thread as the one that ticks or halts the leaf; ``anew``: a new run begins."""

    def pending_fault(self) -> BaseException | None:
        """Returns the fault of a motion that the leaf has started, None if there is none.

        It is raised in the skill where it waits, so that no skill has to poll for it.
        """

    def refuse_dropped(self) -> None:
        """Check that the hand has lost nothing while no leaf was checking.

        Raises:
            Failure: ``DROPPED``.
        """

    def release(self, *, done: bool) -> None:
        """Stop the motion that the leaf has started, if there is one; ``done``: it succeeded."""

    def touched(self, asked: Collection[str]) -> Mapping[str, Number]:
        """Returns metrics of contacts while the leaf moved the arm, except with ``asked``."""


@dataclass
class FirstTick:
    """Time of a leaf's first tick since it was set back, in seconds; None if it was not ticked."""

    time: float | None = None


class Leaf(AcyclicNode):
    """A py_trees behavior that runs a skill and catches all of its exceptions.

    ``tick`` and ``stop`` replace those of py_trees, which cost 4 to 7 times as much, mostly for
    debug log lines.

    Args:
        name: Name for display.
        begin: Function that makes a skill for a new run; may raise, as every call of a skill may.
        arm: Arm that this leaf uses.
        reports: Reports to which each run is added.
        first_tick: Shared with ``begin``; by default unused.
    """

    def __init__(
        self,
        name: str,
        begin: Callable[[], Skill],
        arm: HeldArm,
        reports: LeafReports,
        first_tick: FirstTick | None = None,
    ) -> None:
        self._first_tick = first_tick or FirstTick()
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
        self._reporter: StatusReporter | None = None
        super().__init__(name)

    def attach(self, reporter: StatusReporter, path: str, kind: str) -> None:
        """Make the leaf part of an arm's tree; arguments as `ReportingNode.attach`."""
        self._reporter = reporter
        self.path = path
        self.kind = kind

    def tick(self) -> Iterator[Behaviour]:
        """Run the skill to its next ``yield``."""
        if self._first_tick.time is None:
            self._first_tick.time = self._reporter.clock() if self._reporter else 0.0
        try:
            self._held_arm.enter(anew=self._run is None)
            if self._run is None:
                self._run = self._start()
                if self._run.needs_held:
                    self._held_arm.refuse_dropped()
                fault = None
            else:
                fault = self._held_arm.pending_fault()
            continues = self._run.step(fault)
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
            if not continues:
                self._let_go(done=True)  # no skill supervises a motion that was left running
                self._end(Status.SUCCESS)
            elif self.status is not Status.RUNNING:
                self._become(Status.RUNNING, {})
        yield self

    def update(self) -> Status:
        """Not used, because `tick` is replaced."""
        return self.status

    def stop(self, new_status: Status = Status.INVALID) -> None:
        """Halt the skill if it is running."""
        self._first_tick.time = None
        if self._run is not None:
            self._held_arm.enter(anew=False)
            problem = self._close()
            self.code = "HALTED"
            self.reason = problem
            self._end(new_status)
        elif self.status is not new_status:
            self._become(new_status, {})

    @property
    def halted(self) -> bool:
        """Whether the last run was halted before its end."""
        return self.status is Status.INVALID and self.code == "HALTED"

    @property
    def progress(self) -> float | None:
        """Progress from 0 to 1 of a running skill that reports it, else None."""
        return None if self._run is None else self._run.progress

    def _start(self) -> SkillRun:
        self.code = self.reason = ""
        time = self._reporter.clock() if self._reporter else 0.0
        self._report = LeafReport(self.path, self.kind, "RUNNING", time)
        self._reports.add(self._report)
        return SkillRun(self._begin)

    def _close(self) -> str:
        """Let the skill clean up; returns the failure of that, empty if there is none."""
        try:
            if self._run is not None:
                self._run.close()
        except Overrun as overrun:
            return f"its cleanup was interrupted: {overrun}"
        except RAISED_BY_SKILLS as error:
            self._log_exception("in its cleanup")
            return f"its cleanup raised {_one_line(error)}"
        finally:
            self._let_go()
        return ""

    def _let_go(self, *, done: bool = False) -> None:
        try:
            self._held_arm.release(done=done)
        except RAISED_BY_SKILLS:
            self._log_exception("while its arm was released")

    def _fail(self, code: str, reason: str, numbers: Mapping[str, Number]) -> None:
        self.code = code
        self.reason = one_line(reason[:_LONGEST_REASON])
        self._let_go()
        self._end(Status.FAILURE, numbers)

    def _end(self, status: Status, numbers: Mapping[str, Number] = MappingProxyType({})) -> None:
        metrics = self._measured(numbers)
        self._run = None
        self._become(status, metrics)
        if self._report is not None:
            self._report.status = NAMES[status]
            self._report.ended_s = self.since
            self._report.code = self.code
            self._report.reason = self.reason
            self._report.metrics = metrics

    def _measured(self, numbers: Mapping[str, Number]) -> Mapping[str, Number]:
        """Returns the metrics of the skill with the numbers of its failure; logs violations."""
        if self._run is None:  # it failed before there was a skill
            return numbers
        metrics, problems = self._run.measured(numbers)
        for problem in problems:
            self._log_problem(problem)
        return {**metrics, **self._held_arm.touched(self._run.names)}

    def _become(self, new: Status, metrics: Mapping[str, Number]) -> None:
        old = self.status
        self.status = new
        if new is Status.INVALID and old is not Status.RUNNING:
            self.code = self.reason = ""
        if self._reporter is not None:
            self.since = self._reporter.clock()
        if self._reporter is not None and new is not old:
            self._reporter.report(self, old, new, metrics)

    def _log_exception(self, when: str) -> None:
        _log.exception("%s: %s: the skill raised %s", self._arm, self.path, when)

    def _log_problem(self, problem: str) -> None:
        _log.error("%s: %s: %s", self._arm, self.path, problem)

    @property
    def _arm(self) -> str:
        return self._reporter.arm if self._reporter else "?"


def _one_line(error: BaseException) -> str:
    try:
        text = one_line(str(error))
    except Exception:  # noqa: BLE001 - from a skill's own class, or a number with too many digits
        text = "its message could not be formatted"
    name = type(error).__name__
    sentence = f"{name}: {text}" if text else name
    if isinstance(error, _ENDS_PROGRAM):
        sentence += (
            ' (a skill cannot end the program: it returns, or raises Failure("CODE", "why"))'
        )
    return sentence


# The language's leaves: skills that do not use the arm.


_Message: TypeAlias = Annotated[str, Field(max_length=500), Template()]


class LanguageLeaf(Skill):
    """Base of the language's leaves.

    Attributes:
        node_type: Declaration of the node type that a class implements.
        first_tick: Time in s of the leaf's first tick in this run of the node around it.
    """

    node_type: ClassVar[LanguageNode]
    first_tick = 0.0

    @classmethod
    def declares(cls, code: str) -> bool:  # noqa: ARG003 - any code is
        """Returns True for any failure code: the tree file chooses those of ``fail``."""
        return True


class Wait(LanguageLeaf):
    """Succeeds after a time."""

    class Ports(PortModel):
        """Ports of wait."""

        seconds: Duration = port(..., "Simulated time", gt=0.0)

    node_type = LanguageNode(
        "wait",
        "Succeeds after a time",
        Ports,
        shorthand="seconds",
        example="wait: 500 ms",
        outcomes=success,
        synonyms={"Sleep": "seconds", "Timer": "seconds"},
    )
    ports: Ports

    def run(self) -> Iterator[None]:
        """Wait until the time has elapsed."""
        began = self.time
        while not reached(self.time, began + self.ports.seconds):
            self.progress = (self.time - began) / self.ports.seconds
            yield


class Set(LanguageLeaf):
    """Writes a blackboard key."""

    class Ports(PortModel):
        """Ports of set."""

        key: Annotated[
            str,
            WrittenKey("value"),
            WithJsonSchema({"type": "string", "pattern": f"^{KEY.pattern}$"}),
        ] = port(..., "Blackboard key to write")
        value: Data = port(..., "Value to write, or another key")

    Outputs: ClassVar[type[PortModel]] = Ports
    node_type = LanguageNode(
        "set",
        "Writes a blackboard key",
        Ports,
        example="set: {key: height, value: 0.2}",
        outcomes=success,
        synonyms={"SetBlackboard": ""},
    )
    ports: Ports

    def run(self) -> Iterator[None]:
        """Write the value."""
        self.output("value", self.ports.value)
        yield from ()


class Compare(LanguageLeaf):
    """Succeeds if a comparison holds."""

    class Ports(PortModel):
        """Ports of compare."""

        value: Data = port(..., "Left side, usually a key")
        relation: Literal[
            "equal", "not_equal", "less", "less_or_equal", "greater", "greater_or_equal", "near"
        ] = port("equal", "The comparison")
        to: Data = port(..., "Right side")
        tolerance: float = port(
            1e-6, "Largest difference between two numbers that are near", ge=0.0, le=1e9
        )

    node_type = LanguageNode(
        "compare",
        "Succeeds if a comparison holds",
        Ports,
        example="compare: {value: 1, relation: less, to: 2}",
        synonyms={"ScriptCondition": ""},
    )
    ports: Ports

    def run(self) -> Iterator[None]:
        """Compare the two sides.

        Raises:
            Failure: ``FALSE``: the comparison does not hold; ``NOT_COMPARABLE``: values that are
                not numbers have neither order nor distance.
        """
        value = self.ports.value
        relation = self.ports.relation
        to = self.ports.to
        if not compared(value, relation, to, self.ports.tolerance):
            raise Failure("FALSE", f"{in_words(value)} {_NOT[relation]} {in_words(to)}")
        yield from ()


class Test(LanguageLeaf):
    """Succeeds if an expression is true.

    Attributes:
        worded: Function that returns the expression, and the same with values in place of keys.
    """

    __test__ = False  # otherwise pytest takes the class for a test

    class Ports(PortModel):
        """Ports of test."""

        expression: bool = port(..., 'Usually of keys: `"{n} < 3 and not {empty}"`')

    node_type = LanguageNode(
        "test",
        "Succeeds if an expression is true",
        Ports,
        shorthand="expression",
        example="test: true",
    )
    ports: Ports
    worded: Callable[[], tuple[str, str]] = staticmethod(lambda: ("", ""))

    def run(self) -> Iterator[None]:
        """Fail if the value of the expression is false.

        Raises:
            Failure: ``FALSE``: it is false.
        """
        if not self.ports.expression:
            text, values = self.worded()
            what = f"{text or 'the expression'} is false"
            raise Failure("FALSE", f"{what}: {values}" if values else what)
        yield from ()


class Log(LanguageLeaf):
    """Writes a line to the log."""

    class Ports(PortModel):
        """Ports of log."""

        message: _Message = port(..., "Text; {key} in it is replaced by the key's value")
        level: Literal["info", "warning", "error"] = port("info", "Severity")

    node_type = LanguageNode(
        "log",
        "Writes a line to the log",
        Ports,
        shorthand="message",
        example="log: the cube is there",
        outcomes=success,
    )
    ports: Ports

    def run(self) -> Iterator[None]:
        """Write the message."""
        level = logging.getLevelNamesMapping()[self.ports.level.upper()]
        self.context.log.log(level, "%s", one_line(self.ports.message))
        yield from ()


class Fail(LanguageLeaf):
    """Fails at once."""

    class Ports(PortModel):
        """Ports of fail."""

        code: str = port("FAIL", "Machine-readable code", pattern="^[A-Z][A-Z0-9_]{0,31}$")
        reason: _Message = port("the tree failed on purpose", "Human-readable sentence")

    node_type = LanguageNode(
        "fail",
        "Fails at once",
        Ports,
        shorthand="reason",
        example="fail: {code: NO_CUBE, reason: the table is empty}",
        outcomes=failure,
        synonyms={"AlwaysFailure": "", "Failure": ""},
    )
    ports: Ports

    def run(self) -> Iterator[None]:
        """Fail with the given code and reason."""
        yield from ()
        raise Failure(self.ports.code, self.ports.reason)


class Succeed(LanguageLeaf):
    """Succeeds at once."""

    node_type = LanguageNode(
        "succeed",
        "Succeeds at once",
        example="succeed",
        outcomes=success,
        synonyms={"AlwaysSuccess": "", "Success": ""},
    )

    def run(self) -> Iterator[None]:
        """Succeed in the first tick."""
        yield from ()


_NOT: Final[Mapping[str, str]] = {
    "equal": "does not equal",
    "not_equal": "equals",
    "less": "is not less than",
    "less_or_equal": "is greater than",
    "greater": "is not greater than",
    "greater_or_equal": "is less than",
    "near": "is not near",
}
_ORDER: Final[Mapping[str, Callable[[float, float], bool]]] = {
    "less": lambda a, b: a < b,
    "less_or_equal": lambda a, b: a <= b,
    "greater": lambda a, b: a > b,
    "greater_or_equal": lambda a, b: a >= b,
}


def compared(value: Data, relation: str, to: Data, tolerance: float) -> bool:
    """Returns whether a comparison holds.

    Args:
        value: Left side.
        relation: ``equal``, ``less``, ``near``, …
        to: Right side.
        tolerance: Largest difference between two numbers that are near.

    Raises:
        Failure: ``NOT_COMPARABLE``: values that are not numbers cannot be ordered or subtracted.
    """
    if relation == "near":
        return near(value, to, tolerance)
    if relation not in _ORDER:
        return same(value, to) == (relation == "equal")
    if not (_is_number(value) and _is_number(to)):
        raise Failure(
            "NOT_COMPARABLE",
            f"{in_words(value)} and {in_words(to)} cannot be ordered; only numbers can",
        )
    return _ORDER[relation](value, to)


def near(a: Data, b: Data, tolerance: float) -> bool:
    """Returns whether two numbers, or the items of two lists, differ by at most ``tolerance``.

    Raises:
        Failure: ``NOT_COMPARABLE``: two values are not both numbers.
    """
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(near(x, y, tolerance) for x, y in zip(a, b, strict=True))
    if not (_is_number(a) and _is_number(b)):
        raise Failure("NOT_COMPARABLE", f"{in_words(a)} and {in_words(b)} are not both numbers")
    return bool(abs(a - b) <= tolerance)


def _is_number(value: Data) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)
