"""How long ``bt-run`` takes to its first tick: python benchmarks/start.py [TREE].

A run that ends after one physics step, from the start of the process to its end: an upper bound of
the first tick. The first of the runs warms the caches and does not count.
"""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

RUNS = 5


def seconds(tree: str) -> float:
    """One process, from its start to its end."""
    program = Path(sys.executable).with_name("bt-run")
    command = [str(program), tree, "--duration", "0.002", "--display", "quiet"]
    began = time.perf_counter()
    subprocess.run(command, check=False, capture_output=True)
    return time.perf_counter() - began


def main(tree: str) -> None:
    """Print the fastest and the slowest run."""
    taken = [seconds(tree) for _ in range(RUNS + 1)][1:]
    print(f"{tree}: first tick within {min(taken):.2f} s (slowest of {RUNS}: {max(taken):.2f} s)")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "reach_to_pose")
