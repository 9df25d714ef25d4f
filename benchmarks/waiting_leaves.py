"""Cost of a tick of 100 leaves that wait for another arm, compared with 100 that wait for time.

    python -m benchmarks.waiting_leaves [--rounds 30]

Ticks a tree with 100 leaves in a parallel node, without physics, alternating between leaf types.
Prints the median per leaf and tick, and the difference to `wait`.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from pathlib import Path

from tests.behaviors.ticking import Cells

LEAVES = 100
TICKS = 200
CELL = """
signals: {go: {type: boolean, written_by: [arm2], initial: false}}
rendezvous: {there: [arm1, arm2]}
zones: {bin: {size: [0.1, 0.1, 0.1]}}
"""
PARTNER = "sequence: [{act: {script: %s}}, signal: go, meet: there]"
KINDS = {
    "wait": "{wait: 86000}",
    "await": "{await: go}",
    "meet": "{meet: there}",
}


def main() -> int:
    """Print the medians."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--rounds", type=int, default=30)
    rounds = parser.parse_args().rounds
    spent: dict[str, list[float]] = {kind: [] for kind in KINDS}
    with tempfile.TemporaryDirectory() as folder:
        cells = {}
        for kind, leaf in KINDS.items():
            tree = f"parallel: [{', '.join([leaf] * LEAVES)}, {{meet: there}}]"
            partner = PARTNER % ("R" * 10 * TICKS * rounds)
            cells[kind] = Cells(Path(folder), CELL, {"arm1": tree, "arm2": partner})
            cells[kind].tick()
        for _ in range(rounds):
            for kind, one in cells.items():
                tree_of_arm = one.trees["arm1"]
                began = time.perf_counter()
                for _ in range(TICKS):
                    tree_of_arm.tick()
                    one.cell.commit(one.trees)
                spent[kind].append((time.perf_counter() - began) / TICKS / LEAVES)
    medians = {kind: statistics.median(times) for kind, times in spent.items()}
    for kind, median in medians.items():
        print(f"{kind:6} {1e6 * median:.2f} us  {1e6 * (median - medians['wait']):+.2f} us")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
