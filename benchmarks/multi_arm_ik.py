"""Inverse kinematics of two arms that hold one object: success rate, time, residual.

    python -m benchmarks.multi_arm_ik [--targets 1000] [--seed 0]

A problem is a pose of one arm's tool in the world, and a fixed pose of the other arm's tool in the
frame of the first: both hold one object. Problems cycle through the pairs of five robots; the
second base is 0.6 to 1.2 m away and turned at random. Both tool poses are those of random
configurations within the limits, so every problem has a solution. The start is the home posture of
both arms.

A solution counts if both residuals are below 0.01 mm and 0.006°, and within the joint limits;
residuals are computed with MuJoCo, which shares no code with the solver. If mink is installed, it
solves the same problems, with the same starts and numbers of steps, as one `FrameTask` and one
`RelativeFrameTask`. To compare without changing this environment:

    python -m venv /tmp/with_mink && /tmp/with_mink/bin/pip install -e . mink daqp
    /tmp/with_mink/bin/python -m benchmarks.multi_arm_ik

Times are CPU times, because the machine may be busy.
"""

from __future__ import annotations

import argparse
import importlib.util
import itertools
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from benchmarks.ik import CONVERGED, ITERATIONS, RESTARTS, Judge
from benchmarks.measured_robots import MEASURED
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.kinematics.multi_arm import MultiArmKinematics, holding
from bt_dualarm.kinematics.solver import EXACT, STEP
from bt_dualarm.robots.robot_description import load_robot

Configurations = Mapping[str, Vector]


@dataclass(frozen=True)
class Problem:
    """One problem.

    Attributes:
        robots: Names of both robots; arm1 is the first one.
        bases: Poses of their base links in the world, by arm.
        target: Pose of arm1's tool in the world.
        relative: Pose of arm2's tool in arm1's tool frame.
    """

    robots: tuple[str, str]
    bases: dict[str, Pose]
    target: Pose
    relative: Pose


class PairJudge:
    """Tool poses of one pair of robots, computed by MuJoCo."""

    def __init__(self, robots: tuple[str, str]) -> None:
        self.robots = {f"arm{i}": load_robot(name) for i, name in enumerate(robots, start=1)}
        self._judges = {arm: Judge(robot) for arm, robot in self.robots.items()}

    def tool(self, problem: Problem, arm: str, q: Vector) -> Pose:
        """Pose of a tool in the world."""
        return problem.bases[arm] @ self._judges[arm].tool(q)

    def residuals(self, problem: Problem, q: Configurations) -> tuple[float, float]:
        """Larger errors of the first tool's pose and of the relative pose, in m and rad."""
        one, two = (self.tool(problem, arm, q[arm]) for arm in ("arm1", "arm2"))
        relative = one.inverse @ two
        return (
            max(one.distance(problem.target), relative.distance(problem.relative)),
            max(one.angle(problem.target), relative.angle(problem.relative)),
        )

    def solved(self, problem: Problem, q: Configurations) -> bool:
        """Whether a solution is exact and within the position limits."""
        inside = all(
            np.all(q[arm] >= robot.limits.lower) and np.all(q[arm] <= robot.limits.upper)
            for arm, robot in self.robots.items()
        )
        return inside and EXACT.holds(self.residuals(problem, q))


def draw(robots: tuple[str, str], judge: PairJudge, rng: np.random.Generator) -> Problem:
    """A random solvable problem of a pair of robots."""
    bearing, turn = rng.uniform(-np.pi, np.pi, 2)
    away = rng.uniform(0.6, 1.2)
    second = (away * np.cos(bearing), away * np.sin(bearing), rng.uniform(-0.2, 0.2))
    bases = {"arm1": Pose.identity(), "arm2": Pose.from_rpy(second, (0.0, 0.0, turn))}
    empty = Problem(robots, bases, Pose.identity(), Pose.identity())
    tools = [
        judge.tool(empty, arm, rng.uniform(robot.limits.lower, robot.limits.upper))
        for arm, robot in judge.robots.items()
    ]
    return Problem(robots, bases, tools[0], tools[0].inverse @ tools[1])


def homes(judge: PairJudge) -> dict[str, Vector]:
    """Home postures, by arm."""
    return {arm: robot.postures["home"] for arm, robot in judge.robots.items()}


def ours(problem: Problem, judge: PairJudge) -> Callable[[], Configurations | None]:
    """The solver of this project, set up for a problem."""
    arms = {arm: (robot, problem.bases[arm]) for arm, robot in judge.robots.items()}
    kinematics = MultiArmKinematics(arms)
    grasps = {"arm1": Pose.identity(), "arm2": problem.relative}
    targets = holding(grasps, problem.target)
    near = homes(judge)

    def solve() -> Configurations | None:
        try:
            return kinematics.solve(targets, near)
        except Failure:
            return None

    return solve


