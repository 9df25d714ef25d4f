"""Time of ``bt-run`` to its first tick: python benchmarks/start.py [TREE].

Measures the time from the start of the process to the line that reports the first running leaf, and
the CPU time of the whole process, which depends less on the load of the machine. The first run
warms the caches (compiled Python, hulls of meshes) and does not count.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

RUNS = 10


def seconds(tree: str, environment: dict[str, str]) -> tuple[float, float]:
    """Time from the start of one process to its first line, and its CPU time, s."""
    program = Path(sys.executable).with_name("bt-run")
    command = [str(program), tree, "--duration", "0.1", "--display", "log"]
    before = cpu_of_children()
    began = time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment, text=True) as process:
        assert process.stdout is not None  # noqa: S101 - for the type checker
        line = process.stdout.readline()
        took = time.perf_counter() - began
        process.stdout.read()
    if "RUNNING" not in line:
        raise SystemExit(f"the first line of {' '.join(command)} was {line!r}")
    return took, cpu_of_children() - before


def cpu_of_children() -> float:
    """CPU time of all child processes that have ended, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main(tree: str) -> None:
    """Print the fastest, the median and the slowest run."""
    with tempfile.TemporaryDirectory() as folder:  # so that Python can write byte code
        environment = os.environ | {"PYTHONPYCACHEPREFIX": folder}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
        runs = [seconds(tree, environment) for _ in range(RUNS + 1)][1:]
    taken, cpu = (sorted(times) for times in zip(*runs, strict=True))
    print(
        f"{tree}: first tick after {taken[0]:.2f} s, median {taken[RUNS // 2]:.2f} s, "
        f"slowest of {RUNS} {taken[-1]:.2f} s; CPU median {cpu[RUNS // 2]:.2f} s"
    )


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "reach_to_pose")
