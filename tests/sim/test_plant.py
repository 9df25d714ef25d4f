"""The plant deviates from the robot description as sampled by the seed, unknown to the arm."""

from __future__ import annotations

from itertools import product
from typing import Any

import mujoco
import numpy as np
import pytest

from bt_dualarm.control.dynamics import ArmDynamics
from bt_dualarm.core.pose import Vector, camera_pose
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import REALITY_SETS
from bt_dualarm.spec.values import PoseSpec
from tests.families import some
from tests.sim.worlds import ROBOTS, arm, box, file_of


def real(robot: str, seed: int = 0, reality: str = "lab", **fields: Any) -> World:
    """A world with one robot, sampled by a seed."""
    return World(file_of({"arm1": arm(robot, **fields)}, reality=reality), seed)


def masses(model: mujoco.MjModel) -> dict[str, float]:
    return {
        model.body(i).name: float(model.body_mass[i])
        for i in range(1, model.nbody)
        if model.body_mass[i] > 0 and model.body(i).name.startswith("arm1/")
    }


def true_rotors(world: World) -> Vector:
    rotors: Vector = world.model.dof_armature[world.arms["arm1"].dof_ids]
    return rotors


@pytest.mark.parametrize(("robot", "reality"), some(product(ROBOTS, ["lab", "rough"]), 3))
def test_link_masses_deviate_within_the_declared_range(robot: str, reality: str) -> None:
    world = real(robot, 1, reality)
    true = masses(world.model)
    nominal_values = masses(world.nominal["arm1"].model)
    assert true.keys() >= nominal_values.keys()
    deviations = np.array([true[name] / nominal_values[name] - 1 for name in nominal_values])
    most = REALITY_SETS[reality].links.mass.most
    assert 0.2 * most < np.abs(deviations).max() <= most + 1e-9
    assert masses(real(robot, 1, reality).model) == true
    assert masses(real(robot, 2, reality).model) != true
    ideal = masses(real(robot, 1, "ideal").model)
    assert (true_rotors(world) > 0).all()
    assert {name: ideal[name] for name in nominal_values} == pytest.approx(
        nominal_values, rel=1e-12
    )


@pytest.mark.parametrize("robot", ROBOTS)
def test_nominal_arm_equals_the_plant_in_ideal_reality(robot: str) -> None:
    """Inertia, bias and tool pose agree bit for bit, in random states."""
    world = real(robot, reality="ideal")
    nominal = world.nominal["arm1"]
    body = world.arms["arm1"]
    dynamics = ArmDynamics(nominal)
    rng = np.random.default_rng(0)
    limits = world.robots["arm1"].limits
    for _ in range(5):
        world.data.qpos[body.qpos_ids] = rng.uniform(limits.lower, limits.upper)
        world.data.qvel[body.dof_ids] = rng.uniform(-1, 1, len(limits.lower))
        mujoco.mj_step1(world.model, world.data)
        world.sense()
        sensed = world.hardware["arm1"]
        dynamics.update(sensed.q, sensed.v)
        wide, push = np.zeros((2, world.model.nv))
        push[body.dof_ids] = torque = rng.uniform(-5, 5, len(limits.lower))
        mujoco.mj_mulM(world.model, world.data, wide, push)
        np.testing.assert_array_equal(dynamics.inertia_times(torque), wide[body.dof_ids])
        np.testing.assert_array_equal(dynamics.bias, world.data.qfrc_bias[body.dof_ids])
        tool = nominal.tool_pose_at(sensed.q)
        np.testing.assert_array_equal(tool.position, body.tool_pose.position)


def friction_torque(world: World, v: Vector) -> Vector:
    """Braking torque of the plant's joints at given velocities, without gravity, N m."""
    body = world.arms["arm1"]
    world.data.qvel[body.dof_ids] = v
    world.devices.update_friction()
    mujoco.mj_forward(world.model, world.data)
    braked: Vector = -(world.data.qfrc_passive + world.data.qfrc_constraint)[body.dof_ids]
    return braked


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("seed", range(2))
def test_joint_friction_follows_the_sampled_model(robot: str, seed: int) -> None:
    """Within 1 %, at velocities at which friction does not stop a joint within a physics step."""
    world = real(robot, seed)
    friction = world.devices.sampled["arm1"].friction
    rng = np.random.default_rng(seed)
    for speed in (0.5, 2.0):
        v = speed * rng.choice([-1.0, 1.0], world.robots["arm1"].dof)
        assert friction_torque(world, v) == pytest.approx(friction.torque(v), rel=0.01, abs=1e-3)


