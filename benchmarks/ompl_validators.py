"""Planning with OMPL versus compiled code: python -m benchmarks.ompl_validators.

    python -m benchmarks.ompl_validators [--problems N] [--seed N] [--quick]

Problems of `scene_problems` whose straight path is not free are each solved by

- `both`: OMPL's RRT-Connect for up to 500 checks, then the compiled one, as in the package;
- `compiled`: the compiled RRT-Connect alone;
- `OMPL`: OMPL's RRT-Connect alone, for up to 30,000 checks;
- `AORRTC`, `BITstar`, `InformedRRTstar`: a planner of OMPL that optimizes, for ``INFORMED`` checks,
  or ten times as many if it has no path by then.

All of them check edges with compiled distances and shorten paths with OMPL's simplifier. Prints the
success rate, median and 95th percentile of the CPU time in one process, and the path length; times
and lengths also as ratios to `compiled`. Then prints the number of edge checks, and the cost of
their Python binding relative to the checks themselves.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from benchmarks.scene_problems import scene_problems
from bt_dualarm.collision.swept import CompiledEdges, UnknownShapeError, path_length, swept_arm
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix
from bt_dualarm.planning.path_search import (
    ArmChecks,
    Budget,
    CompiledRRTConnect,
    OmplSearch,
    Planner,
    shortened,
)
from bt_dualarm.planning.problem import PlanningProblem, admitted, is_free, path_around

INFORMED: Final = 1_000
"""Number of checks of the optimizing planners; `both` takes about 700."""

EDGES: Final = ((1.0, 2_000), (0.5, 10_000), (0.3, 30_000))
"""Longest edge of OMPL's trees, m, and the number of checks after which the next entry applies."""


@dataclass
class Trial:
    """One problem solved by one method.

    Attributes:
        seconds: CPU time from the problem to the corners.
        length: Length of the path, m; None if there is none.
        checks: Number of configurations checked.
        edges: Number of edges checked.
        edge_s: CPU time of edge checks, with the kernel call, without the binding, s.
    """

    seconds: float
    length: float | None
    checks: int
    edges: int
    edge_s: float


class TimedEdges(CompiledEdges):
    """Compiled edges that time their checks."""

    calls = 0
    seconds = 0.0

    def is_free(self, start: Matrix, end: Matrix) -> bool:
        """Time the check of the base class."""
        began = time.process_time()
        free = super().is_free(start, end)
        self.seconds += time.process_time() - began
        self.calls += 1
        return free


def by_both(problem: PlanningProblem, arm: ArmChecks, edges: CompiledEdges) -> Matrix | None:
    """Path of the package."""
    del arm, edges
    try:
        return path_around(problem).corners
    except Failure:
        return None


def by_compiled(problem: PlanningProblem, arm: ArmChecks, edges: CompiledEdges) -> Matrix | None:
    """Shortest of three paths, like `both`."""
    radii = arm.checker.radii
    paths: list[Matrix] = []
    while len(paths) < 3 and (not paths or edges.checked < 500):
        seed = problem.seed + len(paths)
        search = CompiledRRTConnect(
            edges, problem.start, problem.goals, problem.limits, radii, seed
        )
        path = search.path(problem.checks, lambda: False)
        if path is None:
            break
        paths.append(shortened(path, arm, seed + 1))
    return min(paths, key=lambda path: path_length(path, radii), default=None)


def by_ompl(problem: PlanningProblem, arm: ArmChecks, edges: CompiledEdges) -> Matrix | None:
    """First path of OMPL's RRT-Connect, with successively shorter edges."""
    del edges
    for number, (longest, checks) in enumerate(EDGES):
        arm.budget.limit = checks
        search = OmplSearch(arm, problem.start, problem.goals, problem.seed + 1 + number)
        path = search.run("RRTConnect", longest)
        if path is not None:
            return path
    return None


def by_informed(
    name: Planner,
) -> Callable[[PlanningProblem, ArmChecks, CompiledEdges], Matrix | None]:
    """Path of an optimizing planner, which uses all of its checks."""

    def solve(problem: PlanningProblem, arm: ArmChecks, edges: CompiledEdges) -> Matrix | None:
        del edges
        for number, checks in enumerate((INFORMED, 10 * INFORMED)):
            arm.budget.limit = checks
            search = OmplSearch(arm, problem.start, problem.goals, problem.seed + 1 + number)
            path = search.run(name, 1.0)
            if path is not None:
                return path
        return None

    return solve


METHODS: Final = {
    "compiled": by_compiled,
    "both": by_both,
    "OMPL": by_ompl,
    "AORRTC": by_informed("AORRTC"),
    "BITstar": by_informed("BITstar"),
    "InformedRRTstar": by_informed("InformedRRTstar"),
}


