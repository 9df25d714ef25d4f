"""Inverse dynamics of a single arm agree with the world's, including loads."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from bt_dualarm.control.dynamics import ArmDynamics
from bt_dualarm.core.pose import Pose
from bt_dualarm.sim.arm_models import NominalLoad
from bt_dualarm.sim.world import World
from tests.sim.worlds import ROBOTS, arm, box, file_of, world_with


@pytest.mark.parametrize("robot", ROBOTS)
def test_torques_agree_with_the_composed_world(robot: str) -> None:
    """The reference is M a + bias of the composed world, at random states."""
    world = world_with(robot)
    body = world.arms["arm1"]
    rng = np.random.default_rng(3)
    dynamics = ArmDynamics(world.nominal["arm1"])
    for _ in range(5):
        v, a = rng.uniform(-2.0, 2.0, (2, body.robot.dof))
        q = body.q + rng.uniform(-0.5, 0.5, body.robot.dof)
        world.data.qpos[body.qpos_ids] = q
        world.data.qvel[body.dof_ids] = v
        mujoco.mj_step1(world.model, world.data)
        wide, product = np.zeros((2, world.model.nv))
        wide[body.dof_ids] = a
        mujoco.mj_mulM(world.model, world.data, product, wide)
        expected = (product + world.data.qfrc_bias)[body.dof_ids]
        assert dynamics.moving(q, v, a) == pytest.approx(expected, abs=1e-9)


def test_torques_of_several_loads_add_up() -> None:
    """Torques are linear in the loads: those of two together are the sum of those of each."""
    nominal = world_with("panda").nominal["arm1"]
    rng = np.random.default_rng(5)
    q, v, a = rng.uniform(-1.0, 1.0, (3, 7))
    plate = box((0, 0, 0), mass=1.5).model_copy(update={"size": (0.3, 0.2, 0.01)})
    loads = [
        NominalLoad.of("plate", plate, Pose.from_rpy((0.1, -0.05, 0.2), (0.3, 0.2, 0.1))),
        NominalLoad.of("cube", box((0, 0, 0), mass=0.4), Pose.from_rpy((0.0, 0.3, 0.0))),
    ]
    bare = ArmDynamics(nominal).moving(q, v, a)
    alone = [ArmDynamics(nominal, [load]).moving(q, v, a) - bare for load in loads]
    together = ArmDynamics(nominal, loads).moving(q, v, a)
    assert together - bare == pytest.approx(sum(alone), abs=1e-9)


@pytest.mark.parametrize("robot", ["ur5", "panda"])
def test_load_adds_its_weight_times_the_jacobian(robot: str) -> None:
    """By the principle of virtual work, a load adds its weight times the Jacobian of its center."""
    obj = box((0.0, 0.0, 0.0), mass=2.0)
    world = World(file_of({"arm1": arm(robot)}))
    body = world.arms["arm1"]
    nominal = world.nominal["arm1"]
    pose = Pose.from_rpy((0.1, -0.05, 0.2), (0.3, 0.2, 0.1))
    bare = ArmDynamics(nominal).at_rest(body.q)
    full = ArmDynamics(nominal, [NominalLoad.of("load", obj, pose)]).at_rest(body.q)
    jacobian = np.zeros((3, world.model.nv))
    center = (body.tool_link_pose @ pose).position
    mujoco.mj_jac(world.model, world.data, jacobian, None, center, body.tool_body)
    weight = -2.0 * world.model.opt.gravity @ jacobian[:, body.dof_ids]
    assert full - bare == pytest.approx(weight, abs=1e-9)
