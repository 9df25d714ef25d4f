"""A compliant arm leans on what it meets like a spring; a stiff one makes up for it."""

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


def test_joints_break_loose_first_and_what_is_off_then_is_a_mean() -> None:
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
    assert shares[0] == pytest.approx(1.0, abs=0.01), "the first moment counts for all"
    assert shares[100] == pytest.approx(1 / 101, rel=0.05), "the mean of as many moments"
    assert shares[-1] == shares[-50] > 0.0, "what changes slowly is learned for ever"
    assert len(numbers[numbers != stiff]) == 2, "of the law, this and the bandwidth"
    compliance.hold_force()
    compliance.advance()
    assert numbers[-1] == 0.0
    compliance.active = False
    assert (numbers == stiff).all()


def test_a_soft_arm_keeps_the_compensation_that_it_is_given() -> None:
    """Without one, it keeps the current one; neither is learned further."""
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
    assert (before == np.arange(6.0)).all(), "a copy, which may be given back later"
    assert 50.0 in numbers
    assert numbers[-1] == 0.0
    compliance.active = False
    assert (numbers == stiff).all()


def pushed(controller: JointController, seconds: float, force: float) -> float:
    """How far the tool is pushed down from its set-point, m."""
    world = controller._world
    body = world.arms["arm1"]
    link = int(world.model.geom_bodyid[max(body.geom_ids)])
    world.data.xfrc_applied[link, 2] = -force
    run(world, seconds, controller)
    world.data.xfrc_applied[link, 2] = 0.0
    meant = world.nominal["arm1"].tool_pose_at(controller.setpoint.q)
    return float(meant.position[2] - body.tool_pose.position[2])


@pytest.mark.parametrize("robot", ["ur5", "panda", "xarm7"])
def test_a_push_moves_a_compliant_arm_and_it_presses_no_harder_with_time(robot: str) -> None:
    """A spring of some newtons a millimeter; the stiff arm is back on its set-point."""
    ways = []
    for compliant in (False, True):
        world = world_with(robot)
        controller = controlled(world)
        rest = Trajectory.rest(controller.setpoint.q, controller.period)
        controller.follow(rest, compliant=compliant, may_touch=True)
        run(world, 1.5, controller)
        controller.stop()
        ways.append([pushed(controller, 0.3, PUSH_N), pushed(controller, 2.0, PUSH_N)])
    stiff, soft = ways
    assert abs(stiff[1]) < 1e-4
    assert 5e-4 < soft[0] < 2e-2
    assert soft[1] == pytest.approx(soft[0], rel=0.1), "nothing is learned while it holds"
