"""A run that is killed at any moment ends in order: exit code, whole files, arms at rest."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

ENDLESS = """\
bt_dualarm: 1
name: endless
world: {scene: empty}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 0, 0.4]}
    posture: present
    tree: {repeat: {times: forever, child: {circle: {plane: yz, radius: 0.1, turns: 100}}}}
"""

PROGRAM = "import bt_dualarm.cli as cli, sys; print('begun', flush=True); sys.exit(cli.run())"

MOMENTS = [int(moment) for moment in np.random.default_rng(5).integers(10, 4000, 10)]
"""Milliseconds after the start of the program: while it builds, runs, and in between."""


@pytest.mark.slow
@pytest.mark.parametrize(("number", "milliseconds"), list(enumerate(MOMENTS)))
def test_killed_at_any_moment(tmp_path: Path, number: int, milliseconds: int) -> None:
    kind = signal.SIGINT if number % 2 else signal.SIGTERM
    (tmp_path / "endless.yaml").write_text(ENDLESS)
    out = tmp_path / "out"
    command = [sys.executable, "-c", PROGRAM, str(tmp_path / "endless.yaml")]
    with subprocess.Popen(
        [*command, "--display", "log", "--record", str(out)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "begun\n"
        time.sleep(0.05 + milliseconds / 1000)
        process.send_signal(kind)
        rest = process.communicate(timeout=120)[0]
    assert process.returncode == 128 + kind
    assert "UNFINISHED" in rest
    assert not [path for path in out.iterdir() if path.name.startswith(".")]
    summary = json.loads((out / "summary.json").read_text())
    assert summary["outcome"] == "UNFINISHED"
    for line in (out / "events.jsonl").read_text().splitlines():
        json.loads(line)
    samples = np.load(out / "samples.npz")
    if len(samples["time"]) > 1:
        last = samples["tool_arm1"][-2:]
        assert np.linalg.norm(last[1] - last[0]) < 2e-4, "the tool stands still: below 20 mm/s"
