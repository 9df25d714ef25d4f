"""Whether a run that goes on from a record is the one that was never interrupted, and how fast.

    python -m benchmarks.resuming [--times 10] [--seed 0]

Each of five shipped trees is recorded once, then resumed at random times. Prints how many final
hashes are those of the uninterrupted run, and how much faster than real time the past was made.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

import bt_dualarm
from bt_dualarm.replay.record import Record
from bt_dualarm.replay.rerun import Changed
from bt_dualarm.replay.resume import resumed
from bt_dualarm.skill.registry import Registry

TREES = ("circle", "reach_to_pose", "pick_and_transport", "visual_tracking", "pick_and_track")


def main() -> None:
    """Record, resume, compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    rng, registry = np.random.default_rng(arguments.seed), Registry.load()
    same = tried = 0
    with tempfile.TemporaryDirectory() as name:
        for tree in TREES:
            folder = Path(name) / tree
            sha256 = bt_dualarm.run(tree, record=folder).state_sha256
            record = Record.read(folder)
            factors = []
            for at in rng.uniform(0.1, record.until, arguments.times):
                before = time.process_time()
                with resumed(record, float(at), registry, Changed()) as run:
                    factors.append(float(at) / (time.process_time() - before))
                    same += run.finish().state_sha256 == sha256
                tried += 1
            median = float(np.median(factors))
            print(f"{tree}: {median:.1f} s of the past in a second of CPU (median)", flush=True)
    print(f"{same} of {tried} final hashes are those of the uninterrupted run")


if __name__ == "__main__":
    main()
