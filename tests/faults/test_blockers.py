"""Skill code that does not return is reported and aborted; arms stop, records are complete."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from bt_dualarm import cli
from bt_dualarm.replay.record import Record
from bt_dualarm.runtime import interruption
from tests.commands import Ran
from tests.families import some
from tests.no_plots import BT_RUN_NO_PLOTS

HERE = Path(__file__).parent

TREE = """\
bt_dualarm: 1
name: blocked
world: {{scene: empty, time_limit: 20}}
arms:
  arm1:
    robot: ur5
    camera: {{mount: wrist, resolution: [32, 24], fps: 30}}
    tree: {{timeout: {{seconds: 0.3, child: {{blocker: {ports}}}}}}}
  arm2:
    robot: ur3
    base: {{xyz: [0, 2, 0]}}
    tree: {{wait: 10}}
"""

pytestmark = pytest.mark.usefixtures("without_plots")

NEEDS_PROC = pytest.mark.skipif(
    not Path("/proc/self/stat").exists(), reason="who sleeps is told by /proc"
)

BUDGET_S = 0.8
"""Budget of a tick, s. Ticks that return take a few hundredths of it once all is imported."""

BUDGET_APART_S = 1.5
"""Budget in a new process, s, whose first tick took up to 0.5 s on a busy machine."""

CASES = [
    ("constructor", "sleep"),
    ("before", "spin"),
    ("step", "wait"),
    ("finally", "spin"),
    ("stream", "sleep"),
    ("camera", "spin"),
]

PROGRAM = f"""\
from bt_dualarm.runtime import interruption
interruption.STOPPING_S = 0.5
{BT_RUN_NO_PLOTS}
"""


def arguments(folder: Path, budget: float, **ports: str) -> list[str]:
    file = folder / "blocked.yaml"
    file.write_text(TREE.format(ports=json.dumps(ports)))
    options = ("--display", "quiet", "--renderer", "ray", "--watchdog", budget)
    where = ("--skills", HERE / "skills", "--record", folder / "out")
    return [str(part) for part in (file, *options, *where)]


def run(folder: Path, capsys: pytest.CaptureFixture[str], budget: float, **ports: str) -> Ran:
    code = cli.run(arguments(folder, budget, **ports))
    return Ran(code, *capsys.readouterr(), folder / "out")


def run_apart(folder: Path, budget: float, **ports: str) -> Ran:
    """Runs in a separate process, which the run may end."""
    command = [sys.executable, "-c", PROGRAM, *arguments(folder, budget, **ports)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return Ran(done.returncode, done.stdout, done.stderr, folder / "out")


def check_record(ran: Ran) -> None:
    """Every file of the record can be read, and there is no temporary one."""
    assert not [path for path in ran.folder.iterdir() if path.name.startswith(".")]
    assert set(ran.summary["arms"]) == {"arm1", "arm2"}
    assert ran.events
    assert np.isfinite(ran.samples["tool_arm1"]).all()


@pytest.mark.slow
@pytest.mark.parametrize(("phase", "action"), some(CASES, 3))
def test_blocking_code_is_reported_and_aborted(
    phase: str, action: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ran = run(tmp_path, capsys, BUDGET_S, phase=phase, action=action)
    assert ran.code == 154
    assert signal.getitimer(signal.ITIMER_VIRTUAL) == (0.0, 0.0), "no timer is left behind"
    check_record(ran)
    assert ran.summary["ending"] == "skill code did not return in time"
    assert ran.summary["error"].startswith("arm1: timeout/blocker at blocker.py:")
    assert f"bt-run: error: {ran.summary['error']}" in ran.err
    assert ran.summary["at_rest"]
    leaf, other = (ran.summary["arms"][arm]["leaves"][0] for arm in ("arm1", "arm2"))
    assert (other["status"], other["code"]) == ("INVALID", "HALTED")
    if phase in ("constructor", "before", "step"):
        assert (leaf["status"], leaf["code"]) == ("FAILURE", "OVERRUN")
        assert "blocker.py:" in leaf["reason"]
    else:
        assert (leaf["status"], leaf["code"]) == ("INVALID", "HALTED")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("signals", "phase", "code"),
    some(
        [
            ("SIGINT", "step", 130),
            ("SIGTERM", "finally", 143),
            ("SIGHUP", "constructor", 129),
            ("SIGTERM SIGINT", "before", 143),
        ],
        3,
    ),
)
def test_blocking_code_is_aborted_sooner_after_a_stop_signal(
    signals: str,
    phase: str,
    code: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    request: pytest.FixtureRequest,
) -> None:
    """No budget of the run is needed; a second signal aborts at once."""
    request.addfinalizer(partial(signal.signal, signal.SIGHUP, signal.getsignal(signal.SIGHUP)))
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # under nohup it would stay ignored
    monkeypatch.setattr(interruption, "STOPPING_S", 1e6 if " " in signals else 0.5)
    ran = run(tmp_path, capsys, 0, phase=phase, action="spin", signals=signals)
    assert ran.code == code
    check_record(ran)
    assert ran.summary["ending"] == "a stop was requested"
    assert "blocker.py:" in ran.summary["error"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("action", "signals", "code"),
    [("swallow", "", 154), ("deadlock", "SIGTERM SIGINT", 143)],
)
def test_uninterruptible_code_ends_the_run_with_the_record_so_far(
    action: str, signals: str, code: int, tmp_path: Path
) -> None:
    ran = run_apart(tmp_path, 0 if signals else BUDGET_APART_S, action=action, signals=signals)
    assert ran.code == code, ran.err
    assert "arm1: timeout/blocker at blocker.py:" in ran.err
    assert "and cannot be interrupted" in ran.err
    check_record(ran)
    assert not ran.summary["at_rest"]
    assert ran.summary["arms"]["arm1"]["leaves"][0]["status"] == "RUNNING"


@pytest.mark.slow
@pytest.mark.parametrize(
    "action",
    some(
        [
            "hold the lock of Python",
            "a huge power",
            "a huge regular expression",
            pytest.param("a foreign call", marks=NEEDS_PROC),
        ],
        3,
    ),
)
def test_code_that_holds_the_gil_ends_the_run_with_the_record_so_far(
    action: str, tmp_path: Path
) -> None:
    """No Python thread runs any more, whether the code computes or sleeps."""
    ran = run_apart(tmp_path, BUDGET_APART_S, action=action)
    assert ran.code == 154, ran.err
    assert 'blocker.py", line' in ran.err
    assert "bt-run: error: arm1: timeout/blocker at blocker.py:" in ran.err
    check_record(ran)
    assert ran.summary["ending"] == "skill code did not return in time"
    assert ran.summary["arms"]["arm1"]["leaves"][0]["status"] == "RUNNING"
    history = Record.read(ran.folder)
    assert history.until == pytest.approx(ran.summary["sim_time_s"], abs=0.021), (
        "the record is complete"
    )


def test_skill_cannot_end_the_process(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An exit with the code of SUCCESS makes the leaf fail."""
    ran = run(tmp_path, capsys, BUDGET_S, action="leave", phase="step")
    assert ran.code == 1
    check_record(ran)
    leaf = ran.summary["arms"]["arm1"]["leaves"][0]
    assert leaf["code"] == "EXCEPTION"
    assert leaf["reason"].startswith("SystemExit: os._exit(0) (a skill cannot end the program")
