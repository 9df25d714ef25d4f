"""A run killed at any moment ends in order: exit code, complete files, arms at rest.

Before the run has begun there is nothing to record. Its output shows whether it had.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tests.families import some
from tests.listening import HEEDING, STOPPING, wait_until, wait_until_it_listens
from tests.no_plots import BT_RUN_NO_PLOTS

ENDLESS = """\
bt_dualarm: 1
name: endless
world: {scene: empty, time_limit: 3600}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 0, 0.4]}
    posture: present
    tree:
      repeat:
        times: forever
        child:
          sequence:
            - reach_to_pose: {offset: {xyz: [0, 0.05, 0]}}
            - reach_to_pose: {offset: {xyz: [0, -0.05, 0]}}
"""

PROGRAM = f"{HEEDING}import bt_dualarm.cli as cli, sys; sys.exit(cli.run())"
UNDRAWN = f"{HEEDING}{BT_RUN_NO_PLOTS}"

RNG = np.random.default_rng(5)
EARLY = [(STOPPING[n % 3], float(seconds)) for n, seconds in enumerate(RNG.uniform(0, 1.5, 6))]
"""Signal, and time in s after the program handles signals: it then imports, builds or runs."""
LATE = [(STOPPING[n % 3], int(lines)) for n, lines in enumerate(RNG.integers(1, 60, 6))]
"""Signal, and number of lines that the run has printed before it, one per status change."""


def begun(folder: Path, program: str = UNDRAWN) -> subprocess.Popen[str]:
    (folder / "endless.yaml").write_text(ENDLESS)
    command = [sys.executable, "-c", program, str(folder / "endless.yaml")]
    options = ["--display", "log", "--record", str(folder / "out")]
    return subprocess.Popen(
        [*command, *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def read_lines(process: subprocess.Popen[str], lines: int) -> None:
    """Waits until the process has printed a number of lines."""
    assert process.stdout is not None
    for _ in range(lines):
        assert "arm1" in process.stdout.readline()


def check_record(folder: Path) -> None:
    """All data files of the record are complete, and there is no temporary one."""
    assert not [path for path in folder.iterdir() if path.name.startswith(".")]
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["outcome"], summary["at_rest"]) == ("UNFINISHED", True)
    for line in (folder / "events.jsonl").read_text().splitlines():
        json.loads(line)
    samples = np.load(folder / "samples.npz")
    if len(samples["time"]) > 1:
        last = samples["tool_arm1"][-2:]
        assert np.linalg.norm(last[1] - last[0]) < 2e-4, "the tool is at rest: below 20 mm/s"


@pytest.mark.slow
@pytest.mark.parametrize(("number", "seconds"), some(EARLY, 4))
def test_run_killed_while_it_starts_has_a_complete_record_or_none(
    tmp_path: Path, number: signal.Signals, seconds: float
) -> None:
    """There is no record if no leaf has begun, and otherwise a complete one."""
    with begun(tmp_path) as process:
        wait_until_it_listens(process)
        time.sleep(seconds)
        process.send_signal(number)
        out, err = process.communicate()
    assert process.returncode == 128 + number
    assert "Traceback" not in err
    if "RUNNING" in out or (tmp_path / "out" / "summary.json").exists():
        check_record(tmp_path / "out")
    else:
        assert not list(tmp_path.glob("out/*"))


@pytest.mark.slow
@pytest.mark.parametrize(("number", "lines"), some(LATE, 5))
def test_run_killed_while_it_runs_has_a_complete_record(
    tmp_path: Path, number: signal.Signals, lines: int
) -> None:
    with begun(tmp_path) as process:
        read_lines(process, lines)
        process.send_signal(number)
        out, err = process.communicate()
    assert process.returncode == 128 + number
    assert "UNFINISHED" in out
    assert "Traceback" not in err
    check_record(tmp_path / "out")


@pytest.mark.slow
@pytest.mark.parametrize("number", some(STOPPING, 3))
def test_run_killed_while_it_writes_completes_its_record(
    tmp_path: Path, number: signal.Signals
) -> None:
    """The second signal skips the plots; the first one determines the exit code."""
    with begun(tmp_path, PROGRAM) as process:
        read_lines(process, 5)
        process.send_signal(number)
        wait_until(process, (tmp_path / "out" / "samples.npz").exists)
        process.send_signal(signal.SIGTERM)
        process.communicate()
    assert process.returncode == 128 + number
    check_record(tmp_path / "out")


@pytest.mark.slow
def test_run_killed_by_sigkill_leaves_its_events_and_samples(tmp_path: Path) -> None:
    """Every event so far is in the record, line by line; there is no summary."""
    with begun(tmp_path) as process:
        read_lines(process, 20)
        process.kill()
        process.communicate()
    lines = (tmp_path / "out" / "events.jsonl").read_text().splitlines()
    events = [json.loads(line) for line in lines]
    assert len(events) >= 10, "all printed events are there, one per line of the display"
    assert {event["arm"] for event in events} == {"arm1"}
    assert not (tmp_path / "out" / "summary.json").exists()
    parts = tmp_path / "out" / "samples.parts"
    time = np.load(parts / "time.npy")
    tool = np.load(parts / "tool_arm1.npy")
    assert len(time) >= 200, "all but the last two seconds"
    assert tool.shape == (len(time), 3)
    assert not np.isnan(tool).any()
