"""A run that is killed at any moment ends in order: exit code, whole files, arms at rest.

Before it has begun there is nothing to record. Whether it had is told by its own lines.
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
from tests.undrawn import BT_RUN_UNDRAWN

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
UNDRAWN = f"{HEEDING}{BT_RUN_UNDRAWN}"

RNG = np.random.default_rng(5)
EARLY = [(STOPPING[n % 3], float(seconds)) for n, seconds in enumerate(RNG.uniform(0, 1.5, 6))]
"""Seconds from when the program listens: while it imports and builds, or in the run."""
LATE = [(STOPPING[n % 3], int(lines)) for n, lines in enumerate(RNG.integers(1, 60, 6))]
"""Lines that the run has said: one for each change of a status."""


def begun(folder: Path, program: str = UNDRAWN) -> subprocess.Popen[str]:
    (folder / "endless.yaml").write_text(ENDLESS)
    command = [sys.executable, "-c", program, str(folder / "endless.yaml")]
    options = ["--display", "log", "--record", str(folder / "out")]
    return subprocess.Popen(
        [*command, *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def say(process: subprocess.Popen[str], lines: int) -> None:
    """Wait until it has said so many lines."""
    assert process.stdout is not None
    for _ in range(lines):
        assert "arm1" in process.stdout.readline()


def check_whole(folder: Path) -> None:
    """Everything that a program reads, and nothing that was not finished."""
    assert not [path for path in folder.iterdir() if path.name.startswith(".")]
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["outcome"], summary["at_rest"]) == ("UNFINISHED", True)
    for line in (folder / "events.jsonl").read_text().splitlines():
        json.loads(line)
    samples = np.load(folder / "samples.npz")
    if len(samples["time"]) > 1:
        last = samples["tool_arm1"][-2:]
        assert np.linalg.norm(last[1] - last[0]) < 2e-4, "the tool stands still: below 20 mm/s"


@pytest.mark.slow
@pytest.mark.parametrize(("number", "seconds"), some(EARLY, 4))
def test_killed_while_it_starts(tmp_path: Path, number: signal.Signals, seconds: float) -> None:
    """No record where no leaf has begun; else a whole one. Nothing in between."""
    with begun(tmp_path) as process:
        wait_until_it_listens(process)
        time.sleep(seconds)
        process.send_signal(number)
        said, complaint = process.communicate()
    assert process.returncode == 128 + number
    assert "Traceback" not in complaint
    if "RUNNING" in said or (tmp_path / "out" / "summary.json").exists():
        check_whole(tmp_path / "out")
    else:
        assert not list(tmp_path.glob("out/*"))


@pytest.mark.slow
@pytest.mark.parametrize(("number", "lines"), some(LATE, 5))
def test_killed_while_it_runs(tmp_path: Path, number: signal.Signals, lines: int) -> None:
    with begun(tmp_path) as process:
        say(process, lines)
        process.send_signal(number)
        said, complaint = process.communicate()
    assert process.returncode == 128 + number
    assert "UNFINISHED" in said
    assert "Traceback" not in complaint
    check_whole(tmp_path / "out")


@pytest.mark.slow
@pytest.mark.parametrize("number", some(STOPPING, 3))
def test_killed_while_it_writes(tmp_path: Path, number: signal.Signals) -> None:
    """The second signal leaves out the plots; the first one decides the code."""
    with begun(tmp_path, PROGRAM) as process:
        say(process, 5)
        process.send_signal(number)
        wait_until(process, (tmp_path / "out" / "samples.npz").exists)
        process.send_signal(signal.SIGTERM)
        process.communicate()
    assert process.returncode == 128 + number
    check_whole(tmp_path / "out")


@pytest.mark.slow
def test_killed_outright_it_leaves_what_has_happened(tmp_path: Path) -> None:
    """SIGKILL: every event so far, line by line; no summary says that there was an end."""
    with begun(tmp_path) as process:
        say(process, 20)
        process.kill()
        process.communicate()
    lines = (tmp_path / "out" / "events.jsonl").read_text().splitlines()
    events = [json.loads(line) for line in lines]
    assert len(events) >= 10, "what it had said is there; a line of the display is one of these"
    assert {event["arm"] for event in events} == {"arm1"}
    assert not (tmp_path / "out" / "summary.json").exists()
    parts = tmp_path / "out" / "samples.parts"
    time = np.load(parts / "time.npy")
    tool = np.load(parts / "tool_arm1.npy")
    assert len(time) >= 200, "all but the last two seconds"
    assert tool.shape == (len(time), 3)
    assert not np.isnan(tool).any()
