"""A compliant arm responds to a push like a spring; a stiff one compensates for it."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.control.computed_torque import BREAKAWAY_S, Compliance
from bt_dualarm.control.control_kernels import law_array
from bt_dualarm.control.controller import JointController
from bt_dualarm.control.dynamics import control_law
from bt_dualarm.core.pose import Vector
from bt_dualarm.trajectory.trajectory import Trajectory
from tests.control.test_controller import controlled, run
from tests.sim.worlds import world_with

PERIOD = 0.004
PUSH_N = 20.0


def test_compliance_starts_after_breakaway_and_averages_the_disturbance() -> None:
    numbers = law_array(control_law(PERIOD, 0.002, np.zeros(3)))
    stiff = numbers.copy()
    compliance = Compliance(numbers, PERIOD, np.zeros(6))
    compliance.active = True
    for _ in range(int(BREAKAWAY_S / PERIOD)):
        compliance.advance()
        assert (numbers == stiff).all()
    shares = []
    for _ in range(300):
        compliance.advance()
        shares.append(float(numbers[-1]))
    assert shares[0] == pytest.approx(1.0, abs=0.01), "the first period counts fully"
    assert shares[100] == pytest.approx(1 / 101, rel=0.05), "the mean of that many periods"
    assert shares[-1] == shares[-50] > 0.0, "slow changes are always learned"
    assert len(numbers[numbers != stiff]) == 2, "only this gain and the bandwidth change"
    compliance.hold_force()
    compliance.advance()
    assert numbers[-1] == 0.0
    compliance.active = False
    assert (numbers == stiff).all()


def test_soft_arm_keeps_the_given_compensation() -> None:
    """By default the arm keeps the current compensation; neither is learned further."""
    numbers = law_array(control_law(PERIOD, 0.002, np.zeros(3)))
    stiff = numbers.copy()
    torques: Vector = np.arange(6, dtype=np.float64)
    compliance = Compliance(numbers, PERIOD, torques)
    compliance.soften()
    assert (compliance.compensation == np.arange(6.0)).all()
    before = compliance.compensation
    compliance.soften(bandwidth=50.0, compensation=np.ones(6))
    compliance.advance()
    assert (torques == 1.0).all()
    assert (before == np.arange(6.0)).all(), "a copy, which may be restored later"
    assert 50.0 in numbers
    assert numbers[-1] == 0.0
    compliance.active = False
    assert (numbers == stiff).all()


def pushed(controller: JointController, seconds: float, force: float) -> float:
    """Displacement of the tool downwards from its set-point by a force in N, m."""
    world = controller._world
    body = world.arms["arm1"]
    link = int(world.model.geom_bodyid[max(body.geom_ids)])
    world.data.xfrc_applied[link, 2] = -force
    run(world, seconds, controller)
    world.data.xfrc_applied[link, 2] = 0.0
    commanded = world.nominal["arm1"].tool_pose_at(controller.setpoint.q)
    return float(commanded.position[2] - body.tool_pose.position[2])


@pytest.mark.parametrize("robot", ["ur5", "panda", "xarm7"])
def test_push_displaces_a_compliant_arm_constantly(robot: str) -> None:
    """Its stiffness is some newtons per millimeter; the stiff arm returns to its set-point."""
    displacements = []
    for compliant in (False, True):
        world = world_with(robot)
        controller = controlled(world)
        rest = Trajectory.rest(controller.setpoint.q, controller.period)
        controller.follow(rest, compliant=compliant, may_touch=True)
        run(world, 1.5, controller)
        controller.stop()
        displacements.append([pushed(controller, 0.3, PUSH_N), pushed(controller, 2.0, PUSH_N)])
    stiff, soft = displacements
    assert abs(stiff[1]) < 1e-4
    assert 5e-4 < soft[0] < 2e-2
    assert soft[1] == pytest.approx(soft[0], rel=0.1), "nothing is learned during the push"