@pytest.mark.parametrize("robot", ["ur5", "ur10", "xarm7"])
def test_joint_sticks_below_its_static_friction(robot: str) -> None:
    """Without gravity, 0.8 times the static friction moves nothing in 0.2 s, 1.5 times does."""
    for factor, moves in ((0.8, False), (1.5, True)):
        world = real(robot)
        world.model.opt.gravity[:] = 0.0
        mujoco.mj_step1(world.model, world.data)
        friction = world.devices.sampled["arm1"].friction
        body = world.arms["arm1"]
        before = body.q
        world.data.qfrc_applied[body.dof_ids[-1]] = factor * friction.static[-1]
        for _ in range(100):
            world.step()
        turned = np.abs(body.q - before)
        assert (turned[-1] > 1e-2) == moves
        if not moves:
            assert turned.max() < 1e-4


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("reality", ["lab", "rough"])
def test_friction_deviates_within_its_declared_uncertainty(robot: str, reality: str) -> None:
    world = real(robot, 3, reality)
    spread = REALITY_SETS[reality].friction
    limits = world.robots["arm1"].limits
    true = world.devices.sampled["arm1"].friction
    nominal_values = world.nominal["arm1"].friction
    assert nominal_values.uncertainty == spread.coulomb.most
    assert (true.coulomb <= nominal_values.coulomb * (1 + spread.coulomb.most) + 1e-9).all()
    assert (np.maximum(true.static, true.coulomb) <= spread.most * limits.effort + 1e-9).all()
    assert true.coulomb != pytest.approx(nominal_values.coulomb)
    none = real(robot, reality="ideal").nominal["arm1"].friction
    assert not none.torque(np.ones(len(limits.lower))).any()


def test_mass_of_a_held_object_is_sampled_and_known_only_in_lab() -> None:
    for reality, known in (("lab", True), ("rough", False)):
        file = file_of(
            {"arm1": arm("ur5")}, {"cube": box((0.487, 0.109, 0.79), mass=0.5)}, reality=reality
        )
        world = World(file, seed=1)
        world.attach("arm1", "cube")
        (load,) = world.nominal["arm1"].loads
        assert load.mass == (0.5 if known else None)
        true = float(world.model.body_mass[world.object_body("cube")])
        assert true != 0.5
        assert true == pytest.approx(0.5, rel=REALITY_SETS[reality].payload.mass.most)


@pytest.mark.parametrize("mount", ["wrist", PoseSpec(xyz=(1.0, 0.0, 1.0))])
def test_camera_deviates_from_its_calibration(mount: str | PoseSpec) -> None:
    camera = {"mount": mount}
    for reality in ("ideal", "lab", "rough"):
        world = real("ur5", 2, reality, camera=camera)
        body = world.arms["arm1"]
        spread = REALITY_SETS[reality].camera
        nominal = world.nominal["arm1"].camera_pose_at(body.q)
        true = camera_pose(world.data, body.camera_id)
        assert true.distance(nominal) <= np.sqrt(3) * spread.position.most + 1e-9
        assert true.angle(nominal) <= np.radians(np.sqrt(3) * spread.rotation.most) + 1e-6
        if reality != "ideal":
            assert true.distance(nominal) > 1e-4
            assert world.model.cam_fovy[body.camera_id] != 50.0


@pytest.mark.parametrize("reality", ["ideal", "lab", "rough"])
def test_lens_deviates_from_its_calibration(reality: str) -> None:
    """The distortion is sampled by the seed within its declared range; an ideal lens has none."""
    spread = REALITY_SETS[reality].camera
    distortions = [
        real("ur5", seed, reality, camera={}).devices.sampled["arm1"].distortion for seed in (1, 2)
    ]
    for k1, k2 in distortions:
        assert abs(k1) <= spread.k1.most
        assert abs(k2) <= spread.k2.most
    assert (distortions[0] == distortions[1]) == (reality == "ideal")
