"""Sweeps under random kills, on several engines, and what a trial costs beside its run.

python -m benchmarks.sweeps --trials 40                 # the same table whatever is killed
python -m benchmarks.sweeps --trials 40 --cost          # and efficiency and overhead
python -m benchmarks.sweeps --rows 100000               # a report over many rows
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import bt_dualarm as bt
from bt_dualarm.experiments.trials import usable_cores
from bt_dualarm.sweeps.api import merge
from bt_dualarm.sweeps.manifest import Manifest, checked, values_of
from bt_dualarm.sweeps.report import write_report
from bt_dualarm.sweeps.table import read_rows, table_of
from bt_dualarm.sweeps.trial import Job, run_trial


def main() -> None:
    """Read the arguments, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--tree", default="circle")
    parser.add_argument("--trials", type=int, default=40)
    parser.add_argument("--kill-every", type=float, default=2.0, help="mean wall-clock s (2)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--dask", action="store_true", help="also on two Dask workers")
    parser.add_argument("--cost", action="store_true", help="measure efficiency and overhead")
    parser.add_argument("--rows", type=int, default=0, help="only write a report of made-up rows")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="sweeps_") as scratch:
        if arguments.rows:
            _report(arguments.rows, Path(scratch))
            return
        _kills(arguments, Path(scratch))
        if arguments.cost:
            _cost(arguments.tree, arguments.trials, Path(scratch))


def _command(tree: str, trials: int, out: Path, *more: str) -> list[str]:
    program = "import sys; from bt_dualarm.cli import sweep; sys.exit(sweep())"
    given = [tree, "--seeds", f"0:{trials}", "--out", str(out), "--quiet", *more]
    return [sys.executable, "-c", program, *given]


def _kills(arguments: argparse.Namespace, scratch: Path) -> None:
    """Run the same sweep undisturbed and disturbed, and compare the hashes of the tables."""
    rng = np.random.default_rng(arguments.seed)
    tree, trials = arguments.tree, arguments.trials
    print(f"{trials} trials of {tree}")
    hashes = {"undisturbed": _finished(_command(tree, trials, scratch / "plain"))}
    out = scratch / "killed"
    workers = clients = 0
    while True:
        client = subprocess.Popen(
            _command(tree, trials, out), stdout=subprocess.PIPE, text=True, start_new_session=True
        )
        while client.poll() is None:
            time.sleep(float(rng.exponential(arguments.kill_every)))
            victims = _workers_of(client.pid)
            if rng.random() < 0.1:
                client.kill()
                clients += 1
            elif victims:
                os.kill(int(rng.choice(victims)), signal.SIGKILL)
                workers += 1
        said = client.communicate()[0]
        if client.returncode >= 0:
            break
    table = read_rows([out])
    crashed = 0 if table is None else table["outcome"].to_pylist().count("CRASHED")
    # A trial whose worker was killed three times has no result, and the table is another one.
    name = f"{workers} workers and {clients} clients killed, {crashed} trials three times"
    hashes[name] = _hash(said)
    parts = [scratch / "part1", scratch / "part2"]
    for number, part in enumerate(parts, 1):
        _finished(_command(tree, trials, part, "--shard", f"{number}/2"))
    hashes["two shards, merged"] = merge(parts, scratch / "merged").sha256[:16]
    if arguments.dask:
        hashes["Dask, two workers"] = _finished(
            _command(tree, trials, scratch / "dask", "--dask", "local:2")
        )
    for name, value in hashes.items():
        print(f"  {value}  {name}")
    print("all equal" if len(set(hashes.values())) == 1 else "DIFFERENT")


def _finished(command: Sequence[str]) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"exit code {done.returncode}: {done.stderr}")
    return _hash(done.stdout)


def _hash(said: str) -> str:
    return next(
        line.rpartition(" ")[2] for line in said.splitlines() if line.startswith("hash of all")
    )


def _workers_of(pid: int) -> list[int]:
    try:
        text = Path(f"/proc/{pid}/task/{pid}/children").read_text()
    except OSError:
        return []
    return [int(word) for word in text.split()]


def _cost(tree: str, trials: int, scratch: Path) -> None:
    """CPU of a trial beside its run, and the speed-up by a worker per core."""
    manifest = checked(Manifest(tree, tuple(range(trials))))
    jobs = [
        Job(manifest.tree, None, (), trial, None, None, "none", scratch / "records")
        for trial in manifest.trials()
    ]
    run_trial(jobs[0])
    with bt.open(tree, seed=0) as run:
        run.finish()
    began = time.process_time()
    for trial in range(1, min(trials, 10)):
        bt.run(tree, seed=trial)
    alone = time.process_time() - began
    began = time.process_time()
    for job in jobs[1:10]:
        run_trial(job)
    print(f"CPU of a trial over that of bt.run: {(time.process_time() - began) / alone:.3f}")
    walls = {}
    for workers in (1, usable_cores()):
        began = time.perf_counter()
        result = bt.sweep(tree, out=scratch / f"jobs{workers}", seeds=trials, jobs=workers)
        walls[workers] = time.perf_counter() - began
        cpu = sum(result.table["cpu_s"].to_pylist())
        print(
            f"{workers} workers: {walls[workers]:.1f} s, {cpu:.1f} s of CPU in trials, "
            f"efficiency {cpu / workers / walls[workers]:.2f}"
        )


def _report(rows: int, scratch: Path) -> None:
    """Time of a report over made-up rows."""
    rng = np.random.default_rng(0)
    manifest = checked(
        Manifest("circle", tuple(range(rows // 25)), {
            "speed": values_of("0.2:1.0:5"), "radius": values_of("0.05:0.15:5"),
        })
    )  # fmt: skip
    made = []
    for trial in manifest.trials():
        works = rng.random() > 0.1 * float(str(trial.params["speed"]))
        made.append(
            {
                "trial": trial.index,
                "identity": trial.identity,
                **{f"param.{name}": value for name, value in trial.params.items()},
                "seed": trial.seed,
                "reality": "",
                "outcome": "SUCCESS" if works else "FAILURE",
                "code": "" if works else "TRACKING_ERROR",
                "arm": "" if works else "arm1",
                "leaf": "" if works else "circle",
                "cause": "" if works else "TOO_FAST",
                "reason": "",
                **{f"metric.arm1.circle.m{k}_m": float(rng.normal()) for k in range(12)},
                "cpu_s": 0.4,
                "memory_mb": 300.0,
                "machine": "here",
                "processor": "kind",
            }
        )
    table = table_of(made)
    began = time.perf_counter()
    cpu = time.process_time()
    write_report(scratch, table, "circle")
    print(
        f"report over {len(table)} rows: {time.perf_counter() - began:.1f} s, "
        f"{time.process_time() - cpu:.1f} s of CPU"
    )


if __name__ == "__main__":
    main()
