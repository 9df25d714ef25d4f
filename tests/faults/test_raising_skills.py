"""An exception anywhere in a skill makes its leaf fail and does not affect other arms."""

from __future__ import annotations

import logging
import textwrap
from itertools import product
from pathlib import Path

import pytest

from bt_dualarm import cli
from bt_dualarm.skill.registry import Registry
from tests.commands import BtRun, Ran
from tests.families import some
from tests.plays import STOPPED, Play, Stage

HERE = Path(__file__).parent

PHASES = ("constructor", "before", "after", "ending", "stream", "camera", "aim")
"""Phases of `Raiser`; in ``ending``, the cleanup raises after the skill has ended by itself."""

ENDINGS = ("SystemExit", "StopIteration", "GeneratorExit", "KeyboardInterrupt")
"""Exceptions that elsewhere end a program or a generator."""

TWO_ARMS = """
    world: {{scene: empty, time_limit: 20}}
    arms:
      faulty:
        robot: ur5
        camera: {{mount: wrist, resolution: [32, 24], fps: 30}}
        tree: {tree}
      other:
        robot: panda
        base: {{xyz: [0, 1.5, 0]}}
        tree: {{reach_to_pose: {{offset: {{xyz: [0, 0, 0.1]}}, speed: 0.1}}}}
"""


@pytest.fixture(scope="module")
def registry() -> Registry:
    return Registry.load([HERE / "skills"])


def check_other_arm(play: Play) -> None:
    """The other arm's tree ended in SUCCESS, after the fault."""
    assert play.arm("other").outcome == "SUCCESS"
    assert (play.arm("other").ended_s or 0.0) > (play.arm("faulty").ended_s or 0.0)


@pytest.mark.parametrize(("phase", "error"), some(product(PHASES, ("ValueError", *ENDINGS)), 4))
def test_leaf_fails_and_the_other_arm_goes_on(
    phase: str, error: str, stage: Stage, caplog: pytest.LogCaptureFixture
) -> None:
    """FAILURE EXCEPTION with its traceback in the log, and the arm stops within a second."""
    tree = f"{{raiser: {{phase: {phase}, error: {error}}}}}"
    with caplog.at_level(logging.ERROR):
        play = stage.run(TWO_ARMS.format(tree=tree))
    leaf = play.leaf("raiser", "faulty")
    assert (leaf.status, leaf.code) == ("FAILURE", "EXCEPTION")
    assert f"on purpose, in {phase}" in caplog.text
    assert "raiser.py" in caplog.text
    assert leaf.ended_s is not None
    assert play.speed_after(leaf.ended_s + 1.0, "faulty") < STOPPED
    assert play.arm("faulty").outcome == "FAILURE"
    check_other_arm(play)


@pytest.mark.usefixtures("without_plots")
@pytest.mark.parametrize("phase", some(PHASES, 2))
def test_record_log_and_report_have_the_exception(
    phase: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command has code 1, prints the reason, logs the traceback and completes the record.

    The leaf after the failed one never begins.
    """
    file = tmp_path / "raising.yaml"
    record = tmp_path / "record"
    tree = f"{{sequence: [{{raiser: {{phase: {phase}}}}}, {{circle: {{}}}}]}}"
    file.write_text("bt_dualarm: 1\n" + textwrap.dedent(TWO_ARMS.format(tree=tree)))
    options = ("--skills", HERE / "skills", "--renderer", "ray", "--record", record)
    code = cli.run([str(part) for part in (file, *options)])
    assert code == 1
    ran = Ran(code, *capsys.readouterr(), record)
    arms = ran.summary["arms"]
    assert [arms[name]["outcome"] for name in ("faulty", "other")] == ["FAILURE", "SUCCESS"]
    (leaf,) = arms["faulty"]["leaves"]
    assert (leaf["status"], leaf["code"]) == ("FAILURE", "EXCEPTION")
    assert f"on purpose, in {phase}" in leaf["reason"]
    assert "on purpose" in ran.out
    assert "Traceback" in (record / "run.log").read_text()


def test_arm_moves_before_the_fault(stage: Stage) -> None:
    """The other tests show something only if the arm moves until the failure."""
    play = stage.run(TWO_ARMS.format(tree="{raiser: {phase: after}}"))
    assert max(speed for time, speed in play.speeds["faulty"] if time < 0.3) > 2 * STOPPED


def test_exception_in_the_cleanup_of_a_halted_skill_is_recorded(
    stage: Stage, caplog: pytest.LogCaptureFixture
) -> None:
    """A timeout halts the skill, whose ``finally`` raises; the timeout fails in any case."""
    play = stage.run(
        TWO_ARMS.format(tree="{timeout: {seconds: 0.5, child: {raiser: {phase: finally}}}}")
    )
    leaf = play.leaf("raiser", "faulty")
    assert (leaf.status, leaf.code) == ("INVALID", "HALTED")
    assert "on purpose, in finally" in leaf.reason
    assert "on purpose, in finally" in caplog.text
    assert play.speed_after(1.5, "faulty") < STOPPED
    check_other_arm(play)


def test_invalid_metrics_do_not_hide_the_failure(stage: Stage) -> None:
    """The leaf fails with EXCEPTION."""
    play = stage.run(TWO_ARMS.format(tree="{raiser: {phase: metrics}}"))
    assert play.leaf("raiser", "faulty").code == "EXCEPTION"
    check_other_arm(play)


def test_nan_set_points_leave_the_arm_at_rest(stage: Stage) -> None:
    """A stream of NaN is clipped: the arm comes to rest and the world does not diverge."""
    tree = "{force_success: {child: {timeout: {seconds: 1.5, child: {raiser: {phase: nan}}}}}}"
    play = stage.run(TWO_ARMS.format(tree=tree))
    assert play.speed_after(1.3, "faulty") < STOPPED
    assert play.arm("faulty").clipped_setpoints > 0
    check_other_arm(play)


def test_failed_leaf_can_be_followed_by_another(stage: Stage) -> None:
    """The next leaf, here the other child of a selector, does not see the fault again."""
    tree = "{selector: [{raiser: {phase: stream}}, {reach_to_pose: {posture: home}}]}"
    play = stage.run(TWO_ARMS.format(tree=tree))
    assert play.leaf("raiser", "faulty").code == "EXCEPTION"
    assert play.leaf("reach_to_pose", "faulty").status == "SUCCESS"
    assert play.arm("faulty").outcome == "SUCCESS"


@pytest.mark.slow
def test_file_that_cannot_be_imported_stops_the_command(bt_run_here: BtRun) -> None:
    """The message has the file and the reason; nothing moves, and there is no record."""
    ran = bt_run_here("circle", "--skills", HERE / "broken")
    assert ran.code == 2
    assert "half_written.py" in ran.err
    assert "on purpose, at import" in ran.err
    assert "Traceback" not in ran.err
    assert not (ran.folder / "summary.json").exists()
