"""Where a palm is and how fast, joint by joint: compiled, for each step of a hold."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.grippers.kernel_columns import AXIS, PLACE, TURN, ZERO

Numbers: TypeAlias = npt.NDArray[np.int64]
Quaternion: TypeAlias = tuple[float, float, float, float]


@kernel
def palm_pose(links: Matrix, joints: Numbers, q: Vector) -> Vector:
    """Position and quaternion of a palm, of shape (7,), for positions that were not looked at yet.

    MuJoCo would place all bodies for that. Sums are in its order: so are their last bits.

    Args:
        links: Links from the ground to the palm, see `kernel_columns`.
        joints: Addresses of their joints' position and velocity, of shape (k, 2); -1 for none.
        q: Positions of the plant, of shape (nq,), rad.
    """
    x, y, z, turn = 0.0, 0.0, 0.0, (1.0, 0.0, 0.0, 0.0)
    for k in range(len(links)):
        a, b, c, d = turn
        u, v, w = links[k, PLACE], links[k, PLACE + 1], links[k, PLACE + 2]
        aa, bb, cc, dd = a * a, b * b, c * c, d * d
        x += ((aa - cc) + (bb - dd)) * u + 2.0 * (b * c - a * d) * v + 2.0 * (b * d + a * c) * w
        y += 2.0 * (b * c + a * d) * u + ((aa + cc) - (bb + dd)) * v + 2.0 * (c * d - a * b) * w
        z += 2.0 * (b * d - a * c) * u + 2.0 * (c * d + a * b) * v + ((aa - cc) + (dd - bb)) * w
        stands = links[k, TURN], links[k, TURN + 1], links[k, TURN + 2], links[k, TURN + 3]
        turn = joined(turn, stands)
        if joints[k, 0] >= 0:
            half = 0.5 * (q[joints[k, 0]] - links[k, ZERO])
            sine, u = math.sin(half), links[k, AXIS]
            v, w = links[k, AXIS + 1], links[k, AXIS + 2]
            turn = joined(turn, (math.cos(half), u * sine, v * sine, w * sine))
        turn = unit(turn)
    return np.array((x, y, z, turn[0], turn[1], turn[2], turn[3]))


@kernel
def palm_rates(joints: Numbers, v: Vector, screws: Matrix, arm: Vector) -> Vector:
    """Velocity of a palm's origin and angular velocity, of shape (6,), m/s and rad/s.

    Args:
        joints: Addresses of the joints' position and velocity on the way to the palm, of shape
            (k, 2); -1 for none.
        v: Velocities of the plant, of shape (nv,), rad/s.
        screws: What each of them turns and moves at a point of the arm, of shape (nv, 6).
        arm: Way from that point to the palm's origin, of shape (3,), m.
    """
    rates = np.zeros(6)
    for k in range(len(joints)):
        dof = joints[k, 1]
        if dof < 0:
            continue
        speed = v[dof]
        x, y, z = screws[dof, 0], screws[dof, 1], screws[dof, 2]
        rates[0] += (screws[dof, 3] + (y * arm[2] - z * arm[1])) * speed
        rates[1] += (screws[dof, 4] + (z * arm[0] - x * arm[2])) * speed
        rates[2] += (screws[dof, 5] + (x * arm[1] - y * arm[0])) * speed
        rates[3] += x * speed
        rates[4] += y * speed
        rates[5] += z * speed
    return rates


@kernel
def joined(first: Quaternion, second: Quaternion) -> Quaternion:
    """A turn after another."""
    a, b, c, d = first
    e, f, g, h = second
    return (
        (a * e - b * f) - (c * g + d * h),
        (a * f + b * e) + (c * h - d * g),
        (a * g - b * h) + (c * e + d * f),
        (a * h + b * g) - (c * f - d * e),
    )


@kernel
def unit(turn: Quaternion) -> Quaternion:
    """The same turn, of length one."""
    a, b, c, d = turn
    length = math.sqrt((a * a + b * b) + (c * c + d * d))
    if abs(length - 1.0) <= 1e-15:
        return turn
    scale = 1.0 / length
    return a * scale, b * scale, c * scale, d * scale
