"""CPU time of the process that runs a sweep per trial, by the number of workers.

    python -m benchmarks.scheduling [--workers 1 8 16 32 64] [--trial 1] [--dask]

The workers are stubs: they wait for the duration of a trial and answer with a generated row, so
that many fit on one machine. Prints the load of the parent, a model of it, and its predictions for
1,000 workers and for the number of workers at which the parent is saturated. With ``--dask`` the
scheduler, the client and the stubs share one process, whose load is an upper bound.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.optimize import nnls

from bt_dualarm.sweeps import engine as engine_module
from bt_dualarm.sweeps.engine import DaskEngine, Engine, ProcessEngine
from bt_dualarm.sweeps.job import Job, Row
from bt_dualarm.sweeps.manifest import Manifest, checked
from bt_dualarm.sweeps.sweep import run_sweep

WALL_S: Final = 20.0
"""Wall-clock seconds of each measurement."""

METRICS: Final = 40
"""Metric columns in a row, about as many as for a tree of five leaves."""

LENGTHS_S: Final = (1.0, 3.0, 10.0)
"""Durations of trials for which the largest number of workers is estimated."""

STUB: Final = """
import os, re, time
from multiprocessing.connection import Connection
requests = Connection(os.dup(0), writable=False)
answers = Connection(os.dup(1), readable=False)
while True:
    try:
        job = requests.recv_bytes()
    except EOFError:
        break
    identity = re.search(rb"[0-9a-f]{24}", job)[0].decode()
    time.sleep(%(trial)r)
    answers.send(dict(%(row)r, identity=identity))
"""
"""Program of a stub: the identity is the only text of 24 hexadecimal digits in a job."""


def synthetic_row() -> Row:
    """A row like that of a run, without its identity."""
    return {
        "trial": 0,
        "seed": 0,
        "reality": "",
        "outcome": "SUCCESS",
        "code": "",
        "arm": "",
        "leaf": "",
        "cause": "",
        "reason": "",
        "sim_time_s": 1.0,
        "state_sha256": "0" * 64,
        **{f"metric.arm1.sequence/circle.m{number}_m": 0.001 * number for number in range(METRICS)},
        "cpu_s": 0.5,
        "wall_s": 0.5,
        "memory_mb": 300.0,
        "machine": "here",
        "processor": "kind",
        "attempts": 1,
        "audited": False,
    }


def process_engine(workers: int, trial_s: float) -> Engine:
    """Engine whose worker processes are stubs."""
    engine_module._PROGRAM = STUB % {"trial": trial_s, "row": dict(synthetic_row())}  # type: ignore[misc]
    return ProcessEngine(workers)


def dask_engine(workers: int, trial_s: float) -> Engine:
    """Engine on a Dask cluster in this process, whose tasks are stubs."""
    distributed: Any = import_module("distributed")  # Any: Dask has few types

    def stub(job: Job, timeout: float | None) -> tuple[Row, str]:  # noqa: ARG001 - as `run_in_child`
        time.sleep(trial_s)
        return {**synthetic_row(), "identity": job.identity}, "stub"

    engine_module.run_in_child = stub
    cluster = distributed.LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=False,
        protocol="tcp",
        host="127.0.0.1",
        dashboard_address=None,
    )
    found: Any = DaskEngine(cluster.scheduler_address)  # Any: the cluster is attached below
    found._cluster = cluster
    return found  # type: ignore[no-any-return]


def load_of(
    workers: int, trial_s: float, start: Callable[[int, float], Engine]
) -> tuple[float, float, float]:
    """CPU share of this process, trials per second, and its peak memory in MB."""
    engine = start(workers, trial_s)
    with tempfile.TemporaryDirectory(prefix="scheduling_") as name:

        def run_trials(first: int, count: int) -> None:
            manifest = checked(Manifest("circle", tuple(range(first, first + count))))
            run_sweep(manifest, Path(name), lambda: engine, keep="none")

        # The workers start first, so that their start does not count.
        run_trials(10**6, workers)
        trials = round(workers * WALL_S / trial_s)
        began, cpu = time.perf_counter(), time.process_time()
        run_trials(0, trials)
        cpu, wall = time.process_time() - cpu, time.perf_counter() - began
        engine.close()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return cpu / wall, trials / wall, peak


def main() -> None:
    """Print the table and the predictions."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 8, 16, 32, 64])
    parser.add_argument("--trial", type=float, default=1.0, help="duration of a trial, s (1)")
    parser.add_argument("--dask", action="store_true", help="on Dask instead of processes")
    arguments = parser.parse_args()
    if len(set(arguments.workers)) < 3:
        parser.error("--workers: three costs are estimated from at least three different numbers")
    start = dask_engine if arguments.dask else process_engine
    print("| workers | trials per s | CPU of one core | ms per trial | peak memory MB |")
    print("|---|---|---|---|---|")
    loads, rates = [], []
    for workers in arguments.workers:
        load, rate, memory = load_of(workers, arguments.trial, start)
        loads.append(load)
        rates.append(rate)
        print(
            f"| {workers} | {rate:.1f} | {100 * load:.1f} % | {1e3 * load / rate:.2f} | "
            f"{memory:.0f} |",
            flush=True,
        )
    # Some work is done every second, some for each trial, and some for each trial and worker.
    terms = np.array(
        [[1.0, rate, rate * n] for rate, n in zip(rates, arguments.workers, strict=True)]
    )
    (idle, per_trial, per_trial_and_worker), _ = nnls(terms, np.array(loads))
    print(
        f"load = {100 * idle:.2f} % + {1e3 * per_trial:.2f} ms per trial + "
        f"{1e6 * per_trial_and_worker:.2f} us per trial and worker"
    )
    for length in LENGTHS_S:
        # With n workers, n / length trials per second.
        parts = [per_trial_and_worker / length, per_trial / length, idle - 1.0]
        largest = max(float(root.real) for root in np.roots(np.trim_zeros(parts, "f")))
        busy = idle + 1000 / length * (per_trial + 1000 * per_trial_and_worker)
        print(
            f"trials of {length:g} s: 1000 workers would take {100 * busy:.0f} % of a core; "
            f"saturated at about {largest:.0f} workers"
        )


if __name__ == "__main__":
    main()
