"""Watchdog: what it interrupts, in which thread, and what it does not interrupt."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable
from typing import Any

import pytest

import bt_dualarm as bt
from bt_dualarm.core.errors import Overrun
from bt_dualarm.runtime.interruption import StopRequest, Watchdog

ENDLESS_S = 60.0
"""Duration of code that must be interrupted; otherwise its test would fail after that time."""


def sleep() -> None:
    time.sleep(ENDLESS_S)


def spin() -> None:
    latest = time.monotonic() + ENDLESS_S
    while time.monotonic() < latest:
        pass


def interruption_of(dog: Watchdog, act: Callable[[], object]) -> str:
    """Message of the interruption of a function; empty if there was none."""
    try:
        with dog.awake():
            try:
                with dog:
                    act()
            except Overrun as overrun:
                return str(overrun)
    finally:
        dog.close()
    return ""


@pytest.mark.parametrize("act", [sleep, spin])
def test_code_that_has_used_up_its_budget_is_interrupted(
    act: Callable[[], object],
) -> None:
    dog = Watchdog(0.3, StopRequest())
    before = signal.getsignal(signal.SIGURG)
    sentence = interruption_of(dog, act)
    assert sentence.startswith("the run at test_watchdog.py:")
    assert f", in {act.__name__} has not returned for 0." in sentence
    assert dog.overrun == sentence
    assert signal.getsignal(signal.SIGURG) is before


def test_python_code_in_another_thread_is_interrupted() -> None:
    messages: list[str] = []
    dog = Watchdog(0.3, StopRequest())
    thread = threading.Thread(target=lambda: messages.append(interruption_of(dog, spin)))
    thread.start()
    thread.join()
    assert ", in spin has not returned" in messages[0]


def test_short_calls_do_not_add_up() -> None:
    """The budget starts again with each of them."""
    dog = Watchdog(0.5, StopRequest())
    with dog.awake():
        for _ in range(8):
            with dog:
                time.sleep(0.1)
    dog.close()
    assert dog.overrun == ""


@pytest.mark.parametrize("requests", [1, 2])
def test_the_budget_shrinks_with_each_stop_request(
    requests: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bt_dualarm.runtime.interruption.STOPPING_S", 0.3 if requests == 1 else 1e6)
    stop = StopRequest()
    for _ in range(requests):
        stop.ask()
    assert interruption_of(Watchdog(float("inf"), stop), sleep)


def test_package_code_that_no_skill_has_called_is_not_interrupted() -> None:
    """A controller must not be interrupted in its work, even on a slow machine."""
    dog = Watchdog(0.2, StopRequest())
    names: dict[str, Any] = {"dog": dog, "sleep": time.sleep}
    text = "def work():\n    with dog.awake(), dog:\n        sleep(0.8)"
    exec(compile(text, bt.__file__, "exec"), names)  # noqa: S102 - as if it were of the package
    thread = threading.Thread(target=names["work"])
    thread.start()
    thread.join()
    dog.close()
    assert dog.overrun == ""


def test_a_debugger_and_a_terminal_are_not_interrupted() -> None:
    """Code below one of their functions waits for a person."""
    for module in ("bdb", "bt_dualarm.cli.safe_streams"):
        names: dict[str, Any] = {"__name__": module, "sleep": time.sleep}
        exec("def prompt(): sleep(0.8)", names)  # noqa: S102 - a module that waits
        dog = Watchdog(0.2, StopRequest())
        assert interruption_of(dog, names["prompt"]) == ""
        assert dog.overrun == ""


class Dawdler(bt.Skill):
    """Takes a moment for one tick."""

    example = "dawdler"

    def run(self) -> Any:
        """Move, and think."""
        yield from self.arm.travel([self.arm.setpoint.q + 0.05], 0.5)
        time.sleep(0.3)
        yield


def test_a_run_within_its_budget_is_bit_identical() -> None:
    tree = {
        "bt_dualarm": 1,
        "world": {"scene": "empty"},
        "arms": {"arm1": {"robot": "ur5", "tree": {"dawdler": None}}},
    }
    runs = [bt.run(tree, skills=[Dawdler], watchdog=budget) for budget in (None, 60.0)]
    assert [run.outcome for run in runs] == ["SUCCESS", "SUCCESS"]
    assert runs[0].state_sha256 == runs[1].state_sha256


def test_an_overrun_ends_a_run_from_python_with_its_reason() -> None:
    tree = {
        "bt_dualarm": 1,
        "world": {"scene": "empty"},
        "arms": {"arm1": {"robot": "ur5", "tree": {"endless": None}}},
    }
    result = bt.run(tree, skills=[Endless], watchdog=0.5)
    assert result.ending is bt.Ending.OVERRUN
    leaf = result.arms["arm1"].leaves["endless"]
    assert (leaf.status, leaf.code) == ("FAILURE", "OVERRUN")
    assert "test_watchdog.py:" in leaf.reason
    assert result.at_rest


class Endless(bt.Skill):
    """Never yields."""

    example = "endless"

    def run(self) -> Any:
        """Compute."""
        sleep()
        yield
