"""Cost of a record: CPU time of a run with and without a history, and the size of the history.

    python -m benchmarks.recording [TREE] [--rounds 5]

Runs alternate with and without events, samples and history. Prints the ratio of the smallest CPU
times, the median ratio of the rounds, and megabytes per simulated minute. Plots, which are drawn
after a run, are not counted.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import bt_dualarm
from bt_dualarm.runtime.history_file import read_history
from bt_dualarm.runtime.recorder import HISTORY


@dataclass(frozen=True)
class Cost:
    """Cost of one run.

    Attributes:
        cpu_s: CPU time of the run, s.
        simulated_s: Simulated time of the run, s.
    """

    cpu_s: float
    simulated_s: float


def run_of(tree: str, folder: Path | None) -> Cost:
    """Run a tree to its end, with a record in a folder or without one."""
    with bt_dualarm.open(tree, record=folder) as run:
        before = time.process_time()
        result = run.finish()
        return Cost(time.process_time() - before, result.sim_time_s)


def main() -> None:
    """Run both kinds alternately and print the cost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tree", nargs="?", default="pick_and_track")
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    run_of(arguments.tree, None)
    pairs = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for number in range(arguments.rounds):
            order = (None, folder) if number % 2 else (folder, None)
            costs = {record: run_of(arguments.tree, record) for record in order}
            pairs.append((costs[None].cpu_s, costs[folder].cpu_s))
            print(f"without a record {pairs[-1][0]:.2f} s, with one {pairs[-1][1]:.2f} s of CPU")
        simulated = costs[folder].simulated_s
        blocks = read_history(folder / HISTORY).blocks
        size = (folder / HISTORY).stat().st_size
    plain, recorded = (min(column) for column in zip(*pairs, strict=True))
    median = statistics.median(b / a for a, b in pairs)
    grows = sum(len(block.encoded()) for block in blocks if block.kind == "second")
    print(f"ratio of the smallest {recorded / plain:.3f}, median of the ratios {median:.3f}")
    print(
        f"{size / 1e6:.2f} MB for {simulated:.1f} s; {60e-6 * grows / simulated:.2f} MB per minute"
    )


if __name__ == "__main__":
    main()
