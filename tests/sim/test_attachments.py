"""Attachments: several welds at once hold through all changes of the world."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.control.controller import JointController
from bt_dualarm.core.pose import Pose
from bt_dualarm.safety.failsafe import Reservations
from bt_dualarm.sim.world import World
from bt_dualarm.trajectory.set_points import SetPoint
from tests.sim.worlds import arm, box, file_of

HELD = 0.0002
"""Allowed deviation of a held object, m: a tenth of the tolerance of a placement."""


@pytest.fixture
def world() -> World:
    """A UR5 with two cubes at its tool, and a Panda that is not spawned yet."""
    file = file_of(
        {"arm1": arm("ur5"), "arm2": arm("panda", (1.6, 0.0, 0.0), 180.0, spawned=False)},
        {"cube": box((0, 0, 0), spawned=False), "block": box((0, 0, 0), mass=0.5, spawned=False)},
    )
    world = World(file)
    tool = world.arms["arm1"].tool_pose
    world.spawn_object("cube", tool @ Pose.from_rpy((0.0, 0.0, 0.026), (0.1, 0.2, 0.3)))
    world.spawn_object("block", tool @ Pose.from_rpy((0.0, 0.08, 0.026)))
    return world


def relative(world: World, name: str, arm_name: str = "arm1") -> Pose:
    """Pose of the object in the frame of the arm's tool link."""
    return world.arms[arm_name].tool_link_pose.inverse @ world.object_pose(name)


def swing(world: World, seconds: float, controller: JointController) -> dict[str, float]:
    """Move all joints back and forth; returns the largest deviation of each held object, m."""
    start = controller.setpoint
    begin = world.time
    w = 5.0
    size = 0.08

    def at(time: float) -> SetPoint:
        turn = w * (time - begin)
        ones = np.ones_like(start.q)
        # 1 - cos begins and ends at rest; the gate bounds the jerk of its first step.
        return SetPoint(
            start.q + size * (1 - np.cos(turn)) * ones,
            size * w * np.sin(turn) * ones,
            size * w * w * np.cos(turn) * ones,
        )

    controller.stream(at)
    deviations = {held.object: 0.0 for held in world.attachments}
    for _ in range(round(seconds / world.timestep)):
        controller.update(world.time)
        world.step()
        for held in world.attachments:
            deviation = relative(world, held.object).distance(held.relative)
            deviations[held.object] = max(deviations[held.object], deviation)
    return deviations


def test_welds_hold_while_the_arm_moves(world: World) -> None:
    """Two objects at once, of different masses, at half a meter per second."""
    controller = JointController(world, "arm1", world.timestep, Reservations())
    for name in ("cube", "block"):
        world.attach("arm1", name)
    assert world.attachments.attached_to("arm1") == ("cube", "block")
    before = world.object_pose("cube").position
    deviations = swing(world, 0.6, controller)
    assert world.object_pose("cube").distance(Pose(before, np.array([1.0, 0, 0, 0]))) > 0.05
    assert deviations.keys() == {"cube", "block"}
    assert max(deviations.values()) < HELD
    for held in world.attachments:
        assert relative(world, held.object).angle(held.relative) < 0.005


def test_attaching_moves_nothing(world: World) -> None:
    before = relative(world, "cube")
    held = world.attach("arm1", "cube")
    assert held.relative.distance(before) < 1e-12
    assert relative(world, "cube").distance(before) < 1e-12
    assert held.since == world.time


def test_attaching_twice_is_attaching_once(world: World) -> None:
    first = world.attach("arm1", "cube")
    generation = world.generation
    assert world.attach("arm1", "cube") is first
    assert world.generation == generation
    assert len(world.attachments) == world.model.neq == 1


def test_detaching_twice_is_detaching_once(world: World) -> None:
    world.attach("arm1", "cube")
    assert world.attachments.detach("arm1", "cube")
    generation = world.generation
    assert not world.attachments.detach("arm1", "cube")
    assert not world.attachments.detach("arm9", "nothing")
    assert world.generation == generation
    assert world.model.neq == 0


def test_detached_object_falls_and_can_be_attached_again(world: World) -> None:
    controller = JointController(world, "arm1", world.timestep, Reservations())
    world.attach("arm1", "cube")
    world.attachments.detach("arm1", "cube")
    height = world.object_pose("cube").position[2]
    for _ in range(50):
        controller.update(world.time)
        world.step()
    assert world.object_pose("cube").position[2] < height - 0.03
    held = world.attach("arm1", "cube")  # at its current pose
    assert held.relative.distance(relative(world, "cube")) < 1e-12


def test_relative_pose_survives_other_changes_of_the_world(world: World) -> None:
    """Each change recompiles the model, and MuJoCo then recomputes welds from the initial pose."""
    controller = JointController(world, "arm1", world.timestep, Reservations())
    held = world.attach("arm1", "cube")
    swing(world, 0.2, controller)  # away from the posture of the compilation
    for change in (
        lambda: world.spawn_arm("arm2"),
        lambda: world.attach("arm1", "block"),
        lambda: world.attachments.detach("arm1", "block"),
        lambda: world.remove_object("block"),
        lambda: world.remove_arm("arm2"),
    ):
        change()
        controller.stop()
        for _ in range(40):
            controller.update(world.time)
            world.step()
        assert relative(world, "cube").distance(held.relative) < HELD
        assert relative(world, "cube").angle(held.relative) < 0.005


def test_removing_a_held_object_is_safe(world: World) -> None:
    controller = JointController(world, "arm1", world.timestep, Reservations())
    world.attach("arm1", "cube")
    world.attach("arm1", "block")
    world.remove_object("cube")
    assert world.attachments.attached_to("arm1") == ("block",)
    assert max(swing(world, 0.1, controller).values()) < HELD
    world.spawn_object("cube", Pose.from_rpy((2.0, 2.0, 0.025)))
    assert world.attachments.find("arm1", "cube") is None
    assert world.model.neq == 1


def test_removing_the_arm_detaches_the_object(world: World) -> None:
    world.attach("arm1", "cube")
    world.remove_arm("arm1")
    assert len(world.attachments) == world.model.neq == 0
    height = world.object_pose("cube").position[2]
    for _ in range(50):
        world.step()
    assert world.object_pose("cube").position[2] < height - 0.03
    world.spawn_arm("arm1")
    assert world.attachments.attached_to("arm1") == ()


def test_two_arms_may_hold_one_object(world: World) -> None:
    """An attachment is a pair of arm and object."""
    world.spawn_arm("arm2")
    world.attach("arm1", "cube")
    world.attach("arm2", "cube")
    assert [held.name for held in world.attachments] == ["arm1+cube", "arm2+cube"]
    world.attachments.detach("arm1", "cube")
    assert world.attachments.attached_to("arm2") == ("cube",)


def test_attached_object_has_no_contact_with_the_tool(world: World) -> None:
    """It penetrated the cup by 0.5 mm: the weld determines its pose, not the contact."""
    world.remove_object("cube")
    tool = world.arms["arm1"].tool_pose
    world.spawn_object("cube", tool @ Pose.from_rpy((0.0, 0.0, 0.0245)))
    assert world.touches("arm1", "cube")
    world.attach("arm1", "cube")
    assert not world.touches("arm1", "cube")
