"""Accuracy of payload estimation: mass and center of mass of unknown loads.

    python -m benchmarks.payload_estimation [--robots ur5 panda ...] [--set lab] [--seeds 3]
                                            [--loads 8] [--gripper robotiq_2f85]

Every robot of the catalog stands in a random collision-free posture near home, swings a little
without a load, is given a cube of 0.1 to 3 kg, at most its payload, and swings again. A seed is one
robot with its own deviations from the model and its own posture. The estimated mass is compared
with the simulator's. Goal in `lab`: within 3 % or 20 g. A robot fails if the unknown load makes it
sag by more than the tracking error that the controller allows.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import mujoco
import numpy as np

from benchmarks.campaign import Campaign, add_options, registry
from benchmarks.measured_robots import MEASURED
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.control.controller import JointController
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.robots.gripper import load_gripper
from bt_dualarm.robots.robot import JointLimits, Robot
from bt_dualarm.robots.robot_description import load_robot, robot_names, with_gripper
from bt_dualarm.safety.failsafe import Reservations
from bt_dualarm.sim.world import World
from bt_dualarm.spec.node_types import NodeType
from bt_dualarm.testing import Tree
from bt_dualarm.trajectory.path_timing import point_to_point

PERIOD = 0.004
LIGHTEST_KG = 0.1
HEAVIEST_KG = 3.0
_AROUND = 0.25  # random range of the posture around home, rad
_SWING = np.deg2rad(10.0)
_EDGE = 0.06  # m; of the cube, which is 20 mm in front of the tool
_IN_TOOL = Pose.from_rpy((0.0, 0.0, 0.5 * _EDGE + 0.02))
_SIGNS = ((1, 1), (-1, 1), (1, -1), (-1, -1), (0, 0))  # of even and odd joints


@dataclass(frozen=True)
class Weight:
    """An estimate of a load.

    Attributes:
        true: True mass, kg.
        estimate: Estimated mass, kg.
        doubt: Reported standard deviation of the mass, kg.
        center_mm: Error of the center of mass, mm.
    """

    true: float
    estimate: float
    doubt: float
    center_mm: float

    @property
    def is_right(self) -> bool:
        """Whether the estimate meets the goal."""
        return abs(self.estimate - self.true) <= max(0.03 * self.true, 0.02)


def weighed(
    name: str,
    reality: str,
    seed: int,
    mass: float,
    kinds: Mapping[str, NodeType],
    gripper: str | None = None,
) -> Weight:
    """Estimate a cube with one robot, with or without a gripper on its flange."""
    robot = load_robot(name)
    if gripper is not None:
        robot = with_gripper(robot, load_gripper(gripper))
    fields = {"robot": name} if gripper is None else {"robot": name, "gripper": gripper}
    rng = np.random.default_rng([seed, 1])
    tree = _tree(reality, seed, mass, fields)
    posture = _clear_posture(tree, robot, rng, kinds)
    at = Kinematics(robot, Pose.identity()).forward(posture) @ _IN_TOOL
    place = {"xyz": at.position.tolist(), "quat": at.quaternion.tolist()}
    tree["objects"]["load"] |= {"pose": place, "spawned": False}
    world = World(load_tree_file(tree, kinds), seed)
    controller = JointController(world, "arm1", PERIOD, Reservations())
    swing(world, controller, posture)
    world.spawn_object("load", world.arms["arm1"].tool_pose @ _IN_TOOL)
    world.attach("arm1", "load")
    swing(world, controller, posture)
    (load,) = world.nominal["arm1"].loads
    body = world.model.body("load")
    (held,) = world.attachments
    center = held.relative.apply(body.ipos)
    center_error_mm = 1e3 * float(np.linalg.norm(load.pose.position - center))
    return Weight(float(body.mass[0]), load.mass or 0.0, load.mass_doubt, center_error_mm)


def _tree(reality: str, seed: int, mass: float, fields: Tree) -> Tree:
    """A tree file with an arm and a cube out of reach."""
    load = {"shape": "box", "size": [_EDGE] * 3, "mass": mass, "pose": {"xyz": [0, 0, 9]}}
    return {
        "bt_dualarm": 1,
        "name": "weighing",
        "world": {
            "scene": "empty",
            "seed": seed,
            "reality": {"set": reality, "payload": {"known": False}},
        },
        "objects": {"load": load},
        "arms": {"arm1": fields | {"base": {"xyz": [0.0, 0.0, 0.0]}, "tree": "succeed"}},
    }


def _clear_posture(
    tree: Tree, robot: Robot, rng: np.random.Generator, kinds: Mapping[str, NodeType]
) -> Vector:
    """A posture in whose swings neither arm nor load touches anything.

    A load that rests on something appears lighter. With a gripper the tool is farther out, and the
    home postures of some arms are folded.
    """
    world = World(load_tree_file(tree, kinds))
    home = robot.postures["home"]
    around = _AROUND
    while True:
        posture = home + rng.uniform(-around, around, robot.dof)
        goals = [_swung(posture, even, odd, robot.limits) for even, odd in _SIGNS]
        if not any(_touches(world, q) for q in goals):
            return posture
        around *= 1.05  # where postures near home always collide


def _touches(world: World, q: Vector) -> bool:
    data = mujoco.MjData(world.model)
    arm = world.arms["arm1"]
    data.qpos[:] = world.data.qpos
    data.qpos[arm.qpos_ids] = q
    at = world.nominal["arm1"].tool_pose_at(q) @ _IN_TOOL
    address = int(world.model.joint(int(world.model.body("load").jntadr[0])).qposadr[0])
    data.qpos[address : address + 7] = (*at.position, *at.quaternion)
    mujoco.mj_kinematics(world.model, data)
    mujoco.mj_comPos(world.model, data)
    mujoco.mj_collision(world.model, data)
    return any(contact.dist < 0.0 for contact in data.contact)


def _swung(posture: Vector, even: int, odd: int, limits: JointLimits) -> Vector:
    parity = np.arange(len(posture)) % 2
    goal = posture + _SWING * np.where(parity == 0, even, odd)
    swung: Vector = np.clip(goal, limits.lower, limits.upper)
    return swung


def swing(world: World, controller: JointController, posture: Vector) -> None:
    """Swing all joints about a posture, even and odd ones in phase and in antiphase."""
    limits = world.robots["arm1"].limits
    for even, odd in _SIGNS:
        goal = _swung(posture, even, odd, limits)
        motion = point_to_point(controller.setpoint.q, goal, limits.scaled(0.5), PERIOD)
        controller.follow(motion)
        for _ in range(len(motion) + 10):
            controller.update(world.time)
            for _ in range(round(PERIOD / world.timestep)):
                world.step()
        if controller.fault is not None:
            raise controller.fault


def evaluate(
    name: str, reality: str, seed: int, mass: float, gripper: str | None
) -> dict[str, Any]:
    """Estimate of one mass by one robot, or why it failed."""
    try:
        found = weighed(name, reality, seed, mass, registry().kinds, gripper)
    except Failure as failure:
        message = f"; {mass:.2g} kg, seed {seed}: {failure}"
        return {"outcome": "FAILURE", "code": failure.code, "failed": message}
    return {"outcome": "SUCCESS" if found.is_right else "FAILURE", "weight": asdict(found)}


def main() -> None:
    """Print a line per robot."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--robots", nargs="+", default=MEASURED, choices=robot_names())
    parser.add_argument("--set", default="lab")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--loads", type=int, default=5)
    parser.add_argument("--gripper", help="gripper on the flange of all robots")
    add_options(parser)
    arguments = parser.parse_args()
    with Campaign(arguments) as campaign:
        for name in arguments.robots:
            print(line(name, arguments, campaign), flush=True)


