"""Lifecycle of a leaf: whatever a skill does, its tree goes on and its arm is released."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from bt_dualarm.core.errors import Failure, Interruption
from bt_dualarm.skill.skill import Skill
from bt_dualarm.spec.node_types import PortModel, port
from tests.behaviors.ticking import Stage


class Raiser(Skill):
    """Raises in the phase that its port names."""

    class Ports(PortModel):
        where: str = port("", "A phase of the life")

    ports: Ports

    def __init__(self, ports, context, write):  # type: ignore[no-untyped-def]
        super().__init__(ports, context, write)
        self._raise_in("constructor")

    def run(self) -> Iterator[None]:
        self._raise_in("first step")
        self.metrics["steps"] = np.float32(1.0)  # type: ignore[assignment]
        try:
            yield
            self._raise_in("second step")
            yield
        finally:
            self._raise_in("cleanup")

    def _raise_in(self, phase: str) -> None:
        if self.ports.where == phase:
            raise ZeroDivisionError(f"in the {phase}\nand a second line")


@pytest.mark.parametrize("where", ["constructor", "first step", "second step", "cleanup"])
def test_exception_fails_the_leaf_and_nothing_else(
    where: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """FAILURE EXCEPTION with a reason of one line, a traceback in the log, and a released arm."""
    stage = Stage(tmp_path, f"sequence: [{{raiser: {{where: {where}}}}}]", Raiser)
    while stage.tick().startswith("R"):
        pass
    (leaf,) = stage.tree.view().children
    assert leaf.status == "FAILURE"
    assert leaf.reason == f"EXCEPTION: ZeroDivisionError: in the {where} and a second line"
    assert stage.released == ["sequence/raiser"]
    assert "Traceback" in caplog.text
    assert "raise ZeroDivisionError" in caplog.text
    (report,) = stage.tree.leaves
    assert (report.status, report.code) == ("FAILURE", "EXCEPTION")


def test_sibling_runs_on_after_an_exception(tmp_path: Path) -> None:
    stage = Stage(
        tmp_path,
        "parallel: {policy: 1, on_failure: continue,"
        " children: [{raiser: {where: first step}}, {wait: 3}]}",
        Raiser,
    )
    assert stage.table(4) == ["R F R", "R F R", "R F R", "S F S"]


def test_exception_in_the_cleanup_of_a_halted_leaf_does_not_keep_siblings_running(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    stage = Stage(tmp_path, "parallel: [{raiser: {where: cleanup}}, {raiser: {}}]", Raiser)
    stage.tick()
    stage.tree.halt()
    assert stage.letters == "- - -"
    assert stage.released == ["parallel/raiser", "parallel/raiser#2"]
    assert "in its cleanup" in caplog.text
    first, second = stage.tree.leaves
    assert first.reason.startswith("its cleanup raised ZeroDivisionError")
    assert (second.status, second.code, second.reason) == ("INVALID", "HALTED", "")


class Stubborn(Skill):
    """Ignores halts."""

    def run(self) -> Iterator[None]:
        for _ in range(2):
            try:
                yield
            finally:
                continue  # noqa: B012 - the mistake that is tested


def test_skill_that_ignores_a_halt_is_halted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    stage = Stage(tmp_path, "sequence: [stubborn]", Stubborn)
    stage.tick()
    stage.tree.halt()
    assert stage.letters == "- -"
    assert stage.released == ["sequence/stubborn"]
    assert "generator ignored GeneratorExit" in caplog.text


class Quitter(Skill):
    """Raises an exception that elsewhere ends a program or a generator."""

    error: ClassVar[BaseException]

    def run(self) -> Iterator[None]:
        yield
        raise self.error


@pytest.mark.parametrize("error", [SystemExit(0), KeyboardInterrupt(), GeneratorExit("so")])
def test_exception_that_would_end_the_program_ends_only_the_leaf(
    error: BaseException, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The reason tells the author how a skill ends instead."""
    monkeypatch.setattr(Quitter, "error", error, raising=False)
    stage = Stage(tmp_path, "quitter", Quitter)
    stage.table(2)
    text = f"{type(error).__name__}: {error}".removesuffix(": ")
    assert stage.tree.view().reason == (
        f"EXCEPTION: {text} (a skill cannot end the program: "
        'it returns, or raises Failure("CODE", "why"))'
    )


class Interrupted(Skill):
    """Simulates Ctrl-C during a tick."""

    def run(self) -> Iterator[None]:
        raise Interruption
        yield


def test_ctrl_c_leaves_the_tree(tmp_path: Path) -> None:
    stage = Stage(tmp_path, "interrupted", Interrupted)
    with pytest.raises(Interruption):
        stage.tick()


class Plain(Skill):
    """Does not yield; the registry refuses it, but a user's test may not."""

    def run(self) -> Iterator[None]:  # type: ignore[empty-body]
        pass


class Stopper(Skill):
    """Raises StopIteration where it would look like the end of the generator."""

    def __init__(self, ports, context, write):  # type: ignore[no-untyped-def]
        super().__init__(ports, context, write)
        next(iter(()))

    def run(self) -> Iterator[None]:
        yield


