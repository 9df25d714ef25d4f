"""An arm that exceeds its force limit fails and stops pressing."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product

import mujoco
import numpy as np
import pytest

from bt_dualarm.control.controller import JointController
from bt_dualarm.core.errors import ForceLimitFailure, OverlapError
from bt_dualarm.core.pose import Pose
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.safety.failsafe import Reservations
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.trajectory.path_timing import time_path
from bt_dualarm.trajectory.paths import line
from tests.families import some
from tests.sim.worlds import WIDE, arm, file_of

PERIOD = 0.004
DEEP = 0.04  # commanded depth of the tool in the block, m
LIMITS_N = (30.0, 90.0)


def block(mass: float, *, fixed: bool) -> ObjectSpec:
    return ObjectSpec(shape="box", size=(0.1, 0.1, 0.1), mass=mass, fixed=fixed, spawned=False)


@dataclass
class Press:
    """An arm whose tool is commanded straight into a block, at a twentieth of its speed.

    Attributes:
        fault: Fault of the arm.
        at_fault_n: True force between arm and block at the fault, N.
        forces_n: True force in each step, N.
    """

    world: World
    fault: BaseException | None = None
    at_fault_n: float = 0.0
    forces_n: list[float] = field(default_factory=list)

    @classmethod
    def of(cls, robot: str, limit_n: float, obj: ObjectSpec, **world: object) -> Press:
        declared = arm(robot, force_limit=limit_n)
        press = cls(World(file_of({"arm1": declared}, {"block": obj}, **world), seed=1))
        press._put_block()
        return press

    def _put_block(self) -> None:
        """Puts the block as near before the tool as there is room."""
        pose = self.world.nominal["arm1"].tool_pose_at(self.world.hardware["arm1"].q)
        for gap in np.arange(0.045, 0.2, 0.0025).tolist():
            try:
                self.world.spawn_object("block", pose @ Pose.from_rpy((0.0, 0.0, gap)))
            except OverlapError:
                continue
            self.world.remove_object("block")  # it may be some millimeters deep in the tool
            self.world.spawn_object("block", pose @ Pose.from_rpy((0.0, 0.0, gap + 0.01)))
            return
        raise AssertionError("no room")

    def run(self, seconds: float = 2.5) -> None:
        world = self.world
        controller = JointController(world, "arm1", PERIOD, Reservations())
        body = world.arms["arm1"]
        kinematics = Kinematics(body.robot, body.base)
        start = kinematics.forward(controller.setpoint.q)
        path = line(start, start @ Pose.from_rpy((0.0, 0.0, DEEP)))
        rows = kinematics.follow(path.poses, controller.setpoint.q)
        world.on_forces.append(lambda: self.forces_n.append(self._force_n()))
        controller.follow(time_path(rows, body.robot.limits.scaled(0.05), PERIOD))
        for _ in range(round(seconds / PERIOD)):
            controller.update(world.time)
            if controller.fault is not None and self.fault is None:
                self.fault = controller.fault
                self.at_fault_n = self.forces_n[-1]
            for _ in range(round(PERIOD / world.timestep)):
                world.step()

    def _force_n(self) -> float:
        """Norm of the sum of all contact forces between block and arm, N."""
        world = self.world
        own = world.arms["arm1"].geom_ids
        other = world.object_geom("block")
        total = np.zeros(3)
        one = np.zeros(6)
        for i, contact in enumerate(world.data.contact):
            pair = set(contact.geom.tolist())
            if other in pair and pair & own:
                mujoco.mj_contactForce(world.model, world.data, i, one)
                sign = 1.0 if contact.geom[1] == other else -1.0
                total += sign * contact.frame.reshape(3, 3).T @ one[:3]
        return float(np.linalg.norm(total))


@pytest.mark.parametrize(("robot", "limit_n"), some(product(WIDE, LIMITS_N), 3))
def test_arm_that_presses_too_hard_fails_and_retreats(robot: str, limit_n: float) -> None:
    """The failure names both bodies; the estimate exceeds the limit and not the true force."""
    press = Press.of(robot, limit_n, block(1.0, fixed=True))
    press.run()
    assert isinstance(press.fault, ForceLimitFailure), press.fault
    numbers = press.fault.numbers
    assert str(numbers["first"]).startswith("arm1/")
    assert (numbers["second"], numbers["force_limit_n"]) == ("block", limit_n)
    assert limit_n < float(numbers["force_n"]) < 1.1 * press.at_fault_n
    assert press.forces_n[-1] < 0.5 * limit_n


@pytest.mark.parametrize("robot", some(WIDE, 2))
def test_friction_wrong_masses_and_light_objects_do_not_exceed_the_limit(robot: str) -> None:
    """A neglected arm with joint friction pushes a floating block of 0.3 kg."""
    press = Press.of(robot, 140.0, block(0.3, fixed=False), reality="rough")
    model = press.world.model
    body = press.world.model.body("block").id
    press.world.data.xfrc_applied[body, :3] = -model.body_mass[body] * model.opt.gravity  # floats
    press.run()
    assert max(press.forces_n) > 0.0
    assert press.fault is None
