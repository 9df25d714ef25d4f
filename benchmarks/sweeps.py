"""Sweeps under random kills on several engines, and the overhead of a trial over its run.

python -m benchmarks.sweeps --trials 40                 # the same table, whatever is killed
python -m benchmarks.sweeps --trials 40 --cost          # also efficiency and overhead
python -m benchmarks.sweeps --rows 100000               # a report over many rows
"""

from __future__ import annotations

import argparse
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

import bt_dualarm as bt
from bt_dualarm.experiments.trials import usable_cores
from bt_dualarm.sweeps.api import merge
from bt_dualarm.sweeps.manifest import Manifest, checked, values_of
from bt_dualarm.sweeps.report import write_report
from bt_dualarm.sweeps.table import read_rows, table_of
from bt_dualarm.sweeps.trial import TrialJob, run_trial


def main() -> None:
    """Parse the options and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--tree", default="circle")
    parser.add_argument("--trials", type=int, default=40)
    parser.add_argument("--kill-every", type=float, default=2.0, help="mean wall-clock s (2)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--dask", action="store_true", help="also on a Dask cluster of two workers")
    parser.add_argument("--cost", action="store_true", help="measure efficiency and overhead")
    parser.add_argument("--rows", type=int, default=0, help="only write a report of generated rows")
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
    print(f"{trials} trials of {tree}", flush=True)
    hashes: list[tuple[str, str]] = []

    def report(label: str, value: str, began: float) -> None:
        hashes.append((value, label))
        print(f"  {value}  {label} ({time.monotonic() - began:.0f} s)", flush=True)

    began = time.monotonic()
    report("undisturbed", _finish(_command(tree, trials, scratch / "plain")), began)
    began = time.monotonic()
    report(*_run_with_kills(tree, trials, scratch / "killed", arguments.kill_every, rng), began)
    parts = [scratch / "part1", scratch / "part2"]
    began = time.monotonic()
    for number, part in enumerate(parts, 1):
        _finish(_command(tree, trials, part, "--shard", f"{number}/2"))
    report("two shards, merged", merge(parts, scratch / "merged").sha256[:16], began)
    if arguments.dask:
        began = time.monotonic()
        with _Cluster(2) as cluster:
            report(
                *_run_with_kills(
                    tree, trials, scratch / "dask", arguments.kill_every, rng, cluster
                ),
                began,
            )
    print("all equal" if len({value for value, _ in hashes}) == 1 else "DIFFERENT")


class _Cluster:
    """A Dask scheduler and workers, each under a nanny, which are replaced when killed.

    Args:
        count: Number of workers.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.address = f"tcp://127.0.0.1:{probe.getsockname()[1]}"
        self._processes: list[subprocess.Popen[bytes]] = []

    def __enter__(self) -> _Cluster:
        port = self.address.rpartition(":")[2]
        self._processes = [
            _start("scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard")
        ]
        self.replace()
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._processes:
            process.kill()
            for child in _descendants(process.pid):
                with suppress(ProcessLookupError):
                    os.kill(child, signal.SIGKILL)
        for process in self._processes:
            process.wait()

    def replace(self) -> None:
        """Start the missing workers, as a supervisor does."""
        scheduler, *nannies = self._processes
        living = [one for one in nannies if one.poll() is None]
        missing = self._count - len(living)
        more = [
            _start("worker", self.address, "--nthreads", "1", "--no-dashboard")
            for _ in range(missing)
        ]
        self._processes = [scheduler, *living, *more]

    def victims(self) -> dict[str, list[int]]:
        """Process ids by the kind of process."""
        nannies = [one.pid for one in self._processes[1:] if one.poll() is None]
        below = [pid for nanny in nannies for pid in _descendants(nanny)]
        trials = [pid for pid in below if "sweeps.worker" in _line_of(pid)]
        workers = [pid for pid in below if "spawn_main" in _line_of(pid)]
        return {"trials": trials, "workers": workers, "nannies": nannies}


def _start(*words: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "distributed.cli.dask_" + words[0], *words[1:]]
    quiet = subprocess.DEVNULL
    return subprocess.Popen(command, stdout=quiet, stderr=quiet, start_new_session=True)


def _run_with_kills(
    tree: str,
    trials: int,
    out: Path,
    kill_every: float,
    rng: np.random.Generator,
    cluster: _Cluster | None = None,
) -> tuple[str, str]:
    """Run a sweep while random processes are killed; returns what was killed, and the hash."""
    more = () if cluster is None else ("--dask", cluster.address)
    killed: Counter[str] = Counter()
    while True:
        client = subprocess.Popen(
            _command(tree, trials, out, *more),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        while client.poll() is None:
            time.sleep(float(rng.exponential(kill_every)))
            if cluster is not None:
                cluster.replace()
            if rng.random() < 0.1:
                client.kill()
                killed["clients"] += 1
                continue
            victims = (
                {"workers": _descendants(client.pid)} if cluster is None else cluster.victims()
            )
            kind = str(rng.choice(sorted(victims)))
            if victims[kind]:
                with suppress(ProcessLookupError):
                    os.kill(int(rng.choice(victims[kind])), signal.SIGKILL)
                    killed[kind] += 1
        output, errors = client.communicate()
        # A client that was killed or has given up is started again, as a user would.
        if client.returncode == 0:
            break
        if client.returncode > 0:
            killed["clients that gave up"] += 1
            print(f"  exit code {client.returncode}: {errors.strip()[-300:]}", flush=True)
    table = read_rows([out])
    crashed = 0 if table is None else table["outcome"].to_pylist().count("CRASHED")
    # A trial whose worker was killed three times has no result, and the table differs.
    parts = [f"{count} {name}" for name, count in sorted(killed.items())]
    where = "killed" if cluster is None else "killed on a Dask cluster"
    return f"{', '.join(parts)} {where}, {crashed} trials without a result", _hash(output)


def _finish(command: Sequence[str]) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"exit code {done.returncode}: {done.stderr}")
    return _hash(done.stdout)


def _hash(output: str) -> str:
    return next(
        line.rpartition(" ")[2] for line in output.splitlines() if line.startswith("hash of all")
    )


def _descendants(pid: int) -> list[int]:
    """Process ids of the children of all threads of a process, and of theirs."""
    found: list[int] = []
    waiting = [pid]
    while waiting:
        for path in Path(f"/proc/{waiting.pop()}/task").glob("*/children"):
            with suppress(OSError):
                below = [int(word) for word in path.read_text().split()]
                found += below
                waiting += below
    return found


def _line_of(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ")
    except OSError:
        return ""


def _cost(tree: str, trials: int, scratch: Path) -> None:
    """Print the CPU time of a trial relative to its run, and the speed-up by workers."""
    manifest = checked(Manifest(tree, tuple(range(trials))))
    jobs = [
        TrialJob(manifest.tree, None, (), trial, None, None, "none", scratch / "records")
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
    """Print the time of a report over generated rows."""
    rng = np.random.default_rng(0)
    manifest = checked(
        Manifest("circle", tuple(range(rows // 25)), {
            "speed": values_of("0.2:1.0:5"), "radius": values_of("0.05:0.15:5"),
        })
    )  # fmt: skip
    generated = []
    for trial in manifest.trials():
        works = rng.random() > 0.1 * float(str(trial.params["speed"]))
        generated.append(
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
    table = table_of(generated)
    began = time.perf_counter()
    cpu = time.process_time()
    write_report(scratch, table, "circle")
    print(
        f"report over {len(table)} rows: {time.perf_counter() - began:.1f} s, "
        f"{time.process_time() - cpu:.1f} s of CPU"
    )


if __name__ == "__main__":
    main()
