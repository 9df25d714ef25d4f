"""Every gripper on every robot forms one arm, whose nominal model has the plant's mass."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from bt_dualarm.core.pose import Vector
from bt_dualarm.robots.gripper import FINGERS, PALM, gripper_names
from bt_dualarm.robots.mjspec import PAD
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.sim.world import World
from tests.sim.worlds import ROBOTS, arm, box, file_of, world_with
from tests.sim.worlds import WORLD as FOLDER

GRIPPERS = gripper_names()


def mass_of(model: mujoco.MjModel, body: int) -> float:
    """Mass of a body and all its descendants, kg."""
    return float(model.body_subtreemass[body])


@pytest.mark.parametrize("gripper", GRIPPERS)
@pytest.mark.parametrize("robot", ROBOTS)
def test_nominal_arm_has_the_mass_of_the_plant(robot: str, gripper: str) -> None:
    """In the nominal model, the gripper is one rigid link with its mass."""
    world = world_with(robot, gripper=gripper)
    nominal = world.nominal["arm1"]
    name = f"arm1/{PALM}"
    plant = world.model.body(name).id
    assumed = nominal.model.body(name).id
    description = world.grippers["arm1"].gripper
    assert mass_of(world.model, plant) == pytest.approx(description.mass)
    assert mass_of(nominal.model, assumed) == pytest.approx(description.mass)
    assert nominal.model.nv == world.robots["arm1"].dof
    first = world.robots["arm1"].joints[0]
    bodies = (world.model.joint(f"arm1/{first}"), nominal.model.joint(f"arm1/{first}"))
    masses = (
        mass_of(world.model, bodies[0].bodyid[0]),
        mass_of(nominal.model, bodies[1].bodyid[0]),
    )
    assert masses[0] == pytest.approx(masses[1])


@pytest.mark.parametrize("gripper", GRIPPERS)
@pytest.mark.parametrize("robot", ROBOTS)
def test_tool_frame_is_between_the_pads(robot: str, gripper: str) -> None:
    """Its y axis is the closing direction, and at home there are no contacts."""
    world = world_with(robot, gripper=gripper)
    tool = world.arms["arm1"].tool_pose
    assumed = world.nominal["arm1"].tool_pose_at(world.hardware["arm1"].q)
    assert assumed.distance(tool) < 1e-9
    assert assumed.angle(tool) < 1e-9
    if world.grippers["arm1"].gripper.fingers:
        pads = [world.data.geom(f"arm1/{finger}/{PAD}").xpos for finger in FINGERS]
        middle = tool.inverse.apply(np.mean(pads, axis=0))
        assert np.abs(middle[:2]).max() < 1e-6
        assert abs(middle[2]) < 0.015
        apart = tool.inverse.turn(pads[0] - pads[1])
        assert abs(apart[1]) > 0.99 * np.linalg.norm(apart), "fingers open along y"
    assert world.data.ncon == 0


@pytest.mark.parametrize("gripper", GRIPPERS)
@pytest.mark.parametrize("robot", ROBOTS)
def test_payload_is_reduced_by_the_mass_of_the_gripper(robot: str, gripper: str) -> None:
    world = world_with(robot, gripper=gripper)
    description = world.grippers["arm1"].gripper
    bare = load_robot(robot, FOLDER)
    left = (
        description.payload
        if bare.payload is None
        else min(description.payload, bare.payload - description.mass)
    )
    assert world.robots["arm1"].payload == pytest.approx(left)


def test_gripper_replaces_the_original_hand() -> None:
    """The camera that was mounted on the hand keeps its pose."""
    bare = world_with("panda")
    mounted = world_with("panda", gripper="robotiq_2f85")
    names = {mounted.model.body(i).name for i in range(mounted.model.nbody)}
    assert not names & {"arm1/panda_hand", "arm1/panda_leftfinger", "arm1/panda_hand_tcp"}
    camera = {"mount": "wrist"}
    places = [
        World(file_of({"arm1": arm("panda", camera=camera, gripper=gripper)})).data.camera(
            "arm1/camera"
        )
        for gripper in (None, "robotiq_2f85")
    ]
    assert np.allclose(places[0].xpos, places[1].xpos, atol=1e-9)
    assert np.allclose(places[0].xmat, places[1].xmat, atol=1e-9)
    assert bare.model.nv == mounted.model.nv - 2


def test_franka_hand_as_gripper_agrees_with_the_fixed_hand() -> None:
    """The tool frame and gravity torques are the same; only the fingers can move."""
    bare = world_with("panda")
    mounted = world_with("panda", gripper="panda_hand")
    assert bare.arms["arm1"].tool_pose.distance(mounted.arms["arm1"].tool_pose) < 1e-9
    assert bare.arms["arm1"].tool_pose.angle(mounted.arms["arm1"].tool_pose) < 1e-6
    q = bare.hardware["arm1"].q
    gravity = [_gravity(world, q) for world in (bare, mounted)]
    assert np.allclose(gravity[0], gravity[1], atol=0.02)


def test_world_without_a_gripper_has_default_options() -> None:
    """MuJoCo's options are unchanged, and a step does no additional work."""
    bare = World(file_of({"arm1": arm("ur5")}, {"cube": box((0.5, 0, 0.1))}))
    option = bare.model.opt
    assert option.cone == mujoco.mjtCone.mjCONE_PYRAMIDAL
    assert (option.impratio, option.noslip_iterations) == (1.0, 0)
    assert not bare.on_forces
    held = World(file_of({"arm1": arm("ur5", gripper="robotiq_2f85")}))
    assert held.model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC


def test_arm_with_a_gripper_can_be_removed_and_spawned_again() -> None:
    """No part of it remains, and the gripper is open when spawned again."""
    world = World(
        file_of({"arm1": arm("ur5", gripper="robotiq_2f85"), "arm2": arm("ur3", (2, 0, 0))})
    )
    sizes = world.model.nbody, world.model.nu, world.model.neq, world.model.ntendon
    for _ in range(2):
        world.remove_arm("arm1")
        assert "arm1" not in world.grippers
        assert world.model.ntendon == world.model.neq == 0
        world.spawn_arm("arm1")
        assert (world.model.nbody, world.model.nu, world.model.neq, world.model.ntendon) == sizes
        assert world.grippers["arm1"].width == pytest.approx(0.085)


def _gravity(world: World, q: Vector) -> Vector:
    nominal = world.nominal["arm1"].model
    data = mujoco.MjData(nominal)
    data.qpos[:] = q
    mujoco.mj_forward(nominal, data)
    gravity: Vector = data.qfrc_bias.copy()
    return gravity
