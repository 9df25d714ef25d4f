"""Planning among shelves, boxes, cages and tables: python -m benchmarks.scenes [--problems N].

Problems of `scene_problems`, every arm of the catalog. Printed, of CPU time: what finding a way
takes, and all from a request to a timed trajectory; how many are solved, and how many of these by
OMPL, not by the compiled search for narrow passages; how long the ways are, against the shortest of
so many others (``--best``); and what MuJoCo says of contacts when the motions are replayed.

A problem counts when somebody solves it: here, or with ten times the checks and other planners.
"""

from __future__ import annotations

import argparse
import contextlib
import time
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.planning import OVERLAP_M, REPLAY_M, is_solvable, replayed
from benchmarks.scene_problems import scene_problems
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix
from bt_dualarm.planning.problem import (
    PlanningProblem,
    admitted,
    motion_around,
    path_around,
    straight_motion,
)
from bt_dualarm.sim.world import World


@dataclass
class Outcome:
    """What came of one problem; seconds of CPU.

    Attributes:
        kind: Kind of scene, and robot.
        request_s: From the problem to a timed trajectory.
        plan_s: Of these, or of a run of its own, what finding the way takes.
        by_ompl: A planner of OMPL found it, not the compiled one for narrow passages.
        ratio: Length of the way over the shortest known; 1 where it is straight.
        overlap: Deepest contact in m when replayed.
        solved: It came to a trajectory that touches nothing.
    """

    kind: str
    request_s: float = 0.0
    plan_s: float = 0.0
    by_ompl: bool = False
    straight: bool = False
    ratio: float = 1.0
    overlap: float = 0.0
    solved: bool = False


def solve(kind: str, world: World, problem: PlanningProblem, best: int) -> Outcome:
    """Plan twice: the way alone, then all of it; replay."""
    outcome = Outcome(kind)
    with contextlib.suppress(Failure):
        began = time.process_time()
        ready = admitted(problem)
        motion = straight_motion(ready)
        outcome.straight = motion is not None
        if motion is None:
            motion = motion_around(ready)
        outcome.request_s = outcome.plan_s = time.process_time() - began
        if not outcome.straight:
            began = time.process_time()
            way = path_around(ready)
            outcome.plan_s = time.process_time() - began
            outcome.by_ompl = way.by_ompl
            outcome.ratio = _ratio(ready, way.corners, best)
        outcome.overlap = replayed(world, "arm1", motion.q, ready.checker.radii)[0]
        outcome.solved = outcome.overlap <= OVERLAP_M
    return outcome


def _ratio(problem: PlanningProblem, corners: Matrix, best: int) -> float:
    """Length of a way over that of the shortest of so many others, this one among them."""
    shortest = mine = _length(problem, corners)
    for seed in range(1, best + 1):
        with contextlib.suppress(Failure):
            other = path_around(replace(problem, seed=1000 * seed))
            shortest = min(shortest, _length(problem, other.corners))
    return mine / shortest


def _length(problem: PlanningProblem, corners: Matrix) -> float:
    """In meters that the arm moves."""
    return float(np.linalg.norm(np.diff(corners, axis=0) * problem.checker.radii, axis=1).sum())


def table(outcomes: list[Outcome], left_out: int) -> str:
    """The figures, one a line."""
    solved = [one for one in outcomes if one.solved]
    missed = Counter(one.kind for one in outcomes if not one.solved)
    searched = [one for one in solved if not one.straight]
    return "\n".join(
        (
            f"problems           {len(outcomes)}, known to be solvable; {left_out} others left out",
            f"solved             {len(solved)}  {100 * len(solved) / len(outcomes):.2f} %  "
            f"{dict(missed) or ''}",
            f"straight           {len(solved) - len(searched)}; "
            f"by OMPL {sum(one.by_ompl for one in searched)}",
            _times("plan", [one.plan_s for one in solved]),
            _times("plan, searched", [one.plan_s for one in searched]),
            _times("request, all", [one.request_s for one in solved]),
            _times("request, searched", [one.request_s for one in searched]),
            _spread("length / best", [one.ratio for one in searched], ""),
            f"in collision       {sum(one.overlap > OVERLAP_M for one in outcomes)}, deepest "
            f"{1e3 * max(one.overlap for one in outcomes):.2f} mm, looked at every "
            f"{1e3 * REPLAY_M:g} mm",
        )
    )


def _times(name: str, seconds: list[float]) -> str:
    return _spread(name, [1e3 * one for one in seconds], " ms")


def _spread(name: str, values: list[float], unit: str) -> str:
    median, p95 = np.percentile(values, (50, 95))
    return f"{name:18} median {median:.2f}{unit}  95 % {p95:.2f}{unit}  max {max(values):.2f}{unit}"


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--best", type=int, default=8, help="other ways to compare with")
    arguments = parser.parse_args()
    outcomes: list[Outcome] = []
    left_out = -1  # the first one only imports what the others need
    for kind, world, problem in scene_problems(arguments.seed):
        outcome = solve(kind, world, problem, arguments.best if left_out >= 0 else 0)
        if left_out >= 0 and (outcome.solved or is_solvable(world, "arm1", problem)):
            outcomes.append(outcome)
        else:
            left_out += 1
        if len(outcomes) == arguments.problems:
            break
    print(table(outcomes, left_out))


if __name__ == "__main__":
    main()
