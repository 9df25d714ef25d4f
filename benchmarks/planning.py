"""Ways around boxes: python -m benchmarks.planning [--problems N] [--quick].

A UR5 and a Panda stand face to face; between them are five to ten boxes, one of them a plate of
10 mm that stands upright. The tool of one arm is just above a box or low between the boxes, and has
to get to another such place. Printed: how many problems are solved, what that takes on the wall,
how long the ways are, and what MuJoCo says of contacts when the motions are replayed in its world.

A problem counts when it is known to have a solution: one that was found here and replayed without a
contact, or one that another planner found with ten times the checks.
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
"""Depth of things that touch and do not collide, as in `bt_dualarm.collision.checker`."""


@dataclass
class Outcome:
    """What came of one problem.

    Attributes:
        plan_s: Seconds on the wall for the way's corners; ``cpu_s``, of this process.
        motion_s: Seconds for these, rounded, timed and checked once more.
        straight: The straight way was free.
        ratio: Length of the way over the straight joint distance.
        overlap: Deepest contact in m when replayed.
        replayed: Configurations that were replayed.
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
    """Deepest contact of the arm in m, and how many configurations were looked at.

    In the world's own model, with the pairs that its physics looks at, every ``REPLAY_M``.
    """
    model = world.model
    data = world.data
    body = world.arms[name]
    mine = np.zeros(model.ngeom, dtype=bool)
    mine[list(body.geom_ids)] = True
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
                depth = -data.contact.dist[mine[data.contact.geom].any(axis=1)]
                deepest = max(deepest, float(depth.max(initial=0.0)))
    data.qpos[:] = before
    return deepest, count


def is_solvable(world: World, name: str, problem: PlanningProblem) -> bool:
    """Whether others find a way that can be replayed, with ten times the checks."""
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
    """Outcomes of so many solvable problems, and how many others were left out."""
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
    """The figures, one a line."""
    solved = [one for one in outcomes if one.solved]
    searched = [one for one in solved if not one.straight]
    count = len(outcomes)
    ratios = np.array([one.ratio for one in searched])
    return "\n".join(
        (
            f"problems              {count}, known to be solvable; {left_out} others left out",
            f"solved                {len(solved)}  {100 * len(solved) / count:.1f} %",
            f"longer than 2 s       {sum(one.plan_s > 2.0 for one in outcomes)}",
            f"straight way free     {len(solved) - len(searched)}",
            times("plan, all", [one.plan_s for one in outcomes]),
            times("plan, searched", [one.plan_s for one in searched]),
            times("plan, all, CPU", [one.cpu_s for one in outcomes]),
            times("plan, searched, CPU", [one.cpu_s for one in searched]),
            times("motion, searched", [one.motion_s for one in searched]),
            f"length / straight     median {np.median(ratios):.2f}  "
            f"90 % {np.percentile(ratios, 90):.2f}  max {ratios.max():.2f}  (searched)",
            f"replayed              {sum(one.replayed for one in outcomes)} configurations, "
            f"one a {1e3 * REPLAY_M:g} mm",
            f"in collision          {sum(one.overlap > OVERLAP_M for one in outcomes)}",
            f"deepest contact       {1e3 * max(one.overlap for one in outcomes):.2f} mm",
        )
    )


def times(name: str, seconds: list[float]) -> str:
    """Percentiles of times on the wall."""
    ms = 1e3 * np.array(seconds)
    return (
        f"{name:21} median {np.median(ms):.0f} ms  90 % {np.percentile(ms, 90):.0f} ms  "
        f"max {ms.max():.0f} ms"
    )


def warm_up() -> None:
    """Import what is imported with the first plan."""
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
