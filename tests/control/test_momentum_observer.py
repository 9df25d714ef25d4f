"""The momentum observer estimates external forces on an arm."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from benchmarks.path_reality import PERIOD, curves, world_of
from bt_dualarm.arm.state import ArmState
from bt_dualarm.control.controller import JointController
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.safety.failsafe import Reservations
from bt_dualarm.skill.registry import Registry
from bt_dualarm.trajectory.path_timing import point_to_point
from tests.families import some

NODE_TYPES = Registry.load().kinds
NO_FORCE = np.zeros(3)


class Standing:
    """An arm in the start posture of its curves, in a world that pushes it."""

    def __init__(self, robot: str, reality: str, load: str = "none") -> None:
        tool = next(curves(robot))[0]
        self.world = world = world_of(robot, tool, reality, load, 1, NODE_TYPES)
        self.controller = JointController(world, "arm1", PERIOD, Reservations())
        self.controller.update(world.time)
        body = world.arms["arm1"]
        self.state = ArmState(world, "arm1", self.controller, Kinematics(body.robot, body.base))

    def pushed(self, force: Vector, periods: int) -> Matrix:
        """Estimated wrenches while a force in N acts on the tool frame, of shape (periods, 6)."""
        felt = []
        for _ in range(periods):
            body = self.world.arms["arm1"]
            for _ in range(round(PERIOD / self.world.timestep)):
                data = self.world.data
                arm = data.site_xpos[body.tool_site] - data.xipos[body.tool_body]
                wrench = (*force, *np.cross(arm, force))
                data.xfrc_applied[body.tool_body] = wrench
                self.world.step()
            self.controller.update(self.world.time)
            felt.append(self.state.external_wrench)
        return np.array(felt)


@pytest.mark.parametrize(
    ("robot", "force"), some(product(["ur5", "panda"], [(0.0, 0.0, -30.0), (12.0, -8.0, 5.0)]), 3)
)
def test_force_at_the_tool_is_estimated_with_its_direction(
    robot: str, force: tuple[float, float, float]
) -> None:
    """The estimate is 70 % of the force after 20 ms, all after 0.24 s, and zero after its end."""
    arm = Standing(robot, "ideal")
    pushing = np.array(force)
    felt = arm.pushed(pushing, 60)
    assert np.linalg.norm(felt[5, :3]) == pytest.approx(np.linalg.norm(pushing) * 0.7, rel=0.12)
    assert felt[-1] == pytest.approx((*force, 0.0, 0.0, 0.0), abs=0.1)
    assert arm.pushed(NO_FORCE, 80)[-1] == pytest.approx(np.zeros(6), abs=0.1)


def test_known_load_and_motion_are_no_external_force() -> None:
    """With a known kilogram at full speed, the estimate stays below 1.5 N without a push."""
    arm = Standing("panda", "ideal", "known")
    here = arm.controller.setpoint.q
    limits = arm.world.robots["arm1"].limits
    goal = here + np.array((0.3, 0.2, -0.2, 0.3, 0.2, -0.2, 0.4))
    arm.controller.follow(point_to_point(here, goal, limits, PERIOD))
    assert np.abs(arm.pushed(NO_FORCE, 200)[:, :3]).max() < 1.5
    assert arm.controller.at_rest


@pytest.mark.parametrize(("robot", "most"), [("ur5", 2.0), ("panda", 5.0)])
def test_estimate_of_a_well_maintained_arm_at_rest_is_small(robot: str, most: float) -> None:
    arm = Standing(robot, "lab")
    arm.pushed(NO_FORCE, 50)
    assert np.abs(arm.pushed(NO_FORCE, 100)[:, :3]).max() < most
    estimate = arm.pushed(np.array((0.0, 0.0, -30.0)), 100)[-1, 2]
    assert estimate == pytest.approx(-30.0, rel=0.2)
