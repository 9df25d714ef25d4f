"""Sweeps on a persistent Dask cluster give the same rows although workers and clients die."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

import bt_dualarm as bt
from bt_dualarm.sweeps.table import read_rows

SKILL = '''
import multiprocessing, os, signal
from pathlib import Path
from bt_dualarm import PortModel, Skill, Ticks, port

class Preempt(Skill):
    """Start a process, as planning does; and kill the worker of the cluster, once."""

    class Ports(PortModel):
        once: str = port(..., "file that exists once it has been killed")

    example = "preempt: {once: /tmp/killed}"
    ports: Ports

    def run(self) -> Ticks:
        child = multiprocessing.get_context("fork").Process(target=int)
        child.start()  # a daemonic process, as Dask's workers are, may have no children
        child.join()
        once = Path(self.ports.once)
        if not once.exists():
            once.touch()
            os.kill(os.getppid(), signal.SIGKILL)
        yield
'''

TREE = """
bt_dualarm: 1
name: preempted
world: {scene: empty, reality: lab}
arms:
  arm1: {robot: ur5, tree: {sequence: [PREEMPT, {wait: {seconds: 0.2}}]}}
"""

# Not by `importorskip`: every process that collects these tests would import Dask, for a second.
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(find_spec("distributed") is None, reason="Dask is not installed"),
]


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """A cluster whose scheduler gives up a task after the first death of its worker."""
    distributed: Any = import_module("distributed")
    dask: Any = import_module("dask")
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0", silence_logs=50
        ) as cluster,
    ):
        yield str(cluster.scheduler_address)


def test_killed_worker_loses_no_trial_and_trials_may_fork(address: str, tmp_path: Path) -> None:
    skills = tmp_path / "skills"
    skills.mkdir()
    (skills / "preempt.py").write_text(SKILL)
    tree = TREE.replace("PREEMPT", f"{{preempt: {{once: {tmp_path / 'killed'}}}}}")
    given: dict[str, Any] = {"seeds": 3, "skills": [skills]}
    on_cluster = bt.sweep(tree, out=tmp_path / "there", dask=address, **given)
    assert (tmp_path / "killed").exists()
    assert on_cluster.table["outcome"].to_pylist() == ["SUCCESS"] * 3
    locally = bt.sweep(tree, out=tmp_path / "here", jobs=1, **given)
    assert on_cluster.sha256 == locally.sha256


def test_persistent_cluster_reads_a_changed_tree_again(address: str, tmp_path: Path) -> None:
    file = tmp_path / "tree.yaml"
    ends = []
    for seconds in (0.2, 0.4):
        file.write_text(TREE.replace("PREEMPT, ", "").replace("0.2", str(seconds)))
        result = bt.sweep(file, out=tmp_path / "out", seeds=1, dask=address)
        (row,) = result.table.to_pylist()
        ends.append(row["sim_time_s"])
    assert ends[1] - ends[0] == pytest.approx(0.2, abs=0.05)


def test_killed_client_loses_no_finished_trial(address: str, tmp_path: Path) -> None:
    tree = tmp_path / "tree.yaml"
    tree.write_text(TREE.replace("PREEMPT, ", ""))
    program = "import sys; from bt_dualarm.cli import sweep; sys.exit(sweep())"
    given = [str(tree), "--seeds", "0:6", "--dask", address, "--out", str(tmp_path / "out")]
    client = subprocess.Popen([sys.executable, "-c", program, *given])
    until = time.monotonic() + 300.0
    while not [*(tmp_path / "out" / "rows").glob("*.parquet")] and time.monotonic() < until:
        time.sleep(0.05)
    os.kill(client.pid, signal.SIGKILL)
    client.wait()
    kept = read_rows([tmp_path / "out"])
    assert kept is not None
    again = bt.sweep(tree, out=tmp_path / "out", seeds=6, dask=address)
    assert again.progress.known == len(kept)
    whole = bt.sweep(tree, out=tmp_path / "whole", seeds=6, jobs=1)
    assert again.sha256 == whole.sha256