def line(name: str, arguments: argparse.Namespace, campaign: Campaign) -> str:
    """Table row of a robot, over all its seeds and masses."""
    reality = arguments.set
    most = min(HEAVIEST_KG, load_robot(name).payload or HEAVIEST_KG)
    settings = {"name": name, "reality": reality, "gripper": arguments.gripper}
    masses = np.geomspace(LIGHTEST_KG, most, arguments.loads).tolist()
    cases = [
        {**settings, "seed": seed, "mass": mass}
        for seed in range(arguments.seeds)
        for mass in masses
    ]
    results = [result for _, result in campaign.run(evaluate, cases)]
    found = [Weight(**result["weight"]) for result in results if "weight" in result]
    failed = [result["failed"] for result in results if "failed" in result]
    if not found:
        return f"{name:6} {reality}: none of {len(failed)} masses was estimated" + "".join(failed)
    errors = np.array([one.estimate - one.true for one in found])
    shares = np.abs(errors) / np.array([one.true for one in found])
    z = np.abs(errors) / np.maximum([one.doubt for one in found], 1e-9)
    return (
        f"{name:6} {reality}: {sum(one.is_right for one in found)} of {len(found) + len(failed)} "
        f"within 3 % or 20 g; at most {1e3 * np.abs(errors).max():.0f} g, "
        f"{100 * shares.max():.1f} %; {np.mean(z < 1):.2f} within one standard deviation, "
        f"{np.mean(z < 2):.2f} within two, at most {z.max():.1f}; "
        f"center within {max(one.center_mm for one in found):.1f} mm" + "".join(failed)
    )


if __name__ == "__main__":
    main()
