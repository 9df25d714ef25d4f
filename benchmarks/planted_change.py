"""Whether a comparison of sweeps detects a planted change, and reports none between equals.

    python -m benchmarks.planted_change [--trials 12] [--share 0.8] [--repeats 20]

A UR5 traces circles, with the controller's bandwidth unchanged and lowered to ``--share``;
``bt-compare`` pairs the trials by seed. The trials of equal versions are bitwise equal, so their
verdict is "equal". To represent versions that are only equal in distribution, as on another kind of
processor, both sweeps of each repeat draw different random numbers under the same seeds: of 20 such
comparisons, 19 are expected to be undecided.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from bt_dualarm.control import dynamics
from bt_dualarm.sweeps.comparison import Comparison, compare
from bt_dualarm.sweeps.engine import Done, Task
from bt_dualarm.sweeps.job import Row
from bt_dualarm.sweeps.manifest import Manifest, checked
from bt_dualarm.sweeps.sweep import run_sweep
from bt_dualarm.sweeps.trial import TrialJob, run_trial

TREE: Final = """
bt_dualarm: 1
name: small circles
world: {scene: empty, reality: rough, time_limit: 20}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 0, 0.40]}
    posture: present
    tree: {circle: {plane: yz, radius: 0.05, turns: 1, speed: 0.5}}
"""


@dataclass
class SameProcess:
    """Engine that runs trials in this process, so that patches apply to them.

    Args:
        offset: Added to the seed of each run; its row keeps the seed of the trial.
    """

    offset: int = 0
    slots: int = 1
    queue: deque[Task] = field(default_factory=deque)

    def submit(self, task: Task) -> None:
        """Queue a task."""
        self.queue.append(task)

    def completed(self, timeout: float) -> Sequence[Done]:  # noqa: ARG002 - of the protocol
        """Run the next task."""
        if not self.queue:
            return []
        task = self.queue.popleft()
        if not isinstance(task.job, TrialJob):
            raise TypeError(f"{task.job.label} is not a trial of a tree")
        trial = task.job.trial
        shifted_job = replace(task.job, trial=replace(trial, seed=trial.seed + self.offset))
        row: Row = {**run_trial(shifted_job), "seed": trial.seed}
        return [Done(task, row, "here")]

    def close(self) -> None:
        """Do nothing."""


@contextmanager
def lowered(share: float) -> Iterator[None]:
    """Lower the bandwidth of the controller within the block; both of its gains depend on it."""
    before = dynamics.BANDWIDTH
    dynamics.BANDWIDTH = share * before  # type: ignore[misc]  # the planted change
    try:
        yield
    finally:
        dynamics.BANDWIDTH = before  # type: ignore[misc]


def swept(out: Path, trials: int, *, share: float = 1.0, offset: int = 0) -> Path:
    """Sweep the seeds from 0 on; returns the output folder.

    Args:
        out: Output folder.
        trials: Number of seeds.
        share: Share of the controller's bandwidth.
        offset: Added to each seed for the random numbers.
    """
    manifest = checked(Manifest(TREE, tuple(range(trials))))
    with lowered(share):
        run_sweep(manifest, out, lambda: SameProcess(offset), keep="none")
    return out


def verdict(found: Comparison) -> str:
    """Verdict over success and all metrics together."""
    return "decided" if found.is_decided else str(found.verdict)


def main() -> int:
    """Print all verdicts; returns 1 if one is unexpected."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=12, help="seeds of each sweep (12)")
    parser.add_argument("--share", type=float, default=0.8, help="share of the bandwidth (0.8)")
    parser.add_argument(
        "--repeats", type=int, default=20, help="comparisons of equal versions (20)"
    )
    arguments = parser.parse_args()
    trials = arguments.trials
    with tempfile.TemporaryDirectory(prefix="planted_") as name:
        scratch = Path(name)
        before = swept(scratch / "before", trials)
        after = swept(scratch / "after", trials, share=arguments.share)
        planted = compare(before, after)
        differing = [one for one in planted.metrics if one.differs]
        print(f"bandwidth times {arguments.share:g}, {trials} pairs: {verdict(planted)}")
        for one in differing[:6]:
            print(f"  {one.name}: {one.mean_a:.4g} -> {one.mean_b:.4g}")
        again = compare(before, swept(scratch / "again", trials))
        print(f"the same version again: {verdict(again)}, {again.equal_states} equal states")
        undecided = 0
        for repeat in range(arguments.repeats):
            pair = [
                swept(scratch / f"{repeat}{side}", trials, offset=1000 * (2 * repeat + number))
                for number, side in enumerate("ab", 1)
            ]
            found = compare(*pair)
            undecided += not found.is_decided
            for one in found.metrics:
                if one.differs:
                    print(f"  repeat {repeat}: {one.name} seems to differ", flush=True)
        print(f"equal in distribution: {undecided} of {arguments.repeats} undecided")
    are_undecided = arguments.repeats - undecided <= max(1, round(0.05 * arguments.repeats))
    return 0 if differing and again.verdict == "equal" and are_undecided else 1


if __name__ == "__main__":
    sys.exit(main())
