"""One object in two hands: attachments, loads, distances, and the release by one of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.collision.distance import HANDS_M, ArmDistance
from bt_dualarm.core.pose import Pose
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.safety.guard import CLEAR_M
from bt_dualarm.sim.arm_models import BORNE_GYRATION_M
from bt_dualarm.sim.world import World
from tests.sim.worlds import arm, box, file_of


@pytest.fixture
def world() -> World:
    """Two UR5s and a bar at the tool of the first."""
    return world_of("ideal")


def world_of(reality: str) -> World:
    """The two arms in a reality; in `rough` masses are unknown to them."""
    world = World(
        file_of(
            {"arm1": arm("ur5"), "arm2": arm("ur5", (1.1, 0.0, 0.4), 180.0)},
            {
                "bar": box((0, 0, 0), mass=1.0, spawned=False),
                "pitcher": box((0, 0, 0), spawned=False),
            },
            reality=reality,
        )
    )
    tool = world.arms["arm1"].tool_pose
    world.spawn_object("bar", tool @ Pose.from_rpy((0.0, 0.0, 0.026)))
    return world


def test_both_arms_hold_the_object_until_one_releases_it(world: World) -> None:
    for name in ("arm1", "arm2"):
        world.attach(name, "bar")
    held = world.attachments
    assert held.holders("bar") == ("arm1", "arm2")
    assert len(held) == 2
    assert held.detach("arm1", "bar")
    assert held.holders("bar") == ("arm2",)
    assert not held.detach("arm1", "bar")
    assert held.attached_to("arm1") == ()
    before = world.object_pose("bar")
    world.step()
    assert world.object_pose("bar").distance(before) < 1e-3


def test_each_arm_bears_its_share_and_the_last_one_everything(world: World) -> None:
    for name in ("arm1", "arm2"):
        world.hold(name, "bar", world.object_pose("bar"))
    generation = world.generation
    world.attachments.bear("arm1", "bar", 0.7)
    world.attachments.bear("arm2", "bar", 0.3)
    assert world.generation == generation  # only the loads have changed
    assert [world.nominal[name].loads[0].borne for name in ("arm1", "arm2")] == [0.7, 0.3]
    assert not world.nominal["arm1"].loads[0].alone
    world.attachments.detach("arm1", "bar")
    assert world.nominal["arm1"].loads == ()
    (load,) = world.nominal["arm2"].loads
    assert (load.borne, load.alone) == (1.0, True)


def test_a_gripper_that_opens_bears_nothing_until_it_closes_again(world: World) -> None:
    """The object counts as held until the skill lets go of it."""
    world.hold("arm1", "bar", world.object_pose("bar"))
    generation = world.generation
    world.attachments.release("arm1", opens=True)
    assert not world.nominal["arm1"].loads
    assert world.attachments.holders("bar") == ("arm1",)
    world.attachments.release("arm1", opens=False)
    assert world.nominal["arm1"].loads[0].borne == 1.0
    assert world.generation == generation


def test_share_of_a_removed_arm_passes_to_the_other(world: World) -> None:
    for name in ("arm1", "arm2"):
        world.hold(name, "bar", world.object_pose("bar"))
        world.attachments.bear(name, "bar", 0.5)
    world.remove_arm("arm1")
    assert world.nominal["arm2"].loads[0].borne == 1.0
    assert world.attachments.holders("bar") == ("arm2",)


@pytest.mark.parametrize("leaves", ["detach", "remove"])
def test_last_arm_bears_everything_at_its_grasp(world: World, leaves: str) -> None:
    """With the inertia of a long object at its center, the arm would oscillate: it would answer
    each error with torques for the whole object, which may rest on a support."""
    at = {"arm1": Pose.from_rpy((-0.4, 0.0, 0.0)), "arm2": Pose.from_rpy((0.4, 0.0, 0.0))}
    for name, grasp in at.items():
        world.hold(name, "bar", world.object_pose("bar"))
        world.attachments.bear(name, "bar", 0.5, grasp)
    (shared,) = world.nominal["arm2"].loads
    if leaves == "detach":
        world.attachments.detach("arm1", "bar")
    else:
        world.remove_arm("arm1")
    (load,) = world.nominal["arm2"].loads
    assert (load.borne, load.alone) == (1.0, True)
    assert load.pose.distance(shared.pose) == 0.0
    assert load.inertia == pytest.approx(shared.inertia)


def test_weight_of_a_supported_object_passes_to_no_arm(world: World) -> None:
    for name in ("arm1", "arm2"):
        world.hold(name, "bar", world.object_pose("bar"))
        world.attachments.bear(name, "bar", 0.5)
    world.attachments.detach("arm1", "bar", stands=True)
    assert world.nominal["arm2"].loads[0].borne == 0.5
    world.attachments.detach("arm2", "bar", stands=True)
    assert world.nominal["arm2"].loads == ()


@pytest.mark.parametrize("estimated", [None, 1.1])
def test_shared_object_of_unknown_mass_is_modeled_at_the_grasp(estimated: float | None) -> None:
    """Otherwise grip and torques would have to bear the moment of the whole, distant object."""
    world = world_of("rough")
    for name in ("arm1", "arm2"):
        world.hold(name, "bar", world.object_pose("bar"))
    alone = world.nominal["arm2"].loads[0]
    assert alone.mass is None
    world.nominal["arm2"].update_load(replace(alone, mass=estimated))
    grasp = Pose.from_rpy((0.4, 0.0, 0.0))
    world.attachments.bear("arm2", "bar", 0.5, grasp)
    (load,) = world.nominal["arm2"].loads
    assert (load.mass, load.share) == (estimated, 0.5)
    assert load.pose.distance(alone.pose @ grasp) < 1e-9
    assert load.gyration == pytest.approx(BORNE_GYRATION_M**2)


def test_consent_requires_both_arms(world: World) -> None:
    held = world.attachments
    held.consent("arm1", "arm2", "bar", HANDS_M)
    assert held.shared_grasps("arm1") == held.shared_grasps("arm2") == ()
    held.consent("arm2", "arm1", "bar", 0.01)
    (one,) = held.shared_grasps("arm1")
    assert (one.partner, one.object, one.hands_m) == ("arm2", "bar", 0.01)  # the larger distance
    held.dissent("arm1", "arm2", "bar")
    assert held.shared_grasps("arm2") == ()
    held.consent("arm1", "arm2", "bar", HANDS_M)
    world.remove_arm("arm1")
    assert held.shared_grasps("arm2") == ()


def bring_near(world: World) -> None:
    """Move arm2's tool to point at arm1's from the side, from about 2 cm away."""
    beside = world.arms["arm1"].tool_pose.position + np.array((0.05, 0.0, -0.03))
    target = Pose.from_rpy(tuple(beside), (0.0, -np.pi / 2, 0.0))
    solver = Kinematics(world.robots["arm2"], world.arms["arm2"].base, 0)
    q = solver.solve(target, world.hardware["arm2"].q)
    world.data.qpos[world.arms["arm2"].qpos_ids] = q
    world._refresh()


def test_hands_may_be_near_each_other_only_at_a_shared_object(world: World) -> None:
    world.remove_object("bar")
    bring_near(world)
    world.spawn_object("bar", world.arms["arm1"].tool_pose @ Pose.from_rpy((0.0, 0.3, 0.0)))
    here = {name: world.hardware[name].q for name in world.arms}
    before = ArmDistance(world, "arm1").gap(here).meters
    assert HANDS_M < before < CLEAR_M
    assert CollisionChecker(world, "arm1", CLEAR_M).contact(here["arm1"]) is not None
    held = world.attachments
    held.consent("arm1", "arm2", "bar", HANDS_M)
    held.consent("arm2", "arm1", "bar", HANDS_M)
    for name in world.arms:
        # The guard requires 30 mm, but the hands keep 6 mm, so their gap counts as 24 mm larger.
        gap = ArmDistance(world, name).gap(here).meters
        assert before < gap <= before + CLEAR_M - HANDS_M + 1e-9
        assert CollisionChecker(world, name, CLEAR_M).contact(here[name]) is None
    held.dissent("arm2", "arm1", "bar")
    assert ArmDistance(world, "arm1").gap(here).meters == pytest.approx(before)


def test_object_in_both_hands_is_no_obstacle_between_them(world: World) -> None:
    bring_near(world)
    here = {name: world.hardware[name].q for name in world.arms}
    for name in ("arm1", "arm2"):
        world.hold(name, "bar", world.object_pose("bar"))
    for name in ("arm1", "arm2"):
        gap = ArmDistance(world, name).gap(here)
        assert "bar" not in (gap.first, gap.second)
        contact = CollisionChecker(world, name).contact(here[name])
        assert contact is None or "bar" not in (contact.first, contact.second)


def test_what_a_hand_holds_may_be_as_near_to_the_other_hand_as_hands(world: World) -> None:
    """It kept the 45 mm of plans from the fingers around the cup into which it was to pour."""
    world.attach("arm1", "bar")
    beside = world.arms["arm1"].tool_pose @ Pose.from_rpy((0.1, 0.0, 0.0))
    world.spawn_object("pitcher", beside)
    world.attach("arm2", "pitcher")
    q = world.hardware["arm2"].q
    gap = ArmDistance(world, "arm2").gap({"arm2": q})
    assert (gap.first, gap.second) == ("pitcher", "arm1/wrist_3_link")
    assert CLEAR_M < gap.meters < 0.04
    held = world.attachments
    held.consent("arm1", "arm2", "bar", CLEAR_M)
    assert CollisionChecker(world, "arm2", 0.04).contact(q) is not None
    held.consent("arm2", "arm1", "bar", CLEAR_M)
    assert CollisionChecker(world, "arm2", 0.04).contact(q) is None
