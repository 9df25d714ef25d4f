"""Distance of two arms, compared with the distances of all pairs of their shapes."""

from __future__ import annotations

import re

import mujoco
import numpy as np
import pytest

from bt_dualarm.collision.distance import HANDS_APART_M, PAYLOAD_APART_M, ArmDistance
from bt_dualarm.safety.failsafe import FailSafeCheck, Reservations
from bt_dualarm.safety.guard import reason_of
from bt_dualarm.sim.world import World
from tests.families import some
from tests.sim.worlds import arm, box, file_of

HORIZON = 0.1


@pytest.mark.parametrize(
    ("robot", "hand", "other_hand"),
    some(
        [
            ("ur5", "robotiq_2f85", "panda_hand"),
            ("xarm7", "panda_hand", "robotiq_2f85"),
            ("panda", "suction_cup", "robotiq_2f85"),
            ("ur3", "robotiq_2f85", "robotiq_2f85"),
        ],
        2,
    ),
)
def test_distance_is_that_of_the_nearest_shapes(robot: str, hand: str, other_hand: str) -> None:
    """Fingers and palms are boxes, and MuJoCo does not report one pair of boxes in six."""
    arms = {
        "arm1": arm(robot, gripper=hand),
        "arm2": arm("ur5", (0.9, 0.0, 0.4), 180.0, gripper=other_hand),
    }
    world = World(file_of(arms))
    distance = ArmDistance(world, "arm1")
    model, data = world.model, distance.data
    solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    own, its = (
        [int(geom) for geom in world.arms[name].geom_ids if solid[geom]] for name in world.arms
    )
    rng = np.random.default_rng(0)
    near = 0
    while near < 25:
        q = {
            name: world.robots[name].postures["home"]
            + rng.uniform(-0.6, 0.6, world.robots[name].dof)
            for name in world.arms
        }
        found = distance.gap(q, HORIZON)
        if found.meters <= 0.0:
            continue  # depths are those of contacts
        exact = min(
            mujoco.mj_geomDistance(model, data, one, other, HORIZON, None)
            for one in own
            for other in its
        )
        near += exact < HORIZON
        assert min(found.meters, HORIZON) == pytest.approx(exact, abs=1e-5), found


def held_before_the_tool(ahead: float) -> World:
    """A cube of 0.1 m, held by a distant arm, at a distance in m before arm1's tool."""
    arms = {
        "arm1": arm("ur5", gripper="robotiq_2f85"),
        "arm2": arm("ur5", (1.6, 0.0, 0.4), 180.0),
    }
    world = World(file_of(arms, {"cube": box((0.8, 0.0, 2.0), 0.1)}))
    tool = world.arms["arm1"].tool_pose
    start = world.pose_address("cube")
    axis = tool.rotation_matrix[:, 2]
    world.data.qpos[start : start + 3] = tool.position + (ahead + 0.05) * axis
    world.data.qpos[start + 3 : start + 7] = tool.quaternion
    mujoco.mj_forward(world.model, world.data)
    world.attach("arm2", "cube")
    world.sense()
    return world


def test_distance_of_an_object_from_links_of_arms_that_hold_it_together_does_not_count() -> None:
    """It is a part of each of them: plans of `carry_together` let a beam pass their forearms."""
    arms = {"arm1": arm("ur5", (3.0, 0.0, 0.4)), "arm2": arm("ur5")}
    world = World(file_of(arms, {"beam": box((0.0, 0.0, 2.0), 0.1)}))
    start = world.pose_address("beam")
    elbow = world.data.body("arm2/forearm_link").xpos
    world.data.qpos[start : start + 3] = elbow + np.array((0.0, 0.0, 0.13))
    mujoco.mj_forward(world.model, world.data)
    world.attach("arm1", "beam")
    world.sense()
    alone = ArmDistance(world, "arm1").gap({})
    assert 0.0 < alone.meters < HANDS_APART_M
    assert (alone.first, alone.second) == ("beam", "arm2/forearm_link")
    world.attach("arm2", "beam")
    for name in arms:
        assert ArmDistance(world, name).gap({}).meters > HANDS_APART_M


def test_distance_of_a_tool_from_a_payload_counts_unless_it_may_touch_it() -> None:
    """A tool keeps less distance from payloads than hands from each other, to pass them."""
    world = held_before_the_tool(0.03)
    may_touch = ArmDistance(world, "arm1").gap({})
    assert may_touch.second != "cube"
    avoiding = ArmDistance(world, "arm1", tool_avoids_payloads=True).gap({})
    assert avoiding.second == "cube"
    seen_by_its_holder = ArmDistance(world, "arm2").gap({}).meters
    assert 0.01 < seen_by_its_holder < 0.02
    allowance = HANDS_APART_M - PAYLOAD_APART_M
    assert avoiding.meters == pytest.approx(seen_by_its_holder + allowance, abs=1e-6)
    assert avoiding.true_meters == pytest.approx(seen_by_its_holder, abs=1e-6)


def test_motion_into_a_payload_of_another_arm_is_not_reserved() -> None:
    """After a handover, a hand on its way home hit the bar in the other hand at 1.3 rad/s."""
    world = held_before_the_tool(0.05)
    check = FailSafeCheck(world, "arm1", 0.004, Reservations())
    q = world.hardware["arm1"].q
    forward = world.arms["arm1"].tool_pose.rotation_matrix[:, 2]
    step = np.linalg.pinv(world.nominal["arm1"].tool_jacobian_at(q)) @ [*(0.08 * forward), 0, 0, 0]
    rows = q + np.linspace(0.0, 1.0, 40)[:, None] * step
    keep = {"arm2": HANDS_APART_M}
    assert check.reserve_trajectory(rows, 0.0, keep).clear
    check.tool_avoids_payloads = True
    refused = check.reserve_trajectory(rows, 0.0, keep)
    assert not refused.clear
    assert refused.gap.second == "cube"
    near = re.search(r"would come to within (\d+) mm of cube", reason_of(refused.gap))
    assert near is not None
    assert 1e-3 * int(near.group(1)) <= PAYLOAD_APART_M
