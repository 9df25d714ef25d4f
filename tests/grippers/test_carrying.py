"""A held object moves with the palm along arcs, not along the straight lines of a step."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.sim.device_kernels import held_body, move_with_palm, palm_motion, rotation
from bt_dualarm.sim.grippers import joints_above

STEP = 0.002


def turned_by(angles: Vector) -> Vector:
    """Quaternion of a rotation vector, of shape (3,), rad."""
    x, y, z = angles.tolist()
    return np.array(rotation((x, y, z)))


@pytest.mark.parametrize("seed", range(20))
def test_held_object_keeps_its_pose_in_the_palm(seed: int) -> None:
    """This holds for any motion of the palm in a step and for MuJoCo's first-order step."""
    rng = np.random.default_rng(seed)
    palm, held = (
        Pose.from_rpy(rng.uniform(-1, 1, 3).tolist(), tuple(rng.uniform(-3, 3, 3).tolist()))
        for _ in range(2)
    )
    rates = rng.uniform(-2, 2, 6)
    after = Pose(
        palm.position + STEP * rates[:3] + rng.uniform(-4e-6, 4e-6, 3),
        (Pose(np.zeros(3), turned_by(STEP * rates[3:])) @ palm).quaternion,
    )
    straight = held.position + STEP * (
        rates[:3] + np.cross(rates[3:], held.position - palm.position)
    )
    turned = Pose(np.zeros(3), turned_by(STEP * rates[3:])) @ Pose(np.zeros(3), held.quaternion)
    pose = np.array((*straight, *turned.quaternion))
    rows = np.array([(*one.position, *one.quaternion) for one in (palm, after, held)])
    x, y, z, a, b, c = rates.tolist()
    move_with_palm(pose, rows, (x, y, z), (a, b, c), STEP)
    before = palm.inverse @ held
    now = after.inverse @ Pose(pose[:3], pose[3:])
    assert now.distance(before) < 1e-12
    assert now.angle(before) < 1e-7
    stays = after.inverse @ Pose(straight, turned.quaternion)
    assert stays.distance(before) > 1e-7, "without it the object would have moved"


def test_motion_of_the_palm_agrees_with_its_jacobian() -> None:
    """The world has another kinematic tree, joints beyond the palm, and a fixed body between."""
    model = mujoco.MjModel.from_xml_string("""
        <mujoco><worldbody>
          <body pos="1 0 0"><freejoint/><geom size="0.1"/></body>
          <body pos="0 0 1"><joint type="hinge" axis="0 1 0"/><geom size="0.1" pos="0.2 0 0"/>
            <body pos="0.3 0 0"><joint type="slide" axis="1 0 0"/><joint axis="1 0 1"/>
              <geom size="0.05"/>
              <body name="palm" pos="0.1 0.2 0"><geom size="0.02"/>
                <body pos="0 0 0.1"><joint axis="1 0 0"/><geom size="0.02"/></body>
              </body>
            </body>
          </body>
        </worldbody></mujoco>""")
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    mujoco.mj_integratePos(model, data.qpos, rng.normal(size=model.nv), 1.0)
    mujoco.mj_forward(model, data)
    v = rng.normal(size=model.nv)
    jacobian = np.zeros((2, 3, model.nv))
    palm = model.body("palm").id
    mujoco.mj_jacBody(model, data, *jacobian, palm)
    joints = joints_above(model, palm)
    assert joints == [6, 7, 8]
    row = np.array((model.body_rootid[palm], *joints, -1))
    pose = np.concatenate((data.xpos[palm], data.xquat[palm]))
    motion = palm_motion(row, pose, data.cdof, data.subtree_com, v)
    np.testing.assert_allclose(motion, jacobian @ v, atol=1e-14)


def test_object_that_touches_both_pads_is_held() -> None:
    """An object pushed by one pad, or near without contact, is not held."""
    bodies = np.array((7, 7, 3, 4, 5), np.int32)  # of two pads and three objects
    both = np.array(((0, 2), (3, 1), (2, 1), (4, 0)), np.int32)
    assert held_body(both, np.full(4, -1e-4), 0, 1, bodies) == 3
    assert held_body(both[:2], np.full(2, -1e-4), 0, 1, bodies) == -1
    assert held_body(both, np.array((-1e-4, -1e-4, 1e-4, -1e-4)), 0, 1, bodies) == -1
    assert held_body(both[3:], np.full(1, -1e-4), 0, 0, bodies) == 5  # a cup
