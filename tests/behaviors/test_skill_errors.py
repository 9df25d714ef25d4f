"""A programming mistake in a skill is reported to its author and never counts as SUCCESS."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Generator
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from py_trees.common import Status

from bt_dualarm.core.errors import Failure
from bt_dualarm.skill.skill import Skill
from tests.behaviors.ticking import Stage

HUGE = 10**5000
"""Exceeds every float, and Python refuses to print it: a summary that contains it would be lost."""

NO_PROGRESS: tuple[Any, ...] = (
    "half", "0.5", "", {}, [], (), [0.5], float("nan"), float("inf"), True, False, object(), b"1",
    Status.RUNNING, np.array([0.1, 0.2]), np.nan, 1j, HUGE, -HUGE,
)  # fmt: skip
PROGRESS: tuple[Any, ...] = (None, 0, 1, 0.5, 7.0, -1, np.float32(0.5), np.float64(1), np.int64(0))
NO_RETURN: tuple[Any, ...] = (
    False, 0, 1, "", "done", {}, [], Status.FAILURE, Status.SUCCESS, float("nan"), np.bool_(False),
)  # fmt: skip
RETURN: tuple[Any, ...] = (None, True)
NO_METRIC: tuple[Any, ...] = (
    object(), [1, 2], {}, None, float("nan"), np.float32("nan"), np.zeros(3), b"x", 1j, Skill,
    HUGE, -HUGE,
)  # fmt: skip
METRIC: tuple[Any, ...] = (
    0, 1.5, True, "text", float("inf"), np.float32(1), np.int8(3), np.bool_(True), np.array(2.0),
    np.array([2.0]),
)  # fmt: skip
NO_METRICS: tuple[Any, ...] = (None, [], "metrics", {3: 1.0}, {None: 1.0})
NO_SAMPLES: tuple[Any, ...] = (
    (0.0, "far"),
    (0.0, [1, 2]),
    ([0, 1], [1]),
    ([1, 0], [1, 1]),
    (None, 1),
)
NO_CODE: tuple[Any, ...] = ("", "tired", "UNHEARD_OF", "HALTED", "SUCCESS", None, 7, Status.FAILURE)
CODE: tuple[Any, ...] = ("TIRED", "UNREACHABLE", "BUSY")
PHASES = (0, 2)
"""Ticks before the mistake: at once, and later."""


class Slipping(Skill):
    """Makes one mistake after some ticks."""

    failures = {"TIRED": "the arm is tired"}  # noqa: RUF012 - as `Skill` declares it
    mistake: ClassVar[tuple[str, Any, int]]
    closed = 0

    def run(self) -> Generator[Any, None, Any]:
        kind, value, ticks = self.mistake
        try:
            for _ in range(ticks):
                yield 0.1
            if kind == "yield":
                yield value
            elif kind == "note":
                self.progress = value
                yield
            elif kind == "metric":
                self.metrics["reached_m"] = value
            elif kind == "metrics":
                self.metrics = value
            elif kind == "record":
                self.record("error_m", *value)
            elif kind == "fail":
                raise Failure(value, "it could not be")
            elif kind == "reason":
                raise Failure("TIRED", value)
            elif kind == "return":
                return value
            yield
        finally:
            type(self).closed += 1


def played(folder: Path, kind: str, value: object, ticks: int) -> tuple[Stage, type[Slipping]]:
    skill = type("Slipping", (Slipping,), {"__doc__": "Slips.", "mistake": (kind, value, ticks)})
    stage = Stage(folder, "slipping", skill)
    for _ in range(ticks + 4):
        stage.tick()
    return stage, skill


def named(value: object) -> str:
    """Test id of a value; an object's address would differ from run to run."""
    if isinstance(value, int) and abs(value) == HUGE:
        return "huge"
    return str(value) if isinstance(value, str | int | float) else type(value).__name__


MISTAKES = [
    *itertools.product(["yield", "note"], NO_PROGRESS, PHASES),
    *itertools.product(["return"], NO_RETURN, PHASES),
    *itertools.product(["metric"], NO_METRIC, PHASES),
    *itertools.product(["metrics"], NO_METRICS, PHASES),
    *itertools.product(["record"], NO_SAMPLES, PHASES),
    *itertools.product(["fail"], NO_CODE, PHASES),
    *itertools.product(["reason"], (None, 3, b"no", {}), PHASES),
]


@pytest.mark.parametrize(("kind", "value", "ticks"), MISTAKES, ids=named)
def test_mistake_fails_the_leaf_with_a_reason_for_the_author(
    kind: str, value: object, ticks: int, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The reason names the skill and the line; the skill has cleaned up and released its arm."""
    with caplog.at_level(logging.ERROR):
        stage, skill = played(tmp_path, kind, value, ticks)
    (report,) = stage.tree.leaves
    assert (report.status, report.code) == ("FAILURE", "EXCEPTION")
    assert report.reason.startswith("test_skill_errors.py:")
    assert "Slipping" in report.reason
    assert report.reason in caplog.text
    assert skill.closed == 1
    assert stage.released
    assert all(isinstance(name, str) for name in report.metrics)


VALID = [
    *itertools.product(["yield", "note"], PROGRESS, PHASES),
    *itertools.product(["return"], RETURN, PHASES),
    *itertools.product(["metric"], METRIC, PHASES),
]


@pytest.mark.parametrize(("kind", "value", "ticks"), VALID, ids=named)
def test_valid_value_succeeds(
    kind: str, value: object, ticks: int, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    stage, _ = played(tmp_path, kind, value, ticks)
    (report,) = stage.tree.leaves
    assert report.status == "SUCCESS", report.reason
    assert caplog.text == ""
    for metric in report.metrics.values():
        assert type(metric) in (bool, int, float, str)


@pytest.mark.parametrize("code", CODE)
def test_leaf_fails_with_the_declared_or_standard_code(code: str, tmp_path: Path) -> None:
    stage, _ = played(tmp_path, "fail", code, 1)
    (report,) = stage.tree.leaves
    assert (report.status, report.code, report.reason) == ("FAILURE", code, "it could not be")
