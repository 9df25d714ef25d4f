"""Fingers and cups follow their commands: speed, then force, whatever is between them."""

from __future__ import annotations

from typing import Literal

import mujoco
import numpy as np
import pytest

from bt_dualarm.core.pose import Pose
from bt_dualarm.robots.gripper import gripper_names, load_gripper
from bt_dualarm.robots.mjspec import PAD
from bt_dualarm.sim.grippers import GripperCommand
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.values import PoseSpec
from tests.sim.worlds import arm, file_of, world_with

FINGERED = tuple(name for name in gripper_names() if load_gripper(name).fingers)
JOINTS = ("arm1/gripper/left", "arm1/gripper/right")
REALITIES = ("ideal", "lab", "rough")


def world_around(
    gripper: str, edge: float, reality: str = "ideal", timestep: float = 0.002
) -> World:
    """A world with a fixed plate, of thickness ``edge`` in m, between the fingers."""
    tool = world_with("ur5", gripper=gripper).arms["arm1"].tool_pose
    pose = PoseSpec(xyz=tuple(tool.position.tolist()), quat=tuple(tool.quaternion.tolist()))
    plate = ObjectSpec(shape="box", size=(0.04, edge, 0.02), mass=1.0, pose=pose, fixed=True)
    arms = {"arm1": arm("ur5", gripper=gripper)}
    return World(file_of(arms, {"plate": plate}, reality=reality, timestep=timestep))


def let_run(world: World, seconds: float) -> list[tuple[float, float]]:
    """True openings (m) and speeds (m/s) of the fingers; springs hold heavy joints in place."""
    model = world.model
    data = world.data
    step = world.timestep
    model.opt.gravity[:] = 0.0
    seen = []
    body = world.arms["arm1"]
    dofs = body.dof_ids
    at = body.q.copy()
    model.dof_armature[dofs] = 5.0
    fingers = [model.joint(i) for i in range(model.njnt) if model.joint(i).name in JOINTS]
    for _ in range(round(seconds / step)):
        data.qfrc_applied[dofs] = 5.0 * (0.25 * (at - body.q) / step - body.v) / step
        world.step()
        opening = sum(float(data.qpos[joint.qposadr[0]]) for joint in fingers)
        rate = sum(float(data.qvel[joint.dofadr[0]]) for joint in fingers)
        seen.append((opening, rate))
    return seen


def pressed(world: World) -> float:
    """Mean of the true normal forces on the two pads, N."""
    sums = {"left": 0.0, "right": 0.0}
    mujoco.mj_forward(world.model, world.data)
    for i, contact in enumerate(world.data.contact):
        force = np.zeros(6)
        mujoco.mj_contactForce(world.model, world.data, i, force)
        for geom in contact.geom:
            name = world.model.geom(geom).name
            if name.endswith(PAD):
                sums[name.split("/")[2]] += force[0]
    return 0.5 * sum(sums.values())


@pytest.mark.parametrize("reality", REALITIES)
@pytest.mark.parametrize("gripper", FINGERED)
def test_grip_force_is_the_commanded_one_at_any_width(gripper: str, reality: str) -> None:
    """A position servo's force would grow with the width. A `rough` drive errs by up to 5 %."""
    description = load_gripper(gripper)
    commanded = 0.5 * (description.force.least + description.force.most)
    for edge in (0.002, 0.5 * description.stroke, description.stroke - 0.005):
        world = world_around(gripper, edge, reality)
        hardware = world.grippers["arm1"]
        hardware.command(GripperCommand(0.0, description.speed.most, commanded))
        let_run(world, 1.0 + description.stroke / description.speed.most)
        assert hardware.force == pytest.approx(commanded)
        assert hardware.width == pytest.approx(edge, abs=max(1.5 * description.resolution, 3e-4))
        assert pressed(world) == pytest.approx(commanded, rel=0.08)


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.004])
@pytest.mark.parametrize("gripper", FINGERED)
def test_finger_speed_is_the_commanded_one(gripper: str, timestep: float) -> None:
    """Fingers do not exceed the speed or overshoot the goal, at any time step."""
    description = load_gripper(gripper)
    world = (
        world_with("ur5", gripper=gripper)
        if timestep == 0.002
        else World(file_of({"arm1": arm("ur5", gripper=gripper)}, timestep=timestep))
    )
    hardware = world.grippers["arm1"]
    for goal, speed in (
        (0.4 * description.stroke, description.speed.most),
        (description.stroke, description.speed.most / 2),
    ):
        begin = hardware.width
        hardware.command(GripperCommand(goal, speed, description.force.most))
        took = abs(goal - begin) / speed
        seen = np.array(let_run(world, took + 0.3))
        middle = seen[round(0.3 * took / timestep) : round(0.7 * took / timestep), 1]
        assert np.abs(middle) == pytest.approx(speed, rel=0.02)
        assert np.abs(seen[:, 1]).max() <= 1.02 * speed
        assert seen[-1, 0] == pytest.approx(goal, abs=2e-4)
        assert min(begin, goal) - 2e-4 <= seen[:, 0].min()
        assert seen[:, 0].max() <= max(begin, goal) + 2e-4


@pytest.mark.parametrize("gripper", FINGERED)
def test_fingers_without_an_object_close(gripper: str) -> None:
    """They press on their stops, and their width shows that nothing is between them."""
    world = world_with("ur5", gripper=gripper)
    description = world.grippers["arm1"].gripper
    hardware = world.grippers["arm1"]
    hardware.command(GripperCommand(0.0, description.speed.most, description.force.most))
    let_run(world, 1.0 + description.stroke / description.speed.most)
    assert hardware.force == pytest.approx(description.force.most)
    assert hardware.width < 5e-4


@pytest.mark.parametrize(
    ("shape", "size", "tight"),
    [
        ("box", (0.05, 0.05, 0.05), True),
        ("box", (0.03, 0.03, 0.05), False),  # the lip overhangs
        ("cylinder", (0.03, 0.05), True),
        ("cylinder", (0.015, 0.05), False),
        ("sphere", (0.03,), False),  # the lip does not adapt to that
        ("sphere", (0.5,), True),
    ],
)
def test_cup_seals_only_if_its_whole_lip_touches_the_object(
    shape: Literal["box", "cylinder", "sphere"], size: tuple[float, ...], tight: bool
) -> None:
    tool = world_with("ur5", gripper="suction_cup").arms["arm1"].tool_pose
    half = size[0] if shape == "sphere" else size[-1] / 2
    at = tool @ Pose.from_rpy((0.0, 0.0, half - 5e-4), (0.0, 0.0, 0.0))
    pose = PoseSpec(xyz=tuple(at.position.tolist()), quat=tuple(at.quaternion.tolist()))
    obj = ObjectSpec(shape=shape, size=size, mass=0.1, pose=pose, fixed=True)
    world = World(file_of({"arm1": arm("ur5", gripper="suction_cup")}, {"thing": obj}))
    hardware = world.grippers["arm1"]
    hardware.command(GripperCommand(0.0, 1.0, 60.0))
    let_run(world, 0.4)
    assert hardware.vacuum == pytest.approx(1.0 if tight else 0.0, abs=0.01)
    hardware.command(GripperCommand(1.0, 1.0, 60.0))
    let_run(world, 0.4)
    assert hardware.vacuum < 0.01
