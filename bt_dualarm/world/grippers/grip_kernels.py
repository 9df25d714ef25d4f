"""What lies between pads, and where it goes with the palm: compiled, for each step of a hold."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.pose import Matrix, Vector

Integers = npt.NDArray[np.int32]


@kernel
def gripped(geoms: Integers, distances: Vector, first: int, second: int, bodies: Integers) -> int:
    """The body that touches both pads of a gripper; -1 where none does.

    Args:
        geoms: Shapes of each contact, of shape (n, 2).
        distances: Their distances, of shape (n,), m.
        first: One pad's shape.
        second: The other pad's, or again the same, of a cup.
        bodies: Body of each shape, of shape (ngeom,).
    """
    for i in range(len(geoms)):
        if distances[i] > 0.0:
            continue
        if geoms[i, 0] == first:
            body = bodies[geoms[i, 1]]
        elif geoms[i, 1] == first:
            body = bodies[geoms[i, 0]]
        else:
            continue
        for j in range(len(geoms)):
            if distances[j] > 0.0:
                continue
            if (geoms[j, 0] == second and bodies[geoms[j, 1]] == body) or (
                geoms[j, 1] == second and bodies[geoms[j, 0]] == body
            ):
                return int(body)
    return -1


@kernel
def go_with(
    pose: Vector,
    was: Vector,
    before: Vector,
    after: Vector,
    jacobian: Matrix,
    velocities: Vector,
    step: float,
) -> None:
    """Put a body where it is in the palm's frame, and not where its straight line has led it.

    A step moves a free body along its velocity. The palm's points, turned by joints, move along
    arcs: by half the square of the step times the centripetal acceleration farther. What a body
    that goes with the palm has been moved too little is added.

    Args:
        pose: Position and quaternion of the body after the step, of shape (7,); changed.
        was: Its position before it, of shape (3,).
        before: Position and quaternion of the palm before it, of shape (7,).
        after: The same after it.
        jacobian: Of the palm's origin before it, of shape (6, nv): places, then turns.
        velocities: Velocities of the step, of shape (nv,).
        step: Seconds of the step.
    """
    rates = np.zeros(6)
    for i in range(6):
        for k in range(len(velocities)):
            rates[i] += jacobian[i, k] * velocities[k]
    w0, x0, y0, z0 = before[3], before[4], before[5], before[6]
    w1, x1, y1, z1 = after[3], after[4], after[5], after[6]
    # The palm's turn: its quaternion after the step times the conjugate of that before.
    w = w1 * w0 + x1 * x0 + y1 * y0 + z1 * z0
    x = -w1 * x0 + x1 * w0 - y1 * z0 + z1 * y0
    y = -w1 * y0 + x1 * z0 + y1 * w0 - z1 * x0
    z = -w1 * z0 - x1 * y0 + y1 * x0 + z1 * w0
    ax, ay, az = was[0] - before[0], was[1] - before[1], was[2] - before[2]
    tx, ty, tz = 2 * (y * az - z * ay), 2 * (z * ax - x * az), 2 * (x * ay - y * ax)
    bx = ax + w * tx + y * tz - z * ty
    by = ay + w * ty + z * tx - x * tz
    bz = az + w * tz + x * ty - y * tx
    pose[0] += after[0] + bx - was[0] - step * (rates[0] + rates[4] * az - rates[5] * ay)
    pose[1] += after[1] + by - was[1] - step * (rates[1] + rates[5] * ax - rates[3] * az)
    pose[2] += after[2] + bz - was[2] - step * (rates[2] + rates[3] * ay - rates[4] * ax)
    rate = math.sqrt(rates[3] ** 2 + rates[4] ** 2 + rates[5] ** 2)
    half = 0.5 * step * rate
    share = 0.5 * step * (math.sin(half) / half if half > 1e-12 else 1.0)
    cw, cx, cy, cz = math.cos(half), -share * rates[3], -share * rates[4], -share * rates[5]
    dw = w * cw - x * cx - y * cy - z * cz
    dx = w * cx + x * cw + y * cz - z * cy
    dy = w * cy - x * cz + y * cw + z * cx
    dz = w * cz + x * cy - y * cx + z * cw
    pw, px, py, pz = pose[3], pose[4], pose[5], pose[6]
    pose[3] = dw * pw - dx * px - dy * py - dz * pz
    pose[4] = dw * px + dx * pw + dy * pz - dz * py
    pose[5] = dw * py - dx * pz + dy * pw + dz * px
    pose[6] = dw * pz + dx * py - dy * px + dz * pw
