"""Loads of many shapes at every robot of the catalog: carried, or refused before moving?

    python -m benchmarks.loads [--count 200] [--seed 1]

Plates, rods, cubes and off-center weights, of 0.1 kg to the robot's payload and up to 0.6 m wide or
off center, are attached to the tool. The arm then moves at full speed to a configuration up to
0.6 rad away in each joint and has half a second to come to rest. A load counts as carried if the
controller has no fault, no joint exceeds 1.05 times its velocity limit, and the arm rests within
0.0005 rad of its goal. Contacts of the loads are disabled.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import mujoco
import numpy as np

from benchmarks.campaign import Campaign, add_options, registry
from benchmarks.measured_robots import MEASURED
from bt_dualarm.arm.motions import SETTLED_RAD
from bt_dualarm.arm.payload import PayloadCheck
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.control.controller import OVERSPEED, JointController
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.safety.failsafe import Reservations
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry
from bt_dualarm.trajectory.path_timing import point_to_point
from bt_dualarm.trajectory.trajectory import Trajectory

KINDS = ("plate", "rod", "cube", "aside")
PERIOD = 0.004
BASE = Pose.from_rpy((0.0, 0.0, 0.8))
_AFTER_S = 0.5
_SLOWEST = 3.0  # times the duration of the motion: the guard halves the speed near objects
_WIDEST = 0.6


@dataclass(frozen=True)
class Case:
    """A box at a robot's tool.

    Attributes:
        robot: Name in the catalog.
        kind: One of `KINDS`.
        mass: kg.
        size: Edges in m.
        place: Position of its center in the tool frame, m.
        seed: Seed of the goal.
    """

    robot: str
    kind: str
    mass: float
    size: tuple[float, float, float]
    place: tuple[float, float, float]
    seed: int


def cases(count: int, seed: int) -> Iterator[Case]:
    """Random loads, cycling through robots and kinds."""
    rng = np.random.default_rng(seed)
    robots = MEASURED
    for number in range(count):
        robot = robots[number % len(robots)]
        kind = KINDS[number // len(robots) % len(KINDS)]
        mass = float(np.exp(rng.uniform(np.log(0.1), np.log(load_robot(robot).payload or 1.0))))
        wide = float(rng.uniform(0.1, _WIDEST))
        error = float(rng.uniform(-_WIDEST, _WIDEST))
        along = bool(rng.integers(2))
        size, place = {
            "plate": ((wide, wide, 0.01), (0.0, 0.0, 0.005)),
            "rod": ((0.02, 0.02, wide), (0.0, 0.0, wide / 2))
            if along
            else ((wide, 0.02, 0.02), (0.0, 0.0, 0.01)),
            "cube": ((wide / 2, wide / 2, wide / 2), (0.0, 0.0, wide / 4)),
            "aside": ((0.05, 0.05, 0.05), (error, 0.0, 0.03) if along else (0.0, error, 0.03)),
        }[kind]
        yield Case(robot, kind, mass, size, place, seed + number)


def world_with_load(case: Case, skills: Registry) -> World:
    """A world with the load at the tool."""
    robot = load_robot(case.robot)
    tool = Kinematics(robot, BASE).forward(robot.postures["home"])
    at = tool @ Pose.from_rpy(case.place)
    place = {"xyz": at.position.tolist(), "quat": at.quaternion.tolist()}
    obj = {"shape": "box", "size": list(case.size), "mass": case.mass, "pose": place}
    base = {"xyz": BASE.position.tolist()}
    tree = {
        "bt_dualarm": 1,
        "name": "loads",
        "world": {"scene": "empty"},
        "objects": {"load": obj},
        "arms": {"arm1": {"robot": case.robot, "base": base, "tree": "succeed"}},
    }
    world = World(load_tree_file(tree, skills.kinds))
    world.attach("arm1", "load")
    geom = world.object_geom("load")
    world.model.geom_contype[geom] = world.model.geom_conaffinity[geom] = 0
    mujoco.mj_step1(world.model, world.data)  # discards the existing contacts
    return world


def free_motion(world: World, controller: JointController, seed: int) -> Trajectory:
    """A motion to a nearby configuration, without self-collision."""
    rng = np.random.default_rng(seed)
    limits = world.robots["arm1"].limits
    here = controller.setpoint.q
    checker = CollisionChecker(world, "arm1")
    while True:
        goal = np.clip(here + rng.uniform(-0.6, 0.6, len(here)), limits.lower, limits.upper)
        motion = point_to_point(here, goal, limits, PERIOD)
        if all(checker.contact(q) is None for q in motion.q[::10]):
            return motion


def carry(case: Case, skills: Registry) -> tuple[str, float]:
    """Outcome of a load, and the largest joint velocity as a fraction of its limit.

    The outcome is ``carried``, ``refused`` or a description of the failure.
    """
    world = world_with_load(case, skills)
    controller = JointController(world, "arm1", PERIOD, Reservations())
    body = world.arms["arm1"]
    limits = world.robots["arm1"].limits
    motion = free_motion(world, controller, case.seed)
    try:
        motion = PayloadCheck(world, "arm1").within_efforts(motion)
    except Failure as refusal:
        return ("refused" if refusal.code == "OVERLOADED" else str(refusal)), 0.0
    controller.follow(motion)
    steps_per_period = round(PERIOD / world.timestep)
    fastest = 0.0
    remaining_s = _AFTER_S
    step = 0
    while remaining_s > 0.0 and world.time < _SLOWEST * motion.duration + 1.0:
        step = step + 1
        remaining_s = remaining_s - world.timestep * (controller.motion is None)
        if step % steps_per_period == 1:
            controller.update(world.time)
        world.step()
        fastest = max(fastest, float((np.abs(body.v) / limits.velocity).max()))
    if fastest > OVERSPEED or controller.fault is not None:
        return f"fault: {controller.fault}", fastest
    error = float(np.abs(body.q - motion.q[-1]).max())
    has_settled = controller.at_rest and error < SETTLED_RAD
    return ("carried" if has_settled else f"{error:.2g} rad from its goal"), fastest


def run_case(**fields: Any) -> dict[str, Any]:  # Any: fields of `Case`
    """Outcome of a load and the largest joint velocity."""
    outcome, fastest = carry(_case_of(fields), registry())
    is_good = outcome in ("carried", "refused")
    return {"outcome": "SUCCESS" if is_good else "FAILURE", "code": outcome, "fastest": fastest}


def _case_of(fields: Mapping[str, Any]) -> Case:
    vectors = {name: tuple(fields[name]) for name in ("size", "place")}
    return Case(**{**fields, **vectors})


def main() -> None:
    """Print the failures, then the counts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    add_options(parser)
    arguments = parser.parse_args()
    counts = Counter[str]()
    most = 0.0
    listed = [asdict(case) for case in cases(arguments.count, arguments.seed)]
    with Campaign(arguments) as campaign:
        for fields, found in campaign.run(run_case, listed):
            outcome, fastest = found["code"], found["fastest"]
            most = max(most, fastest)
            counts[outcome if outcome in ("carried", "refused") else "failed"] += 1
            if outcome not in ("carried", "refused"):
                print(_case_of(fields), outcome, f"{fastest:.3f}", flush=True)
        print(
            f"{arguments.count} loads: {counts['carried']} carried, {counts['refused']} refused "
            f"before moving, {counts['failed']} failed; fastest joint {most:.4f} of its limit"
        )


if __name__ == "__main__":
    main()
