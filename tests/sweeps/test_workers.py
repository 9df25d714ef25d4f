"""Trials in worker processes that die, print, and exit, and the command for sweeps."""

from __future__ import annotations

from pathlib import Path

import pytest

import bt_dualarm as bt
from bt_dualarm.cli import compare, sweep
from bt_dualarm.sweeps.manifest import Manifest, SweepError, checked
from bt_dualarm.sweeps.trial import TrialJob, run_trial

SKILL = '''
import os, signal, sys
from pathlib import Path
from bt_dualarm import PortModel, Skill, Ticks, port

class Die(Skill):
    """Kill the process that ticks it, a number of times."""

    class Ports(PortModel):
        times: int = port(..., "how often", ge=0)
        folder: str = port(..., "where the deaths are counted")

    example = "die: {times: 0, folder: /tmp}"
    ports: Ports

    def run(self) -> Ticks:
        print("noise on standard output")
        deaths = Path(self.ports.folder) / f"deaths_{self.ports.times}"
        before = len(deaths.read_text()) if deaths.exists() else 0
        if before < self.ports.times:
            deaths.write_text("x" * (before + 1))
            if before == 2:
                print("the driver cannot be loaded", file=sys.stderr, flush=True)
                os._exit(7)
            os.kill(os.getpid(), signal.SIGKILL)
        yield
'''

TREE = """
bt_dualarm: 1
name: dying
params: {times: {type: integer, default: 0}, folder: {type: text}}
world: {scene: empty}
arms:
  arm1: {robot: ur5, tree: {sequence: [{die: {times: "{times}", folder: "{folder}"}}, {wait: 0.1}]}}
"""


@pytest.mark.slow
def test_dead_worker_costs_one_attempt_and_three_deaths_are_a_row(tmp_path: Path) -> None:
    skills = tmp_path / "skills"
    skills.mkdir()
    (skills / "die.py").write_text(SKILL)
    result = bt.sweep(
        TREE,
        out=tmp_path / "out",
        seeds=1,
        params={"times": [0, 1, 3], "folder": [str(tmp_path)]},
        jobs=1,
        skills=[skills],
    )
    rows = result.table.to_pylist()
    assert [row["outcome"] for row in rows] == ["SUCCESS", "SUCCESS", "CRASHED"]
    assert [row["attempts"] for row in rows] == [1, 2, 3]
    assert rows[2]["code"] == "WORKER_DIED"
    assert rows[2]["reason"].endswith("ended with exit code 7: the driver cannot be loaded")
    assert rows[0]["state_sha256"] == rows[1]["state_sha256"] != ""
    assert result.progress.retried == 2
    assert "WORKER_DIED" in (tmp_path / "out" / "report.md").read_text()


@pytest.mark.slow
def test_dask_gives_the_same_rows(tmp_path: Path) -> None:
    """Trials run in children of Dask's workers."""
    pytest.importorskip("distributed")
    trials = {"params": {"speed": [0.5, 1.0]}, "seeds": 1, "reality": "lab", "audit": 1.0}
    on_cluster = bt.sweep("circle", out=tmp_path / "dask", dask="local:2", **trials)  # type: ignore[arg-type]
    locally = bt.sweep("circle", out=tmp_path / "here", jobs=1, **trials)  # type: ignore[arg-type]
    assert on_cluster.sha256 == locally.sha256
    assert on_cluster.progress.audited == locally.progress.audited == 2


def test_missing_scheduler_is_an_error(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    for address in ("local:none", "local:0", "local:1025", "here", "tcp://host", "tcp://host:x"):
        with pytest.raises(SweepError, match=r"no Dask cluster: tcp:.*local:N"):
            bt.sweep("circle", out=tmp_path / "a", dask=address)
    with pytest.raises(SweepError, match="mutually exclusive"):
        bt.sweep("circle", out=tmp_path / "a", dask="local:2", jobs=2)


@pytest.mark.slow
def test_command_reports_and_resumes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tree = tmp_path / "tree.yaml"
    tree.write_text(
        "bt_dualarm: 1\nname: t\nparams: {x: {type: number, default: 0.3}}\nworld: {scene: empty}\n"
        "arms: {arm1: {robot: ur5, tree: {reach_to_pose: {offset: {xyz: [0, 0, '{x}']}}}}}\n"
    )
    out = tmp_path / "out"
    arguments = [str(tree), "--param", "x=0.02,1.5", "--seeds", "0:1", "--jobs", "1"]
    assert sweep([*arguments, "--out", str(out)]) == 0
    output = capsys.readouterr()
    assert "2 trials: 50.0 %" in output.out
    assert "INVALID_TARGET arm1 reach_to_pose [x 1.5]" in output.out
    assert "2/2" in output.err
    records = [*(out / "records").iterdir()]
    assert len(records) == 1  # only that of the failure
    # Every trial has a row: the second call starts no process.
    assert sweep([*arguments, "--out", str(out), "--quiet"]) == 0
    again = capsys.readouterr()
    assert again.err == ""
    assert again.out.splitlines()[-2:] == output.out.splitlines()[-2:]
    assert compare([str(out), str(out)]) == 0
    assert "success: EQUAL" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["circle", "--seeds", "x"], "neither a seed"),
        (["circle", "--param", "sped=1"], "did you mean 'speed'"),
        (["circle", "--reality", "labb"], "did you mean 'lab'"),
        (["circle", "--shard", "3/2"], "not a shard"),
        (["circle", "--until", "soon"], "not a condition"),
        (["circle", "--jobs", "0"], "number of workers"),
        (["circle", "--param", "speed=1:0.5:3"], "speed: the range 1:0.5 does not rise"),
        (["circle", "--search", "3"], "one or two parameters as a range"),
        (["circel"], "no such file"),
    ],
)
def test_invalid_arguments_are_errors_before_anything_runs(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sweep([*arguments, "--out", str(tmp_path / "out")]) == 2
    assert message in capsys.readouterr().err


def test_parameter_given_twice_is_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    """Otherwise the last one would silently win."""
    with pytest.raises(SystemExit):
        sweep(["circle", "--param", "speed=0.5", "--param", "speed=1.0"])
    assert "--param speed is given twice" in capsys.readouterr().err


def test_missed_goal_is_a_false_success(tmp_path: Path) -> None:
    tree = """
bt_dualarm: 1
name: missed
world: {scene: empty}
arms: {arm1: {robot: ur5, tree: {wait: 0.1}}}
goal: {high: {tool: arm1, height: [5, 6]}, low: {tool: arm1, height: [-1, 3]}}
"""
    manifest = checked(Manifest(tree, (0,)))
    row = run_trial(TrialJob(tree, None, (), manifest.trial(0), None, None, "failures", tmp_path))
    assert (row["outcome"], row["code"], row["leaf"]) == ("FALSE_SUCCESS", "GOAL_NOT_MET", "high")
    assert (row["goal.high"], row["goal.low"]) == (False, True)
    assert (tmp_path / str(row["identity"])).is_dir()
