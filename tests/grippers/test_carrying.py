"""What is held goes with the palm along arcs, not along the straight lines of a step."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.sim.device_kernels import held_body, move_with_palm, rotation

STEP = 0.002


def turned_by(angles: Vector) -> Vector:
    """Quaternion of a rotation vector, of shape (3,), rad."""
    x, y, z = angles.tolist()
    return np.array(rotation((x, y, z)))


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
        (Pose(np.zeros(3), turned_by(STEP * rates[3:])) @ palm).quaternion,
    )
    straight = held.position + STEP * (
        rates[:3] + np.cross(rates[3:], held.position - palm.position)
    )
    turned = Pose(np.zeros(3), turned_by(STEP * rates[3:])) @ Pose(np.zeros(3), held.quaternion)
    pose = np.array((*straight, *turned.quaternion))
    rows = np.array([(*one.position, *one.quaternion) for one in (palm, after, held)])
    move_with_palm(pose, rows, np.eye(6), rates, STEP)
    before = palm.inverse @ held
    now = after.inverse @ Pose(pose[:3], pose[3:])
    assert now.distance(before) < 1e-12
    assert now.angle(before) < 1e-7
    stays = after.inverse @ Pose(straight, turned.quaternion)
    assert stays.distance(before) > 1e-7, "without it the thing would have moved"


def test_held_is_what_touches_both_pads() -> None:
    """Not what one pad pushes, nor what is near without a touch."""
    bodies = np.array((7, 7, 3, 4, 5), np.int32)  # of two pads and three things
    both = np.array(((0, 2), (3, 1), (2, 1), (4, 0)), np.int32)
    assert held_body(both, np.full(4, -1e-4), 0, 1, bodies) == 3
    assert held_body(both[:2], np.full(2, -1e-4), 0, 1, bodies) == -1
    assert held_body(both, np.array((-1e-4, -1e-4, 1e-4, -1e-4)), 0, 1, bodies) == -1
    assert held_body(both[3:], np.full(1, -1e-4), 0, 0, bodies) == 5  # a cup
