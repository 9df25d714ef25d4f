"""Every gripper on every robot: one arm, whose nominal model weighs what the plant weighs."""

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


def below(model: mujoco.MjModel, body: int) -> float:
    """Mass of a body and of all that hangs on it."""
    return float(model.body_subtreemass[body])


@pytest.mark.parametrize("gripper", GRIPPERS)
@pytest.mark.parametrize("robot", ROBOTS)
def test_the_nominal_arm_weighs_what_the_plant_weighs(robot: str, gripper: str) -> None:
    """The gripper is one rigid link to whoever controls the arm, with its mass and center."""
    world = world_with(robot, gripper=gripper)
    nominal = world.nominal["arm1"]
    name = f"arm1/{PALM}"
    plant = world.model.body(name).id
    believed = nominal.model.body(name).id
    page = world.grippers["arm1"].gripper
    assert below(world.model, plant) == pytest.approx(page.mass)
    assert below(nominal.model, believed) == pytest.approx(page.mass)
    assert nominal.model.nv == world.robots["arm1"].dof
    first = world.robots["arm1"].joints[0]
    bodies = (world.model.joint(f"arm1/{first}"), nominal.model.joint(f"arm1/{first}"))
    masses = (below(world.model, bodies[0].bodyid[0]), below(nominal.model, bodies[1].bodyid[0]))
    assert masses[0] == pytest.approx(masses[1])


@pytest.mark.parametrize("gripper", GRIPPERS)
@pytest.mark.parametrize("robot", ROBOTS)
def test_the_tool_frame_is_where_things_are_held(robot: str, gripper: str) -> None:
    """Between the pads, z out of the gripper; and nothing touches anything at home."""
    world = world_with(robot, gripper=gripper)
    tool = world.arms["arm1"].tool_pose
    believed = world.nominal["arm1"].tool_pose_at(world.hardware["arm1"].q)
    assert believed.distance(tool) < 1e-9
    assert believed.angle(tool) < 1e-9
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
def test_payload_is_what_is_left(robot: str, gripper: str) -> None:
    world = world_with(robot, gripper=gripper)
    page = world.grippers["arm1"].gripper
    bare = load_robot(robot, FOLDER)
    left = page.payload if bare.payload is None else min(page.payload, bare.payload - page.mass)
    assert world.robots["arm1"].payload == pytest.approx(left)


def test_the_stock_hand_comes_off() -> None:
    """And the camera that was on it stays where it was."""
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


def test_the_hand_on_its_own_arm_is_where_it_always_was() -> None:
    """Its tool frame and its fingers' tips; only that they can move now."""
    bare = world_with("panda")
    mounted = world_with("panda", gripper="panda_hand")
    assert bare.arms["arm1"].tool_pose.distance(mounted.arms["arm1"].tool_pose) < 1e-9
    assert bare.arms["arm1"].tool_pose.angle(mounted.arms["arm1"].tool_pose) < 1e-6
    q = bare.hardware["arm1"].q
    gravity = [_gravity(world, q) for world in (bare, mounted)]
    assert np.allclose(gravity[0], gravity[1], atol=0.02)


def test_without_a_gripper_nothing_changes() -> None:
    """No option of the world is another, and nothing more is done in a step."""
    bare = World(file_of({"arm1": arm("ur5")}, {"cube": box((0.5, 0, 0.1))}))
    option = bare.model.opt
    assert option.cone == mujoco.mjtCone.mjCONE_PYRAMIDAL
    assert (option.impratio, option.noslip_iterations) == (1.0, 0)
    assert not bare.on_forces
    held = World(file_of({"arm1": arm("ur5", gripper="robotiq_2f85")}))
    assert held.model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC


def test_an_arm_with_a_gripper_comes_and_goes() -> None:
    """Nothing of it stays behind, and what comes again is open."""
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
