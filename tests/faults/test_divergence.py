"""A simulation that diverges to NaN ends the run within one step and keeps the evidence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.commands import BtRun

HERE = Path(__file__).parent

POISONED = """\
bt_dualarm: 1
world: {scene: empty}
objects:
  stone: {shape: sphere, size: [0.03], mass: 1, pose: {xyz: [0.5, 0.5, 0.03]}}
arms:
  arm1:
    robot: ur5
    tree: {poison: {after: 0.2, into: INTO}}
  arm2:
    robot: ur3
    base: {xyz: [0, 1, 0]}
    tree: {wait: {seconds: 5}}
"""

pytestmark = pytest.mark.slow


@pytest.mark.usefixtures("without_plots")
@pytest.mark.parametrize("into", ["qpos", "qvel", "xfrc_applied"])
def test_divergence_is_reported_and_its_states_are_kept(
    into: str, bt_run_here: BtRun, tmp_path: Path
) -> None:
    """Exit code 1, a message with the time, and the last states, finite but for the very last."""
    file = tmp_path / "poisoned.yaml"
    file.write_text(POISONED.replace("INTO", into), encoding="utf-8")
    ran = bt_run_here(file, "--skills", HERE / "skills")
    assert ran.code == 1
    assert "the simulation diverged at 0.2" in ran.err
    assert "divergence.npz" in ran.err
    assert "Traceback" not in ran.err
    assert ran.summary["outcome"] == "UNFINISHED"
    assert ran.summary["sim_time_s"] == pytest.approx(0.2, abs=0.01)
    with np.load(ran.folder / "divergence.npz") as states:
        assert states["time"][-1] == pytest.approx(0.2, abs=0.01)
        assert np.all(np.diff(states["time"]) > 0)
        for name in ("qpos", "qvel", "ctrl"):
            assert len(states[name]) == len(states["time"])
        assert np.isfinite(states["qpos"][:-1]).all()
