"""Shipped trees with arms that deviate from their models: success, errors, speed.

    python -m benchmarks.reality [--trees circle lissajous] [--sets ideal lab rough] [--seeds 3]

Each tree is run as `bt-run` does, with ``--seeds`` robots with their own deviations. For each tree
and reality, prints the number of successful runs and the reason of the first failure; the worst
metrics of motions and of tracking, measured by the encoders or against the true state; and the
simulated seconds per CPU second relative to the first reality: the median over the robots, each of
which runs in all realities in turn. A warm-up run is not counted.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from statistics import median

import bt_dualarm as bt
from bt_dualarm.spec.document import REALITY_NAMES

METRICS = ("path_rms_m", "path_max_m", "yz_rms_m", "yz_max_m", "position_error_m")
TREES = ("circle", "lissajous", "pick_and_transport", "pick_and_track")


@dataclass
class Batch:
    """Results of a tree in one reality.

    Attributes:
        succeeded: Number of successful runs.
        reason: Reason of the first failure; empty if there is none.
        worst: Largest value of each metric, by name, over all runs and leaves.
        speeds: Simulated seconds per CPU second, by run.
    """

    succeeded: int = 0
    reason: str = ""
    worst: dict[str, float] = field(default_factory=dict)
    speeds: list[float] = field(default_factory=list)

    def add(self, tree: str, reality: str, seed: int) -> None:
        """Run a shipped tree on another robot."""
        began = time.process_time()
        result = bt.run(tree, reality=reality, seed=seed, renderer="ray")
        self.speeds.append(result.sim_time_s / (time.process_time() - began))
        self.succeeded += result.outcome == "SUCCESS"
        self.reason = self.reason or next(reasons(result), "")
        for arm in result.arms.values():
            for leaf in arm.runs:
                for name in METRICS:
                    value = leaf.metrics.get(name)
                    if isinstance(value, float):
                        self.worst[name] = max(self.worst.get(name, 0.0), value)


def reasons(result: bt.RunResult) -> Iterator[str]:
    """Codes and reasons of the failed leaves, with their arms."""
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
        batches = {reality: Batch() for reality in arguments.sets}
        bt.run(tree, reality=arguments.sets[0], renderer="ray")  # imports do not count
        for seed in range(arguments.seeds):
            for reality, batch in batches.items():
                batch.add(tree, reality, seed)
        first = batches[arguments.sets[0]].speeds
        for reality, batch in batches.items():
            speed = median(one / other for one, other in zip(batch.speeds, first, strict=True))
            text = ", ".join(f"{name} {1e3 * value:.3f} mm" for name, value in batch.worst.items())
            print(
                f"{tree:18} {reality:6} {batch.succeeded}/{len(first)}  {text}  "
                f"pace {speed:.2f}  {batch.reason}",
                flush=True,
            )


if __name__ == "__main__":
    main()
