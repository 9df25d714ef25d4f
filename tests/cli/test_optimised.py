"""Trees run the same in Python with optimizations, which strip assertions and docstrings."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from bt_dualarm.runtime.kernels import compile_kernels
from tests.commands import BtRun
from tests.families import WHOLE

TREE = """
bt_dualarm: 1
world: {scene: empty, seed: 3}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 0, 0.4]}
    tree:
      sequence:
        - reach_to_pose: {offset: {xyz: [0.02, 0, 0.02]}}
        - circle: {radius: 0.03, speed: 1.0}
"""


@pytest.mark.skipif(not WHOLE, reason="compiles all modules again: part of `make matrix`")
def test_python_without_docstrings_runs_the_same(tmp_path: Path, bt_run_here: BtRun) -> None:
    """The states are equal, no skill is refused for a stripped docstring, no kernel is compiled."""
    (tmp_path / "tree.yaml").write_text(TREE)
    compile_kernels()
    plain = bt_run_here(tmp_path / "tree.yaml")
    assert (plain.code, plain.err) == (0, "")
    folder = tmp_path / "stripped"
    command = [sys.executable, "-OO", "-m", "bt_dualarm", str(tmp_path / "tree.yaml")]
    done = subprocess.run(
        [*command, "--display", "quiet", "--record", str(folder)],
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stderr) == (0, "")
    stripped = json.loads((folder / "summary.json").read_text())
    assert stripped["state_sha256"] == plain.summary["state_sha256"]