def minks(problem: Problem, judge: PairJudge) -> Callable[[], Configurations | None]:
    """The solver mink, set up for a problem, with the same number and kind of starts and steps.

    It takes the first solution; ours searches for three and takes the nearest.
    """
    import mink

    spec = mujoco.MjSpec()
    for arm, robot in judge.robots.items():
        child = mujoco.MjSpec.from_string(robot.urdf_text)
        child.compiler.fusestatic = False
        # The base link need not be the root of its URDF.
        base = judge._judges[arm].base
        root = problem.bases[arm] @ base.inverse
        frame = spec.worldbody.add_frame(pos=root.position, quat=root.quaternion)
        spec.attach(child, prefix=f"{arm}/", frame=frame)
        link = spec.body(f"{arm}/{robot.tool_link}")
        link.add_site(name=f"{arm}/tool", pos=robot.tool.position, quat=robot.tool.quaternion)
    model = spec.compile()
    joints = {
        arm: [model.joint(f"{arm}/{name}").qposadr[0] for name in robot.joints]
        for arm, robot in judge.robots.items()
    }
    configuration = mink.Configuration(model)
    tasks = [
        mink.FrameTask("arm1/tool", "site", position_cost=1.0, orientation_cost=1.0),
        mink.RelativeFrameTask(
            "arm2/tool", "site", "arm1/tool", "site", position_cost=1.0, orientation_cost=1.0
        ),
    ]
    for task, pose in zip(tasks, (problem.target, problem.relative), strict=True):
        task.set_target(mink.SE3(np.concatenate((pose.quaternion, pose.position))))
    names = [f"{arm}/{name}" for arm, robot in judge.robots.items() for name in robot.joints]
    limits = [
        mink.ConfigurationLimit(model),
        mink.VelocityLimit(model, dict.fromkeys(names, STEP)),
    ]
    near = np.concatenate(list(homes(judge).values()))
    lower = np.concatenate([robot.limits.lower for robot in judge.robots.values()])
    upper = np.concatenate([robot.limits.upper for robot in judge.robots.values()])
    shares = np.random.default_rng(0).uniform(0.0, 1.0, (RESTARTS, len(near)))
    low = np.maximum(lower, near - np.pi)
    high = np.minimum(upper, near + np.pi)
    starts = [near, *(low + shares * (high - low))]
    ids = [index for one in joints.values() for index in one]

    def solve() -> Configurations | None:
        for start in starts:
            state = configuration.q.copy()
            state[ids] = start
            configuration.update(state)
            for _ in range(ITERATIONS):
                velocity = mink.solve_ik(
                    configuration, tasks, 1.0, "daqp", damping=1e-8, limits=limits
                )
                configuration.integrate_inplace(velocity, 1.0)
                errors = [task.compute_error(configuration) for task in tasks]
                worst = max(
                    np.linalg.norm(part) for error in errors for part in (error[:3], error[3:])
                )
                if worst < 0.5 * CONVERGED:
                    q = configuration.q
                    return {arm: q[index].copy() for arm, index in joints.items()}
        return None

    return solve


SOLVERS = {"ours": ours, "mink": minks}


def main() -> None:
    """Print one line for each solver."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--targets", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    pairs = list(itertools.combinations_with_replacement(MEASURED, 2))
    judges: dict[tuple[str, str], PairJudge] = {}
    solvers = ["ours"] if importlib.util.find_spec("mink") is None else ["ours", "mink"]
    took: dict[str, list[float]] = {solver: [] for solver in solvers}
    residuals: dict[str, list[tuple[float, float]]] = {solver: [] for solver in solvers}
    wrong = dict.fromkeys(solvers, 0)
    for number in range(arguments.targets):
        first, second = pairs[number % len(pairs)]
        rng = np.random.default_rng((arguments.seed, number))
        robots = (first, second)
        judge = judges.setdefault(robots, PairJudge(robots))
        problem = draw(robots, judge, rng)
        for solver in solvers:
            solve = SOLVERS[solver](problem, judge)
            began = time.thread_time()
            q = solve()
            took[solver].append(1e3 * (time.thread_time() - began))
            if q is None:
                continue
            if judge.solved(problem, q):
                residuals[solver].append(judge.residuals(problem, q))
            else:
                wrong[solver] += 1
    for solver in solvers:
        far, turned = np.array(residuals[solver]).reshape(-1, 2).T
        times = np.array(took[solver])
        print(
            f"{solver}: {100 * len(far) / arguments.targets:.1f} % of {arguments.targets} solved, "
            f"{wrong[solver]} falsely reported as solved; median {np.median(times):.1f} ms, "
            f"95 % {np.quantile(times, 0.95):.1f} ms; residual median "
            f"{1e6 * np.median(far):.3f} µm, "
            f"largest {1e6 * far.max():.3f} µm and {np.degrees(turned.max()):.5f}°"
        )


if __name__ == "__main__":
    main()
