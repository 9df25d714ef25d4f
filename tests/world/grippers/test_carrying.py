"""What is held goes with the palm along arcs, not along the straight lines of a step."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from bt_dualarm.pose import Pose
from bt_dualarm.world.grippers.carrying import links_of, way_to
from bt_dualarm.world.grippers.grip_kernels import go_with, gripped, held_by, rotation
from bt_dualarm.world.grippers.palm_kernels import palm_pose, palm_rates
from tests.world.worlds import ROBOTS, world_with

STEP = 0.002


@pytest.mark.parametrize("seed", range(20))
def test_a_thing_that_goes_with_the_palm_stays_where_it_is_in_it(seed: int) -> None:
    """Wherever the palm goes in a step, and whatever first-order step MuJoCo made of its rates."""
    rng = np.random.default_rng(seed)
    palm, held = (
        Pose.from_rpy(rng.uniform(-1, 1, 3).tolist(), tuple(rng.uniform(-3, 3, 3).tolist()))
        for _ in range(2)
    )
    rates = rng.uniform(-2, 2, 6)
    after = Pose(
        palm.position + STEP * rates[:3] + rng.uniform(-4e-6, 4e-6, 3),
        (Pose(np.zeros(3), rotation(STEP * rates[3:])) @ palm).quaternion,
    )
    straight = held.position + STEP * (
        rates[:3] + np.cross(rates[3:], held.position - palm.position)
    )
    turned = Pose(np.zeros(3), rotation(STEP * rates[3:])) @ Pose(np.zeros(3), held.quaternion)
    pose = np.array((*straight, *turned.quaternion))
    first, then, was = (np.array((*one.position, *one.quaternion)) for one in (palm, after, held))
    go_with(pose, first, then, was, rates, STEP)
    before, now = palm.inverse @ held, after.inverse @ Pose(pose[:3], pose[3:])
    assert now.distance(before) < 1e-12
    assert now.angle(before) < 1e-7
    stays = after.inverse @ Pose(straight, turned.quaternion)
    assert stays.distance(before) > 1e-7, "without it the thing would have moved"


def test_held_is_what_touches_both_pads() -> None:
    """Not what one pad pushes, nor what is near without a touch."""
    bodies = np.array((7, 7, 3, 4, 5), np.int32)  # of two pads and three things
    both = np.array(((0, 2), (3, 1), (2, 1), (4, 0)), np.int32)
    assert gripped(both, np.full(4, -1e-4), 0, 1, bodies) == 3
    assert gripped(both[:2], np.full(2, -1e-4), 0, 1, bodies) == -1
    assert gripped(both, np.array((-1e-4, -1e-4, 1e-4, -1e-4)), 0, 1, bodies) == -1
    assert gripped(both[3:], np.full(1, -1e-4), 0, 0, bodies) == 5  # a cup


def test_what_two_grippers_hold_goes_with_the_first() -> None:
    """And what does not move freely goes with none."""
    bodies = np.array((7, 7, 8, 8, 3, 4), np.int32)  # of pads of two grippers and two things
    geoms = np.array([(pad, thing) for pad in range(4) for thing in (4,)], np.int32)
    holders = np.array(((0, 1, 7, 1, 0, 0), (2, 3, 8, 1, 0, 0)))
    free = np.full(9, -1)
    held = np.zeros(2, np.int64)
    assert not held_by(geoms, np.full(4, -1e-4), holders, bodies, free, held)
    assert held.tolist() == [-1, -1]
    free[3] = 12
    assert held_by(geoms, np.full(4, -1e-4), holders, bodies, free, held)
    assert held.tolist() == [3, -1]
    assert held_by(geoms[2:], np.full(2, -1e-4), holders, bodies, free, held)
    assert held.tolist() == [-1, 3]


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_palm_is_where_and_as_fast_as_mujoco_has_it(robot: str) -> None:
    world = world_with(robot, gripper="robotiq_2f85")
    model, data = world.model, world.data
    palm = model.body("arm1/gripper/palm").id
    links, joints = links_of(model, way_to(model, palm))
    rng, jacobian = np.random.default_rng(0), np.zeros((6, model.nv))
    for _ in range(20):
        data.qpos[:] = rng.uniform(-3.0, 3.0, model.nq)
        data.qvel[:] = rng.uniform(-2.0, 2.0, model.nv)
        pose = palm_pose(links, joints, data.qpos)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        assert pose[:3] == pytest.approx(data.xpos[palm], abs=1e-13)
        assert pose[3:] == pytest.approx(data.xquat[palm], abs=1e-13)
        mujoco.mj_jacBody(model, data, jacobian[:3], jacobian[3:], palm)
        arm = data.xpos[palm] - data.subtree_com[model.body_rootid[palm]]
        rates = palm_rates(joints, data.qvel, data.cdof, arm)
        assert rates == pytest.approx(jacobian @ data.qvel, abs=1e-12)
