"""Inverse kinematics on random targets: success rate, time, and false solutions.

    python benchmarks/ik.py [--targets 500] [--audit 10000] [--robots ur5 panda]

A target is the tool pose of a random configuration within the limits; the start is the home
posture. The audit adds targets out of reach and at singularities, and checks every solution with
MuJoCo's kinematics. If mink is installed (`pip install mink daqp`), it solves the same targets.
Times are CPU times, because the machine may be busy.
"""

from __future__ import annotations

import argparse
import importlib.util
import time
from collections.abc import Callable

import mujoco
import numpy as np

from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.kinematics.solver import STEP, Tolerance
from bt_dualarm.robots.robot import Robot
from bt_dualarm.robots.robot_description import load_robot, robot_names

TOLERANCE = Tolerance(1e-4, 1e-3)
RESTARTS = 40
ITERATIONS = 40
CONVERGED = 1e-5
"""Residual in m and rad at which mink has converged, as required by our solver."""


class Judge:
    """Tool poses computed by MuJoCo, which shares no code with the solver."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        spec = mujoco.MjSpec.from_string(robot.urdf_text)
        spec.compiler.fusestatic = False  # the base and tool links must keep their names
        self.model = spec.compile()
        self._data = mujoco.MjData(self.model)
        self._ids = [self.model.joint(name).qposadr[0] for name in robot.joints]

    def state(self, q: Vector) -> Vector:
        """All positions of the model, with the arm's joints at ``q``."""
        self._data.qpos[self._ids] = q
        state: Vector = self._data.qpos.copy()
        return state

    def angles(self, state: Vector) -> Vector:
        """Positions of the arm's joints from all positions of the model."""
        chosen: Vector = state[self._ids]
        return chosen

    @property
    def base(self) -> Pose:
        """The base link in the model's world."""
        mujoco.mj_kinematics(self.model, self._data)
        return self._link(self._robot.base_link)

    def tool(self, q: Vector) -> Pose:
        """The tool in the base link's frame."""
        self.state(q)
        return self.base.inverse @ (self._link(self._robot.tool_link) @ self._robot.tool)

    def solved(self, q: Vector, target: Pose) -> bool:
        """Whether a solution is within the tolerance and the position limits."""
        tool = self.tool(q)
        limits = self._robot.limits
        inside = bool(np.all(q >= limits.lower) and np.all(q <= limits.upper))
        near = tool.distance(target) <= TOLERANCE.position and tool.angle(target) <= TOLERANCE.angle
        return inside and near

    def _link(self, name: str) -> Pose:
        body = self.model.body(name).id
        return Pose(self._data.xpos[body].copy(), self._data.xquat[body].copy())


def reachable(robot: Robot, judge: Judge, rng: np.random.Generator) -> Pose:
    """The tool pose of a random configuration."""
    return judge.tool(rng.uniform(robot.limits.lower, robot.limits.upper))


def awkward(robot: Robot, judge: Judge, rng: np.random.Generator) -> Pose:
    """A target that is singular, beyond reach, randomly oriented, or anywhere."""
    q = rng.uniform(robot.limits.lower, robot.limits.upper)
    kind = rng.integers(4)
    if kind == 0:
        q[rng.integers(len(q))] = 0.0  # stretched elbow or aligned wrist
        return judge.tool(np.clip(q, robot.limits.lower, robot.limits.upper))
    tool = judge.tool(q)
    if kind == 1:
        return Pose(tool.position * rng.uniform(1.0, 1.2), tool.quaternion)
    turned = rng.normal(size=4)
    turned /= np.linalg.norm(turned)
    if kind == 2:
        return Pose(tool.position, turned)
    return Pose(rng.uniform(-1.5, 1.5, 3), turned)


