"""Final report of a run, compared with golden texts at common terminal widths."""

from __future__ import annotations

from pathlib import Path

import pytest

from bt_dualarm.behaviors.report import LeafReport
from bt_dualarm.runtime.outcome import ArmResult, Ending, Outcome, RunResult
from bt_dualarm.runtime.report import UNICODE, Report, in_words
from tests.runtime.test_display import check_golden, plain_console, printed

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
    {
        "arm1": ArmResult("arm1", "ur5", Outcome.SUCCESS, 12.0, 0, (CIRCLE, WAIT)),
        "arm2": ArmResult("arm2", "panda", Outcome.FAILURE, 12.3, 3, (TRACK,)),
        "arm3": ArmResult("arm3", "ur3", Outcome.FAILURE, 0.5, fault="tree raised KeyError: 'x'"),
        "spare": ArmResult("spare", "xarm7", Outcome.NOT_SPAWNED),
    },
    at_rest=True,
)


@pytest.mark.parametrize("width", [40, 80])
def test_the_report_equals_its_golden_text(width: int) -> None:
    console = plain_console(width)
    console.print(Report("pick_and_track", RESULT, Path("out/first"), UNICODE))
    check_golden(f"report_{width}.txt", printed(console))


def test_a_retried_leaf_is_reported_once() -> None:
    first = LeafReport("main/circle", "circle", "FAILURE", 0.0, 1.0, "BUSY", "busy")
    arm = ArmResult("arm1", "ur5", Outcome.SUCCESS, runs=(first, CIRCLE))
    result = RunResult(Ending.FINISHED, 5.0, 1.0, {"arm1": arm}, at_rest=True)
    console = plain_console(80)
    console.print(Report("retried", result, None, UNICODE))
    assert "path rms" in printed(console)
    assert "BUSY" not in printed(console)


def test_a_halted_leaf_reports_its_metrics() -> None:
    metrics = {"path_rms_m": 0.00012, "turns": 3}
    halted = LeafReport("main/circle", "circle", "INVALID", 0.0, 1.0, "HALTED", metrics=metrics)
    silent = LeafReport("main/wait", "wait", "INVALID", 0.0, 1.0, "HALTED")
    arm = ArmResult("arm1", "ur5", Outcome.UNFINISHED, runs=(halted, silent))
    result = RunResult(Ending.STOPPED, 5.0, 1.0, {"arm1": arm}, at_rest=True)
    console = plain_console(80)
    console.print(Report("halted", result, None, UNICODE))
    assert "circle  halted after 1.0 s: path rms 0.12 mm, turns 3" in printed(console)
    assert "wait" not in printed(console)


def test_a_failed_tree_reports_the_leaf_that_a_timeout_halted() -> None:
    """Otherwise the report would name a failure that the tree had handled, or none."""
    handled = LeafReport("main/go", "go", "FAILURE", 0.0, 1.0, "BUSY", "another one moves it")
    halted = LeafReport("main/timeout/wait", "wait", "INVALID", 1.0, 9.0, "HALTED")
    arm = ArmResult("arm1", "ur5", Outcome.FAILURE, runs=(handled, halted))
    result = RunResult(Ending.FINISHED, 9.0, 1.0, {"arm1": arm}, at_rest=True)
    console = plain_console(80)
    console.print(Report("timed_out", result, None, UNICODE))
    assert "timeout/wait  halted after 8.0 s" in printed(console)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("path_rms_m", 0.00012, "path rms 0.12 mm"),
        ("angle_error_rad", 0.0174533, "angle error 1 deg"),
        ("lag_s", -0.0123, "lag -0.0123 s"),
        ("lost_count", 0, "lost count 0"),
        ("frames", 12345, "frames 12345"),
        ("grip_force_n", 20.04, "grip force 20 N"),
        ("torque_nm", 3.0, "torque 3 N m"),
        ("tool_speed_m_s", 0.03, "tool speed 0.03 m/s"),
        ("turn_rad_s", 0.0174533, "turn 1 deg/s"),
        ("weighed_kg", 0.25, "weighed 0.25 kg"),
        ("residual_px", 0.21, "residual 0.21 px"),
        ("share", 0.123456, "share 0.123"),
        ("in_view", True, "in view yes"),
        ("object", "cube", "object cube"),
        ("m", 2.0, "m 2"),
    ],
)
def test_metrics_in_words(name: str, value: float | str, words: str) -> None:
    assert in_words(name, value) == words


def test_two_metrics_of_a_leaf_do_not_share_a_name() -> None:
    """A distance and an angle were once both called the object's error."""
    texts = [in_words(name, 0.001) for name in ("object_error_m", "object_turned_rad")]
    assert texts == ["object error 1 mm", "object turned 0.0573 deg"]