def trial(method: str, problem: PlanningProblem) -> Trial:
    """One problem solved by one method; the time includes the preparation of the shapes."""
    began = time.process_time()
    edges = TimedEdges(swept_arm(problem.checker, (problem.start, *problem.goals)))
    arm = ArmChecks(problem.checker, edges, problem.limits, Budget(lambda: False))
    if method == "both":
        began = time.process_time()  # it prepares the shapes itself
    path = METHODS[method](problem, arm, edges)
    seconds = time.process_time() - began
    length = None if path is None else path_length(path, problem.checker.radii)
    return Trial(seconds, length, edges.checked, edges.calls, edges.seconds)


def problems_to_search(seed: int) -> Iterator[PlanningProblem]:
    """Problems that need a search, with shapes that the kernels support."""
    for _, _, problem in scene_problems(seed):
        try:
            ready = admitted(problem)
            swept_arm(ready.checker)
        except (Failure, UnknownShapeError):
            continue
        if not is_free(ready.checker, ready.straight):
            yield ready


def row(name: str, trials: list[Trial], reference: list[Trial]) -> str:
    """Table row of one method."""
    median, p95 = np.percentile([one.seconds for one in trials], (50, 95))
    least, most = np.percentile([one.seconds for one in reference], (50, 95))
    ratios = [
        one.length / other.length
        for one, other in zip(trials, reference, strict=True)
        if one.length and other.length
    ]
    solved = sum(one.length is not None for one in trials) / len(trials)
    return (
        f"{name:16} {100 * solved:6.1f} %  {1e3 * median:7.1f} ms {median / least:5.2f}  "
        f"{1e3 * p95:7.1f} ms {p95 / most:5.2f}  {np.median(ratios):6.3f}"
    )


def profile(trials: list[Trial]) -> str:
    """Profile of OMPL's search, as text."""
    edges = sum(one.edges for one in trials)
    checks = sum(one.checks for one in trials)
    seconds = sum(one.seconds for one in trials)
    inside = sum(one.edge_s for one in trials)
    return (
        f"OMPL alone: {edges / len(trials):.0f} edges per problem "
        f"(median {np.median([one.edges for one in trials]):.0f}), "
        f"{checks / edges:.1f} configurations per edge; {1e6 * inside / edges:.1f} us per edge in "
        f"the compiled check and its call, {1e6 * (seconds - inside) / edges:.1f} us elsewhere"
    )


def binding_costs(problem: PlanningProblem) -> str:
    """Costs of one callback from OMPL into Python, of a state, and of a kernel call, as text."""
    edges = CompiledEdges(swept_arm(problem.checker, (problem.start, *problem.goals)))
    arm = ArmChecks(problem.checker, edges, problem.limits, Budget(lambda: False))
    search = OmplSearch(arm, problem.start, problem.goals, 1)
    space = search._space
    state = space.state(problem.start)
    joints = slice(0, len(problem.start))
    crossing = _microseconds(lambda: space.information.isValid(state))
    contact = _microseconds(lambda: problem.checker.free(problem.start))
    vector = _microseconds(lambda: np.array(state[joints]))
    still = _microseconds(lambda: edges.is_free(problem.start, problem.start))
    motion = _microseconds(lambda: space.information.checkMotion(state, state))
    return (
        f"us a call: state to array {vector:.1f}; contact of one configuration by MuJoCo "
        f"{contact:.1f}, through OMPL {crossing:.1f}; edge of no length {still:.1f}, "
        f"through OMPL {motion:.1f}"
    )


def _microseconds(call: Callable[[], object], count: int = 2_000) -> float:
    call()
    best = np.inf
    for _ in range(5):
        began = time.process_time()
        for _ in range(count):
            call()
        best = min(best, (time.process_time() - began) / count)
    return 1e6 * best


def main() -> None:
    """Print the table and the profile."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=int, default=100)
    parser.add_argument("--seed", type=int, default=501)
    parser.add_argument("--quick", action="store_true", help="without the optimizing planners")
    arguments = parser.parse_args()
    names = list(METHODS)[: 3 if arguments.quick else None]
    results: dict[str, list[Trial]] = {name: [] for name in names}
    for number, problem in enumerate(problems_to_search(arguments.seed)):
        if number == 0:
            for name in names:  # the first problem only triggers imports
                trial(name, problem)
            costs = binding_costs(problem)
            continue
        for name, trials in results.items():
            trials.append(trial(name, replace(problem, seed=number)))
        if number == arguments.problems:
            break
    print(f"{arguments.problems} problems that need a search")
    print("method            solved     median ratio          95 % ratio  length")
    for name, trials in results.items():
        print(row(name, trials, results["compiled"]))
    print(profile(results["OMPL"]))
    print(costs)


if __name__ == "__main__":
    main()