def timed(
    solve: Callable[[Pose], Vector | None], targets: list[Pose], judge: Judge
) -> tuple[float, Vector]:
    """Share of targets solved, and CPU time of each in ms."""
    good = 0
    took = []
    for target in targets:
        began = time.thread_time()
        q = solve(target)
        took.append(1e3 * (time.thread_time() - began))
        good += q is not None and judge.solved(q, target)
    return good / len(targets), np.array(took)


def ours(robot: Robot) -> Callable[[Pose], Vector | None]:
    """The solver of this project, from the home posture."""
    kinematics = Kinematics(robot, Pose.identity())
    home = robot.postures["home"]

    def solve(target: Pose) -> Vector | None:
        try:
            return kinematics.solve(target, home, TOLERANCE)
        except Failure:
            return None

    return solve


def minks(robot: Robot, judge: Judge) -> Callable[[Pose], Vector | None]:
    """The solver mink on the same model, with the same number and kind of starts and steps.

    It takes the first solution; ours searches for three and takes the nearest.
    """
    import mink

    model = judge.model
    configuration = mink.Configuration(model)
    task = mink.FrameTask(robot.tool_link, "body", position_cost=1.0, orientation_cost=1.0)
    limits = [
        mink.ConfigurationLimit(model),
        mink.VelocityLimit(model, dict.fromkeys(robot.joints, STEP)),
    ]
    home = robot.postures["home"]
    lower = robot.limits.lower
    upper = robot.limits.upper
    shares = np.random.default_rng(0).uniform(0.0, 1.0, (RESTARTS, len(home)))
    low = np.maximum(lower, home - np.pi)
    high = np.minimum(upper, home + np.pi)
    starts = [home, *(low + shares * (high - low))]

    def solve(target: Pose) -> Vector | None:
        goal = judge.base @ target @ robot.tool.inverse
        task.set_target(mink.SE3(np.concatenate((goal.quaternion, goal.position))))
        for start in starts:
            configuration.update(judge.state(start))
            for _ in range(ITERATIONS):
                velocity = mink.solve_ik(
                    configuration, [task], 1.0, "daqp", damping=1e-8, limits=limits
                )
                configuration.integrate_inplace(velocity, 1.0)
                error = task.compute_error(configuration)
                if max(np.linalg.norm(error[:3]), np.linalg.norm(error[3:])) < CONVERGED:
                    return judge.angles(configuration.q)
        return None

    return solve


def audit(robot: Robot, judge: Judge, count: int) -> tuple[int, int]:
    """Numbers of awkward targets reported as solved, and of those reported falsely."""
    rng = np.random.default_rng(1)
    solve = ours(robot)
    reported = 0
    wrong = 0
    for _ in range(count):
        target = awkward(robot, judge, rng)
        q = solve(target)
        reported += q is not None
        wrong += q is not None and not judge.solved(q, target)
    return reported, wrong


def main() -> None:
    """Print two lines for each robot."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--targets", type=int, default=500)
    parser.add_argument("--audit", type=int, default=10_000)
    parser.add_argument("--robots", nargs="+", default=["ur5", "panda"], choices=robot_names())
    arguments = parser.parse_args()
    for name in arguments.robots:
        robot = load_robot(name)
        judge = Judge(robot)
        rng = np.random.default_rng(0)
        targets = [reachable(robot, judge, rng) for _ in range(arguments.targets)]
        solvers = {"ours": ours(robot)}
        if importlib.util.find_spec("mink") is not None:
            solvers["mink"] = minks(robot, judge)
        for solver, solve in solvers.items():
            share, took = timed(solve, targets, judge)
            print(
                f"{name:6} {solver}: {100 * share:.2f} % of {len(targets)} solved, "
                f"median {np.median(took):.2f} ms, 95 % {np.quantile(took, 0.95):.2f} ms"
            )
        reported, wrong = audit(robot, judge, arguments.audit)
        print(
            f"{name:6} audit: {reported} of {arguments.audit} reported as solved, {wrong} falsely"
        )


if __name__ == "__main__":
    main()