@pytest.mark.parametrize(
    ("name", "skill", "reason"),
    [
        ("plain", Plain, "EXCEPTION: TypeError: run() of Plain has no yield"),
        (
            "stopper",
            Stopper,
            "EXCEPTION: RuntimeError: StopIteration was raised before the first step",
        ),
    ],
)
def test_invalid_run_fails(name: str, skill: type[Skill], reason: str, tmp_path: Path) -> None:
    stage = Stage(tmp_path, name, skill)
    stage.tick()
    assert stage.tree.view().reason == reason


class Measurer(Skill):
    """Reports progress and metrics, and fails."""

    class Outputs(PortModel):
        length: float = port(..., "How long", unit="m")

    failures = {"TOO_LONG": "longer than allowed"}  # noqa: RUF012 - as `Skill` declares it

    def run(self) -> Iterator[float]:
        yield 0.25
        self.metrics["rms_m"] = np.float64(0.5)
        self.metrics["odd"] = [1, 2]  # type: ignore[assignment]
        self.output("length", 0.75)
        yield 7.0
        raise Failure("TOO_LONG", "longer than allowed", length_m=float(np.float32(0.5)))


def test_progress_metrics_and_numbers_of_a_failure(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Progress is clamped to 0 … 1; metrics become plain values, and invalid ones are logged."""
    stage = Stage(tmp_path, "measurer", Measurer)
    stage.tick()
    assert stage.tree.view().progress == 0.25
    stage.tick()
    assert stage.tree.view().progress == 1.0
    stage.tick()
    assert stage.tree.view().progress is None
    (report,) = stage.tree.leaves
    assert report.metrics == {"rms_m": 0.5, "length_m": 0.5}
    assert "metric 'odd' of Measurer is [1, 2]" in caplog.text
    assert (report.started_s, report.ended_s) == (0.0, 2.0)
    assert stage.events[-1].metrics == report.metrics


def test_output_reaches_another_leaf(tmp_path: Path) -> None:
    stage = Stage(
        tmp_path,
        'sequence: [{force_success: {child: {measurer: {length: "{found}"}}}},'
        ' {compare: {value: "{found}", to: 0.75}}]',
        Measurer,
    )
    assert stage.table(3)[-1] == "S S F S"


class Rogue(Skill):
    """Writes an output that it did not declare."""

    class Outputs(PortModel):
        length: float = port(..., "How long", unit="m")

    class Ports(PortModel):
        what: str = port(..., "Output")

    ports: Ports

    def run(self) -> Iterator[None]:
        self.output(self.ports.what, "long")
        yield


@pytest.mark.parametrize(
    ("what", "error"),
    [
        ("width", "KeyError"),
        ("length", "TypeError: output 'length' is 'long': it is declared as float"),
    ],
)
def test_output_of_another_name_or_type_is_an_exception(
    what: str, error: str, tmp_path: Path
) -> None:
    stage = Stage(tmp_path, f'rogue: {{what: {what}, length: "{{x}}"}}', Rogue)
    stage.tick()
    assert stage.tree.view().reason.startswith(f"EXCEPTION: {error}")


def test_every_start_has_a_new_skill(tmp_path: Path) -> None:
    """A leaf can be restarted after SUCCESS, FAILURE and INVALID, and reports each start."""
    stage = Stage(
        tmp_path, "repeat: {times: 2, child: {retry: {times: 2, child: {act: {script: F|S}}}}}"
    )
    stage.table(3)
    stage.tree.halt()
    assert [report.status for report in stage.tree.leaves] == ["FAILURE", "SUCCESS", "SUCCESS"]


def test_stop_before_the_first_tick_is_harmless(tmp_path: Path) -> None:
    stage = Stage(tmp_path, "act: {script: R}")
    stage.tree.halt()
    stage.tree._root.stop()  # type: ignore[call-arg]
    assert not stage.events
    assert not stage.released


def test_tree_that_has_ended_is_not_ticked_again(tmp_path: Path) -> None:
    stage = Stage(tmp_path, "act: {script: S}")
    assert stage.table(3) == ["S", "S", "S"]
    assert len(stage.tree.leaves) == 1


class Shouter(Skill):
    """Fails with a text that contains terminal control characters."""

    class Ports(PortModel):
        raises: bool = port(False, "Whether it raises something else than a failure")

    ports: Ports

    def run(self) -> Iterator[None]:
        """Fails at once."""
        yield from ()
        text = "red \x1b[31m,\nbell \x07, \u202eback"
        raise ValueError(text) if self.ports.raises else Failure("LOUD", text)


@pytest.mark.parametrize("raises", ["true", "false"])
def test_reason_is_one_printable_line(raises: str, tmp_path: Path) -> None:
    stage = Stage(tmp_path, f"shouter: {{raises: {raises}}}", Shouter)
    stage.tick()
    reason = stage.tree.view().reason
    assert reason.endswith("red \ufffd[31m, bell \ufffd, \ufffdback")
    assert reason.isprintable()
    assert next(iter(stage.tree.leaves)).reason in reason
