"""The last words on a run, kept as golden texts at the widths of real terminals."""

from __future__ import annotations

from pathlib import Path

import pytest

from bt_dualarm.run.outcome import ArmResult, Ending, Outcome, RunResult
from bt_dualarm.run.report import Report, in_words, last_runs
from bt_dualarm.run.symbols import UNICODE
from bt_dualarm.tree.report import LeafReport
from tests.run.test_display import check_golden, plain_console, printed

CIRCLE = LeafReport(
    "main/circle",
    "circle",
    "SUCCESS",
    0.0,
    4.5,
    metrics={"path_rms_m": 0.0000447, "path_max_m": 0.0000551, "duration_s": 3.79},
)
WAIT = LeafReport("main/wait", "wait", "SUCCESS", 4.5, 5.0)
TRACK = LeafReport(
    "track",
    "track",
    "FAILURE",
    0.0,
    12.3,
    "LOST",
    "the target was last seen 2.1 s ago, and the search found nothing",
    {"unseen_s": 2.1, "yz_rms_m": 0.001},
)
RESULT = RunResult(
    Ending.TIME_LIMIT,
    46.31,
    8.2,
    (
        ArmResult("arm1", "ur5", Outcome.SUCCESS, 12.0, 0, (CIRCLE, WAIT)),
        ArmResult("arm2", "panda", Outcome.FAILURE, 12.3, 3, (TRACK,)),
        ArmResult("arm3", "ur3", Outcome.FAILURE, 0.5, fault="tree raised KeyError: 'x'"),
        ArmResult("spare", "xarm7", Outcome.NOT_SPAWNED),
    ),
    at_rest=True,
)


@pytest.mark.parametrize("width", [40, 80])
def test_the_report(width: int) -> None:
    console = plain_console(width)
    console.print(Report("pick_and_track", RESULT, Path("out/first"), UNICODE))
    check_golden(f"report_{width}.txt", printed(console))


def test_a_retried_leaf_speaks_once() -> None:
    first = LeafReport("main/circle", "circle", "FAILURE", 0.0, 1.0, "BUSY", "busy")
    arm = ArmResult("arm1", "ur5", Outcome.SUCCESS, leaves=(first, CIRCLE))
    assert list(last_runs(arm)) == [CIRCLE]


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("path_rms_m", 0.00012, "path rms 0.12 mm"),
        ("angle_error_rad", 0.0174533, "angle error 1 deg"),
        ("lag_s", -0.0123, "lag -0.0123 s"),
        ("lost_count", 0, "lost count 0"),
        ("frames", 12345, "frames 12345"),
        ("share", 0.123456, "share 0.123"),
        ("in_view", True, "in view yes"),
        ("object", "cube", "object cube"),
        ("m", 2.0, "m 2"),
    ],
)
def test_numbers_in_words(name: str, value: float | str, words: str) -> None:
    assert in_words(name, value) == words


def test_two_metrics_of_a_leaf_do_not_share_a_name() -> None:
    """A distance and an angle were both said to be the object's error."""
    said = [in_words(name, 0.001) for name in ("object_error_m", "object_turned_rad")]
    assert said == ["object error 1 mm", "object turned 0.0573 deg"]
