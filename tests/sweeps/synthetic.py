"""Rows and an engine without simulation, for tests of sweeps."""

from __future__ import annotations

import hashlib
import json
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from bt_dualarm.sweeps.engine import Done, Task
from bt_dualarm.sweeps.job import Row
from bt_dualarm.sweeps.manifest import TrialSpec
from bt_dualarm.sweeps.trial import TrialJob

TREE = """
bt_dualarm: 1
name: guess
params:
  x: {type: number, default: 0.5, range: [0, 1]}
  y: {type: number, default: 0.5, range: [0, 1]}
  count: {type: integer, default: 1}
  tool: {type: text, default: hand, choices: [hand, cup]}
  axis: {type: vector, default: [0, 0, 1]}
world: {scene: empty}
arms:
  arm1:
    robot: ur5
    tree: {sequence: [{wait: 0.1}, {compare: {value: "{x}", relation: less, to: 0.6}}]}
"""


def row_of(trial: TrialSpec, *, works: bool = True, error_m: float = 0.001) -> Row:
    """A row like that of a run."""
    return {
        "trial": trial.index,
        "identity": trial.identity,
        **{
            f"param.{name}": json.dumps(value) if isinstance(value, list) else value
            for name, value in trial.params.items()
        },
        "seed": trial.seed,
        "reality": trial.reality or "",
        "outcome": "SUCCESS" if works else "FAILURE",
        "code": "" if works else "UNREACHABLE",
        "arm": "" if works else "arm1",
        "leaf": "" if works else "sequence/reach_to_pose",
        "cause": "" if works else "OUT_OF_REACH",
        "cause_sentence": "" if works else "it is | too far away",
        "reason": "" if works else "out of reach",
        "sim_time_s": 1.5,
        "state_sha256": hashlib.sha256(trial.identity.encode()).hexdigest(),
        "metric.arm1.circle.error_m": error_m,
        "cpu_s": 0.5,
        "wall_s": 0.6,
        "memory_mb": 300.0,
        "machine": "here",
        "processor": "kind",
        "attempts": 1,
        "audited": False,
    }


@dataclass
class InstantEngine:
    """Answers tasks with a function, the last one first, so that tests do not rely on the order."""

    answer: Callable[[TrialSpec], Row]
    slots: int = 3
    ran: list[int] = field(default_factory=list)
    closed: bool = False
    queue: deque[Task] = field(default_factory=deque)

    def submit(self, task: Task) -> None:
        self.queue.append(task)

    def completed(self, timeout: float) -> Sequence[Done]:
        if not self.queue:
            return []
        task = self.queue.pop()
        assert isinstance(task.job, TrialJob)
        self.ran.append(task.job.index)
        worker = "second" if task.avoid else "first"
        return [Done(task, self.answer(task.job.trial), worker)]

    def close(self) -> None:
        self.closed = True
