"""Shipped trees in a world that is not its model: what fails, how well the rest is done, the price.

    python -m benchmarks.reality [--trees circle lissajous] [--sets ideal lab rough] [--seeds 3]

Each tree is run as `bt-run` does, on so many robots of the batch. A line has, for one tree and one
reality: how many runs succeeded, and why the first of the others did not; the worst of the metrics
that a motion or a tracking has, which are measured by the encoders or scored against the truth; and
simulated seconds a second of CPU, as a share of those in the first reality.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass

import bt_dualarm as bt
from bt_dualarm.spec.reality import REALITY_NAMES

METRICS = ("path_rms_m", "path_max_m", "yz_rms_m", "yz_max_m", "position_error_m")
TREES = ("circle", "lissajous", "pick_and_transport", "pick_and_track")


@dataclass(frozen=True)
class Batch:
    """What the robots of a batch did with a tree.

    Attributes:
        succeeded: Number of runs that did.
        runs: Number of all runs.
        reason: Why the first of the others did not; empty if there are none.
        worst: Largest value of each metric, by name, over all runs and leaves.
        pace: Simulated seconds a second of CPU.
    """

    succeeded: int
    runs: int
    reason: str
    worst: dict[str, float]
    pace: float


def batch(tree: str, reality: str, seeds: int) -> Batch:
    """Run a shipped tree on so many robots."""
    succeeded, reason, simulated, began = 0, "", 0.0, time.process_time()
    worst: dict[str, float] = {}
    for seed in range(seeds):
        result = bt.run(tree, reality=reality, seed=seed, renderer="ray")
        simulated += result.sim_time_s
        succeeded += result.outcome == "SUCCESS"
        reason = reason or next(reasons(result), "")
        for arm in result.arms.values():
            for leaf in arm.runs:
                for name in METRICS:
                    value = leaf.metrics.get(name)
                    if isinstance(value, float):
                        worst[name] = max(worst.get(name, 0.0), value)
    return Batch(succeeded, seeds, reason, worst, simulated / (time.process_time() - began))


def reasons(result: bt.RunResult) -> Iterator[str]:
    """What the leaves say that failed, with their arm."""
    for name, arm in result.arms.items():
        for leaf in arm.runs:
            if leaf.status == "FAILURE":
                yield f"{name}: {leaf.skill}: {leaf.code}: {leaf.reason}"


def main() -> None:
    """Print a line for each tree and reality."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--trees", nargs="+", default=TREES)
    parser.add_argument("--sets", nargs="+", default=REALITY_NAMES, choices=REALITY_NAMES)
    parser.add_argument("--seeds", type=int, default=3)
    arguments = parser.parse_args()
    for tree in arguments.trees:
        first = 0.0
        bt.run(tree, reality=arguments.sets[0], renderer="ray")  # what is imported once is no price
        for reality in arguments.sets:
            done = batch(tree, reality, arguments.seeds)
            first = first or done.pace
            told = ", ".join(f"{name} {1e3 * value:.3f} mm" for name, value in done.worst.items())
            print(
                f"{tree:18} {reality:6} {done.succeeded}/{done.runs}  {told}  "
                f"pace {done.pace / first:.2f}  {done.reason}",
                flush=True,
            )


if __name__ == "__main__":
    main()
