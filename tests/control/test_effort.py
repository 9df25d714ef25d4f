"""Motions are kept, slowed on the same path or refused to stay within the joints' efforts."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.control.dynamics import EFFORT_SHARE, ArmDynamics, refuse_overload, within_efforts
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose
from bt_dualarm.robots.robot import Robot
from bt_dualarm.robots.robot_description import load_robot, robot_names
from bt_dualarm.sim.arm_models import NominalLoad
from bt_dualarm.trajectory.path_timing import point_to_point
from bt_dualarm.trajectory.trajectory import Trajectory
from tests.families import some
from tests.sim.worlds import box, world_with


def loaded(name: str, mass: float, xyz: tuple[float, float, float]) -> ArmDynamics:
    """Dynamics of a robot with a cube of a mass in kg at a position in its tool link, m."""
    nominal = world_with(name).nominal["arm1"]
    obj = box((0, 0, 0), mass=mass)
    return ArmDynamics(nominal, [NominalLoad.of("load", obj, Pose.from_rpy(xyz))])


def swing(robot: Robot, seed: int) -> Trajectory:
    here = robot.postures["home"]
    limits = robot.limits
    away = np.random.default_rng(seed).uniform(-1.0, 1.0, robot.dof)
    return point_to_point(here, np.clip(here + away, limits.lower, limits.upper), limits, 0.004)


def share(motion: Trajectory, robot: Robot, dynamics: ArmDynamics) -> float:
    torques = [dynamics.moving(*row) for row in zip(motion.q, motion.v, motion.a, strict=True)]
    return float((np.abs(torques) / robot.limits.effort).max())


def carried(motion: Trajectory, robot: Robot, dynamics: ArmDynamics) -> Trajectory | None:
    """The motion within the efforts, or None if it is refused as an overload."""
    try:
        return within_efforts(motion, robot, dynamics)
    except Failure as refusal:
        return None if refusal.code == "OVERLOADED" else motion


LOADED = [name for name in robot_names() if load_robot(name).payload]


@pytest.mark.parametrize("name", some(LOADED, 2))
def test_motion_is_slowed_or_refused_as_its_load_requires(name: str) -> None:
    """A slowed motion stays within the efforts and on its path."""
    robot = load_robot(name)
    slowed = 0
    refused = 0
    for seed in range(8):
        motion = swing(robot, seed)
        mass = (robot.payload or 0.0) * (0.5 + seed / 2)
        dynamics = loaded(name, mass, (0.1, 0.0, 0.2))
        slower = carried(motion, robot, dynamics)
        if slower is None:
            refused += 1
            continue
        assert (
            share(slower, robot, dynamics) < EFFORT_SHARE + 0.02
        )  # torques are checked every 24 ms
        if slower is motion:
            continue
        slowed += 1
        assert share(motion, robot, dynamics) > EFFORT_SHARE
        line = motion.q[-1] - motion.q[0]  # all joints turn in proportion
        along = (slower.q - motion.q[0]) @ line / (line @ line)
        assert slower.q == pytest.approx(motion.q[0] + along[:, None] * line, abs=1e-6)
        assert slower.q[-1] == pytest.approx(motion.q[-1], abs=1e-12)
        assert not slower.v[-1].any()
    assert slowed + refused > 0


@pytest.mark.parametrize("name", ["ur3", "ur5", "ur10", "panda"])
def test_motion_without_a_load_is_not_slowed(name: str) -> None:
    """Motions at the catalog's limits stay within the efforts."""
    robot = load_robot(name)
    dynamics = ArmDynamics(world_with(name).nominal["arm1"])
    for seed in range(10):
        motion = swing(robot, seed)
        assert within_efforts(motion, robot, dynamics) is motion


def test_load_that_a_joint_cannot_hold_is_refused_with_the_torque() -> None:
    robot = load_robot("panda")
    dynamics = loaded("panda", 3.0, (0.6, 0.0, 0.0))
    with pytest.raises(Failure, match="N m to hold the arm at rest") as refusal:
        within_efforts(Trajectory.rest(robot.postures["home"], 0.004), robot, dynamics)
    assert refusal.value.code == "OVERLOADED"
    assert refusal.value.numbers["effort_nm"] == 12.0
    assert float(refusal.value.numbers["torque_nm"]) > 12.0


def test_refusal_of_a_torque_below_the_limit_explains_the_share() -> None:
    """'Would need 48.5 N m; its limit is 50 N m' was contradictory."""
    robot = load_robot("ur5")
    with pytest.raises(Failure, match=r"of which 95% may be planned with"):
        refuse_overload(0.97 * robot.limits.effort[None], robot)
    with pytest.raises(Failure) as refusal:
        refuse_overload(1.2 * robot.limits.effort[None], robot)
    assert "may be planned" not in refusal.value.reason
