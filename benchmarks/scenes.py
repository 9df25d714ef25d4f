"""Planning among shelves, boxes, cages and tables: python -m benchmarks.scenes [--problems N].

Problems of `scene_problems`, with all arms of the catalog. Prints the CPU time of finding a path,
and of all steps from a request to a timed trajectory; how many problems are solved, and how many of
these by OMPL instead of the compiled search for narrow passages; path lengths relative to the
shortest of ``--best`` others; and the contacts that MuJoCo finds when the motions are replayed.

A problem counts if it is solved here, or by another planner with ten times the checks.
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
    """Result of one problem; times are CPU seconds.

    Attributes:
        kind: Kind of scene, and robot.
        request_s: Time from the problem to a timed trajectory.
        plan_s: Time for the path alone, measured in a separate search unless it is straight.
        by_ompl: Whether OMPL found the path, not the compiled search for narrow passages.
        straight: Whether the straight path is free.
        ratio: Path length over that of the shortest known; 1 for a straight path.
        overlap: Deepest contact in the replay, m.
        solved: Whether the trajectory collides with nothing.
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
    """Plan the motion, then the path alone, and replay the motion."""
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
            path = path_around(ready)
            outcome.plan_s = time.process_time() - began
            outcome.by_ompl = path.by_ompl
            outcome.ratio = _ratio(ready, path.corners, best)
        outcome.overlap = replayed(world, "arm1", motion.q, ready.checker.radii)[0]
        outcome.solved = outcome.overlap <= OVERLAP_M
    return outcome


def _ratio(problem: PlanningProblem, corners: Matrix, best: int) -> float:
    """Length of a path over that of the shortest one, of this and ``best`` others."""
    shortest = length = _length(problem, corners)
    for seed in range(1, best + 1):
        with contextlib.suppress(Failure):
            other = path_around(replace(problem, seed=1000 * seed))
            shortest = min(shortest, _length(problem, other.corners))
    return length / shortest


def _length(problem: PlanningProblem, corners: Matrix) -> float:
    """Length of a path in meters of motion of the arm."""
    return float(np.linalg.norm(np.diff(corners, axis=0) * problem.checker.radii, axis=1).sum())


def table(outcomes: list[Outcome], left_out: int) -> str:
    """The figures, one per line."""
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
            f"{1e3 * max(one.overlap for one in outcomes):.2f} mm, replayed every "
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
    parser.add_argument("--best", type=int, default=8, help="number of other paths to compare with")
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
