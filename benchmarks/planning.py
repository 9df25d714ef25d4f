"""Planning among boxes: python -m benchmarks.planning [--problems N] [--quick].

A UR5 and a Panda stand face to face; between them are five to ten boxes, one of them an upright
plate of 10 mm. The tool of one arm is just above a box or low between the boxes, and has to get to
another such position. Prints how many problems are solved, in which wall-clock time, the lengths of
the paths, and the contacts that MuJoCo finds when the motions are replayed in its world.

A problem counts if it is known to be solvable: by a solution found here and replayed without a
collision, or by one that another planner found with ten times the checks.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import time
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from benchmarks.box_problems import problems
from bt_dualarm.collision.checker import interpolated
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.planning.path_search import Planner
from bt_dualarm.planning.problem import (
    PlanningProblem,
    admitted,
    is_free,
    motion_around,
    path_around,
)
from bt_dualarm.sim.world import World

PROBLEMS = 100
QUICK = 10
REPLAY_M = 0.001
OVERLAP_M = 5e-4
"""Depth of a contact below which it is not a collision, as in `bt_dualarm.collision.checker`, m."""


@dataclass
class Outcome:
    """Result of one problem.

    Attributes:
        plan_s: Wall-clock time for the corners of the path, s.
        cpu_s: CPU time for the corners of the path, s.
        motion_s: Wall-clock time to plan, round, time and check the motion, s.
        straight: Whether the straight path was free.
        ratio: Path length over the straight joint distance.
        overlap: Deepest contact in the replay, m.
        replayed: Number of replayed configurations.
        solved: Whether a path was found that collides with nothing in the replay.
    """

    plan_s: float = 0.0
    cpu_s: float = 0.0
    motion_s: float = 0.0
    straight: bool = False
    ratio: float = 1.0
    overlap: float = 0.0
    replayed: int = 0
    solved: bool = False


def solve(world: World, name: str, problem: PlanningProblem) -> Outcome:
    """Plan, time, replay."""
    outcome = Outcome()
    wall = time.perf_counter()
    cpu = time.process_time()
    corners = None
    with contextlib.suppress(Failure):
        problem = admitted(problem)
        outcome.straight = is_free(problem.checker, problem.straight)
        corners = problem.straight if outcome.straight else path_around(problem).corners
    outcome.plan_s = time.perf_counter() - wall
    outcome.cpu_s = time.process_time() - cpu
    if corners is None:
        return outcome
    rows = corners
    if not outcome.straight:
        began = time.perf_counter()
        rows = motion_around(problem).q
        outcome.motion_s = time.perf_counter() - began
    radii = problem.checker.radii
    outcome.overlap, outcome.replayed = replayed(world, name, rows, radii)
    lengths = np.linalg.norm(np.diff(rows, axis=0), axis=1)
    outcome.ratio = float(lengths.sum() / np.linalg.norm(rows[-1] - rows[0]))
    outcome.solved = outcome.overlap <= OVERLAP_M
    return outcome


def replayed(world: World, name: str, rows: Matrix, radii: Vector) -> tuple[float, int]:
    """Deepest contact of the arm in m, and the number of configurations that were checked.

    Checks the pairs of the world's own model every ``REPLAY_M``.
    """
    model = world.model
    data = world.data
    body = world.arms[name]
    of_arm = np.zeros(model.ngeom, dtype=bool)
    of_arm[list(body.geom_ids)] = True
    before = data.qpos.copy()
    deepest = 0.0
    count = 0
    for here, there in itertools.pairwise(rows):
        for q in interpolated(here, there, radii, REPLAY_M):
            data.qpos[body.qpos_ids] = q
            mujoco.mj_kinematics(model, data)
            mujoco.mj_collision(model, data)
            count += 1
            if data.ncon:
                depth = -data.contact.dist[of_arm[data.contact.geom].any(axis=1)]
                deepest = max(deepest, float(depth.max(initial=0.0)))
    data.qpos[:] = before
    return deepest, count


def is_solvable(world: World, name: str, problem: PlanningProblem) -> bool:
    """Whether another planner finds a path without a collision, with ten times the checks."""
    radii = problem.checker.radii
    others: tuple[tuple[Planner, int], ...] = (("RRTConnect", 100), ("AORRTC", 200))
    for planner, seed in others:
        harder = replace(problem, planner=planner, seed=seed, checks=10 * problem.checks)
        try:
            corners = path_around(harder).corners
        except Failure:
            continue
        return replayed(world, name, corners, radii)[0] <= OVERLAP_M
    return False


def survey(count: int, seed: int) -> tuple[list[Outcome], int]:
    """Outcomes of ``count`` solvable problems, and the number of others, which were left out."""
    outcomes: list[Outcome] = []
    left_out = 0
    for world, name, problem in problems(seed):
        outcome = solve(world, name, problem)
        if outcome.solved or is_solvable(world, name, problem):
            outcomes.append(outcome)
        else:
            left_out += 1
        if len(outcomes) == count:
            break
    return outcomes, left_out


def table(outcomes: list[Outcome], left_out: int) -> str:
    """The figures, one per line."""
    solved = [one for one in outcomes if one.solved]
    searched = [one for one in solved if not one.straight]
    count = len(outcomes)
    ratios = np.array([one.ratio for one in searched])
    return "\n".join(
        (
            f"problems              {count}, known to be solvable; {left_out} others left out",
            f"solved                {len(solved)}  {100 * len(solved) / count:.1f} %",
            f"longer than 2 s       {sum(one.plan_s > 2.0 for one in outcomes)}",
            f"straight path free    {len(solved) - len(searched)}",
            times("plan, all", [one.plan_s for one in outcomes]),
            times("plan, searched", [one.plan_s for one in searched]),
            times("plan, all, CPU", [one.cpu_s for one in outcomes]),
            times("plan, searched, CPU", [one.cpu_s for one in searched]),
            times("motion, searched", [one.motion_s for one in searched]),
            f"length / straight     median {np.median(ratios):.2f}  "
            f"90 % {np.percentile(ratios, 90):.2f}  max {ratios.max():.2f}  (searched)",
            f"replayed              {sum(one.replayed for one in outcomes)} configurations, "
            f"one per {1e3 * REPLAY_M:g} mm",
            f"in collision          {sum(one.overlap > OVERLAP_M for one in outcomes)}",
            f"deepest contact       {1e3 * max(one.overlap for one in outcomes):.2f} mm",
        )
    )


def times(name: str, seconds: list[float]) -> str:
    """Percentiles of times."""
    ms = 1e3 * np.array(seconds)
    return (
        f"{name:21} median {np.median(ms):.0f} ms  90 % {np.percentile(ms, 90):.0f} ms  "
        f"max {ms.max():.0f} ms"
    )


def warm_up() -> None:
    """Trigger the imports of the first plan."""
    world, _, problem = next(problems(seed=0))
    del world
    with contextlib.suppress(Failure):
        motion_around(problem)


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=int, default=PROBLEMS)
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} problems only")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    warm_up()
    print(table(*survey(QUICK if arguments.quick else arguments.problems, arguments.seed)))


if __name__ == "__main__":
    main()
