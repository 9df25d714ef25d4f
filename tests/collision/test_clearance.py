"""An arm slows down where its links, but not its tool, come near an object."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.control.controller import JointController
from bt_dualarm.core.pose import Vector
from bt_dualarm.safety.failsafe import Reservations
from bt_dualarm.sim.world import World
from bt_dualarm.trajectory.path_timing import point_to_point
from tests.sim.worlds import arm, box, file_of

PERIOD = 0.004


def swung(world: World, share: float) -> tuple[JointController, float]:
    """Turns the shoulder by a share of the angle to the first contact.

    Returns the controller, and the duration relative to the planned one.
    """
    controller = JointController(world, "arm1", PERIOD, Reservations())
    start = controller.setpoint.q
    goal = start + share * (just_before_contact(world, start) - start)
    motion = point_to_point(start, goal, world.robots["arm1"].limits.scaled(0.2), PERIOD)
    controller.follow(motion)
    while controller.motion is not None:
        controller.update(world.time)
        for _ in range(2):
            world.step()
    return controller, world.time / motion.duration


def just_before_contact(world: World, start: Vector) -> Vector:
    """The last configuration without contact as the shoulder turns, to 1 mm at half a meter."""
    checker = CollisionChecker(world, "arm1")
    turns = start + np.arange(0.0, 1.0, 0.002)[:, None] * np.eye(len(start))[0]
    found = checker.first_contact(turns)
    assert found is not None
    just_before: Vector = turns[found[0] - 1]
    return just_before


@pytest.mark.parametrize(("share", "slowed"), [(0.99, True), (0.5, False)])
def test_links_slow_down_before_a_wall(share: float, slowed: bool) -> None:
    world = World(file_of({"arm1": arm("ur5")}, {"wall": box((0.25, 0.45, 0.9), 0.4, fixed=True)}))
    controller, longer = swung(world, share)
    assert controller.fault is None
    assert (int(str(controller.guard["slowed"])) > 0) == slowed
    assert ("nearest_body_m" in controller.guard) == slowed
    assert (longer > 1.05) == slowed
    if slowed:
        assert 0.0 < float(controller.guard["nearest_body_m"]) < 0.02
        assert "wall" in str(controller.guard["last_reason"])


def test_tool_near_an_object_does_not_slow_the_arm() -> None:
    """The shoulder moves the tool towards a small box."""
    world = World(file_of({"arm1": arm("ur5")}))
    tool = world.arms["arm1"].tool_pose.position
    beside = tool + np.array((0.0, 0.15, 0.0))
    obj = box((float(beside[0]), float(beside[1]), float(beside[2])), 0.03, fixed=True)
    world = World(file_of({"arm1": arm("ur5")}, {"thing": obj}))
    controller, longer = swung(world, 0.99)
    assert controller.guard["slowed"] == 0
    assert longer < 1.05
