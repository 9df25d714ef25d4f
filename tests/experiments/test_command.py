"""``bt-experiments`` as it is typed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bt_dualarm.experiments.command import main


@pytest.mark.slow
def test_one_cell_writes_its_numbers(tmp_path: Path) -> None:
    """The hardest circle by prediction: below 1 mm RMS, nothing lost, no report unasked."""
    file = tmp_path / "cell.json"
    arguments = "--case circle --speed 1.0 --controller predictive --fps 60 --seeds 1"
    assert main([*arguments.split(), "--json", str(file)]) == 0
    content = json.loads(file.read_text(encoding="utf-8"))
    assert content["renderer"] == "ray", "on every machine, so that numbers agree"
    assert content["outcome"] == ["SUCCESS"]
    assert content["yz_rms_m"][0] < 1e-3
    assert content["yz_max_m"][0] < 3e-3
    assert content["lost_count"] == [0]
    assert [path.name for path in tmp_path.iterdir()] == ["cell.json"]


def test_a_curve_that_is_not_there_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--case", "drawn", "--renderer", "ray"]) == 2
    assert "see --untuned" in capsys.readouterr().err


def test_settings_that_the_file_refuses_are_said(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--case", "circle", "--speed", "7", "--renderer", "ray"]) == 2
    assert "speed" in capsys.readouterr().err
