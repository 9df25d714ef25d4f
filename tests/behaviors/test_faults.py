"""Faults declared in a file happen as declared, and nothing else changes."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from typing import Any

import pytest

import bt_dualarm as bt
from bt_dualarm.behaviors.faults import FaultInjector, InjectedError
from bt_dualarm.core.errors import Failure, InjectedFailure
from bt_dualarm.skill.skill import Skill
from bt_dualarm.spec.faults import LeafFault, leaf_paths

TICK_S = 0.02


class Clock:
    """Simulated time that the test advances by one tick per step."""

    def __init__(self) -> None:
        self.ticks = 0

    def __call__(self) -> float:
        return self.ticks * TICK_S


class FiveSteps(Skill):
    """Takes five steps, and records the last one and the exceptions that reach it."""

    example = "five_steps"
    steps = 0
    closed = False
    caught: BaseException | None = None
    handles = False

    def __init__(self) -> None:
        """Needs no ports and no arm."""

    def run(self) -> Iterator[None]:
        try:
            for number in range(1, 6):
                self.steps = number
                try:
                    yield
                except InjectedError as error:
                    self.caught = error
                    if not self.handles:
                        raise
        finally:
            self.closed = True


def run_of(fault: dict[str, Any], skill: FiveSteps, most: int = 50) -> tuple[int, str]:
    """Number of ticks of one run with a fault, and its outcome."""
    clock = Clock()
    spec = LeafFault(arm="arm1", leaf="five_steps", **fault)
    wrap = FaultInjector({"f": spec}, clock, 0).of_leaf("sequence/five_steps")
    assert wrap is not None
    steps = wrap(skill).run()
    assert isinstance(steps, Generator)
    try:
        while clock.ticks < most:
            next(steps)
            clock.ticks += 1
    except StopIteration:
        return clock.ticks, "success"
    except InjectedFailure as failure:
        return clock.ticks, failure.code
    except InjectedError:
        return clock.ticks, "exception"
    steps.close()
    return clock.ticks, "hang"


# effect   phase   after   ticks   end         steps of the skill
TICKS = [
    ("fail", "start", 0.0, 0, "INJECTED", 0),
    ("fail", "during", 0.04, 2, "INJECTED", 2),
    ("fail", "end", 0.0, 5, "INJECTED", 5),
    ("raise", "start", 0.0, 0, "exception", 0),
    ("raise", "during", 0.04, 2, "exception", 2),
    ("raise", "end", 0.0, 5, "exception", 5),
    ("hang", "start", 0.0, 50, "hang", 0),
    ("hang", "during", 0.04, 50, "hang", 2),
    ("hang", "end", 0.0, 50, "hang", 5),
    ("fail", "during", 9.0, 5, "success", 5),  # it ended before the fault
]


@pytest.mark.parametrize(("effect", "phase", "after", "ticks", "end", "steps"), TICKS)
def test_fault_ends_the_skill_at_its_tick(
    effect: str, phase: str, after: float, ticks: int, end: str, steps: int
) -> None:
    skill = FiveSteps()
    fault = {"effect": effect, "phase": phase, "after": after}
    assert run_of(fault, skill) == (ticks, end)
    assert skill.steps == steps
    assert skill.closed == (steps > 0)  # a skill that has begun always cleans up


def test_skill_may_handle_an_injected_exception() -> None:
    skill = FiveSteps()
    skill.handles = True
    assert run_of({"effect": "raise", "phase": "during", "after": 0.04}, skill) == (5, "success")
    assert isinstance(skill.caught, InjectedError)


def test_other_exceptions_still_reach_a_skill_with_a_fault() -> None:
    """An exception thrown into a wrapped skill at its yield reaches the skill."""
    skill = FiveSteps()
    spec = LeafFault(arm="arm1", leaf="five_steps", phase="end")
    wrap = FaultInjector({"f": spec}, Clock(), 0).of_leaf("five_steps")
    assert wrap is not None
    steps = wrap(skill).run()
    assert isinstance(steps, Generator)
    next(steps)
    with pytest.raises(Failure, match="pushed"):
        steps.throw(Failure("COLLISION", "pushed"))
    assert skill.closed


def test_fault_respects_its_times_window_and_probability() -> None:
    clock = Clock()
    specs = {
        "twice": LeafFault(arm="a", leaf="x", times=2),
        "later": LeafFault(arm="a", leaf="x", begin=1.0, until=2.0, code="LATER"),
    }
    wrap = FaultInjector(specs, clock, 0).of_leaf("x")
    assert wrap is not None

    def code() -> str:
        assert wrap is not None
        try:
            next(iter(wrap(FiveSteps()).run()))
        except InjectedFailure as failure:
            return failure.code
        return ""

    assert [code() for _ in range(4)] == ["INJECTED", "INJECTED", "", ""]
    clock.ticks = 60
    assert [code(), code()] == ["LATER", ""]
    rare = {"rare": LeafFault(arm="a", leaf="x", times=1000, probability=0.3)}
    for _ in range(2):  # a seed repeats the same choices
        wrap = FaultInjector(rare, clock, 5).of_leaf("x")
        assert wrap is not None
        injected = [bool(code()) for _ in range(300)]
        assert 60 < sum(injected) < 120


def test_other_leaves_are_not_wrapped() -> None:
    injector = FaultInjector({"f": LeafFault(arm="a", leaf="sequence/x")}, Clock(), 0)
    assert injector.of_leaf("sequence/y") is None
    assert injector.of_leaf("x") is None
    assert injector.of_leaf("sequence/x") is not None


TREE: dict[str, Any] = {
    "bt_dualarm": 1,
    "name": "faulty",
    "world": {"scene": "empty", "time_limit": 5.0},
    "arms": {
        "arm1": {
            "robot": "ur5",
            "tree": {
                "sequence": [
                    {"retry": {"times": 3, "child": {"wait": 0.1}}},
                    {"selector": [{"go_home": {}}, {"log": "recovered"}]},
                    {"force_success": {"child": {"timeout": {"seconds": 0.2, "child": {
                        "wait": {"name": "last", "seconds": 0.1}}}}}},
                ]
            },
        },
        "arm2": {"robot": "ur5", "base": {"xyz": [0, 2, 0]}, "tree": {"wait": 0.3}},
    },
}  # fmt: skip


def test_tree_handles_faults_and_the_run_is_repeatable() -> None:
    faults = {
        "early": {"arm": "arm1", "leaf": "sequence/retry/wait", "times": 2},
        "mid": {"arm": "arm1", "leaf": "go_home", "effect": "raise"},
        "stuck": {"arm": "arm1", "leaf": "last", "effect": "hang"},
    }
    result = bt.run(TREE | {"faults": faults})
    assert result.outcome == "SUCCESS"
    leaves = result.arms["arm1"].leaves
    assert [run.code for run in leaves["sequence/retry/wait"].runs] == ["INJECTED", "INJECTED", ""]
    assert "the fault 'early'" in leaves["sequence/retry/wait"].runs[0].reason
    assert leaves["sequence/selector/go_home"].code == "EXCEPTION"
    assert leaves["sequence/selector/log"].status == "SUCCESS"
    assert leaves["sequence/force_success/timeout/last"].code == "HALTED"
    assert bt.run(TREE | {"faults": faults}).state_sha256 == result.state_sha256


def test_fault_that_never_happens_changes_nothing() -> None:
    idle = {"idle": {"arm": "arm2", "leaf": "wait", "begin": 5.0}}
    assert bt.run(TREE | {"faults": idle}).state_sha256 == bt.run(TREE).state_sha256


def test_leaf_paths_are_those_that_runs_report() -> None:
    root = bt.open(TREE).assembly.trees["arm1"]
    assert leaf_paths(root).keys() == {
        "sequence/retry/wait",
        "sequence/selector/go_home",
        "sequence/selector/log",
        "sequence/force_success/timeout/last",
    }
