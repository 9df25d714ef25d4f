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
        distances: Distances of them, of shape (n,), m.
        first: Shape of one pad.
        second: Shape of the other pad; of a cup again the same.
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
def remember(places: Matrix, turns: Matrix, first: int, second: int, rows: Matrix) -> None:
    """Enter where one body is into a row, and where another one is into that after the next.

    Args:
        places: Places of all bodies, of shape (nbody, 3), m.
        turns: Quaternions of all bodies, of shape (nbody, 4).
        first: Body of the first row.
        second: Body of the third row, where there is one.
        rows: Positions and quaternions, of shape (3, 7) or (2, 7); changed.
    """
    rows[0, :3], rows[0, 3:] = places[first], turns[first]
    if len(rows) > 2:
        rows[2, :3], rows[2, 3:] = places[second], turns[second]


@kernel
def go_with(pose: Vector, rows: Matrix, jacobian: Matrix, velocities: Vector, step: float) -> None:
    """Put a body where it is in the palm's frame, and not where its straight line has led it.

    A step moves a free body along its velocity. The palm's points, turned by joints, move along
    arcs: by half the square of the step times the centripetal acceleration farther. What a body
    that goes with the palm has been moved too little is added.

    Args:
        pose: Position and quaternion of the body after the step, of shape (7,); changed.
        rows: Position and quaternion of the palm before the step, of the palm after it, and of the
            body before it, of shape (3, 7).
        jacobian: Jacobian of the palm's origin before it, of shape (6, nv): places, then turns.
        velocities: Velocities of the step, of shape (nv,).
        step: Seconds of the step.
    """
    rates = np.zeros(6)
    for i in range(6):
        for k in range(len(velocities)):
            rates[i] += jacobian[i, k] * velocities[k]
    before, after, was = rows[0], rows[1], rows[2]
    arm = was[:3] - before[:3]
    turn = product(after[3:], conjugate(before[3:]))
    there = after[:3] + turned(turn, arm)
    straight = was[:3] + step * (rates[:3] + crossed(rates[3:], arm))
    pose[:3] += there - straight
    meant = rotation(step * rates[3:])
    pose[3:] = product(product(turn, conjugate(meant)), pose[3:])


@kernel
def product(a: Vector, b: Vector) -> Vector:
    """Of two quaternions, each of shape (4,), w first."""
    return np.array(
        (
            a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
            a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
            a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
            a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
        )
    )


@kernel
def conjugate(a: Vector) -> Vector:
    """The turn back, of shape (4,)."""
    return np.array((a[0], -a[1], -a[2], -a[3]))


@kernel
def crossed(a: Vector, b: Vector) -> Vector:
    """The cross product of two vectors of shape (3,)."""
    return np.array(
        (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    )


@kernel
def turned(turn: Vector, arm: Vector) -> Vector:
    """A vector of shape (3,) turned by a quaternion of shape (4,)."""
    twice = 2.0 * crossed(turn[1:], arm)
    there: Vector = arm + turn[0] * twice + crossed(turn[1:], twice)
    return there


@kernel
def rotation(angles: Vector) -> Vector:
    """The quaternion of a turn about a vector of shape (3,) by its length in rad."""
    half = 0.5 * math.sqrt(angles[0] ** 2 + angles[1] ** 2 + angles[2] ** 2)
    share = 0.5 * math.sin(half) / half if half > 1e-12 else 0.5
    return np.array((math.cos(half), share * angles[0], share * angles[1], share * angles[2]))
