"""What lies between pads, and where it goes with the palm: compiled, for each step of a hold."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.grippers.kernel_columns import BEGIN, END, FIRST, PALM, ROOT, SECOND
from bt_dualarm.world.grippers.palm_kernels import palm_pose, palm_rates

Integers: TypeAlias = npt.NDArray[np.int32]
Numbers: TypeAlias = npt.NDArray[np.int64]


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
def held_by(
    geoms: Integers,
    distances: Vector,
    holders: Numbers,
    bodies: Integers,
    addresses: Numbers,
    held: Numbers,
) -> bool:
    """Whether grippers hold anything that moves freely; what two of them hold is the first's.

    Args:
        geoms: Shapes of each contact, of shape (n, 2).
        distances: Distances of them, of shape (n,), m.
        holders: Grippers, see `kernel_columns`.
        bodies: Body of each shape, of shape (ngeom,).
        addresses: Address of the pose of each body that moves freely, of shape (nbody,); else -1.
        held: Takes the body that each of them holds, -1 where there is none.
    """
    any_held = False
    for k in range(len(holders)):
        body = gripped(geoms, distances, holders[k, FIRST], holders[k, SECOND], bodies)
        if body >= 0 and addresses[body] < 0:
            body = -1
        for other in range(k):
            if held[other] == body:
                body = -1
        held[k] = body
        any_held = any_held or body >= 0
    return any_held


@kernel
def carry(
    held: Numbers,
    holders: Numbers,
    links: Matrix,
    joints: Numbers,
    addresses: Numbers,
    q: Vector,
    v: Vector,
    places: Matrix,
    turns: Matrix,
    screws: Matrix,
    centers: Matrix,
    step: float,
) -> None:
    """Let what grippers hold go with their palms, after the integration of a step.

    Args:
        held: Body that each of them holds, of shape (n,); -1 where there is none.
        holders: Grippers, see `kernel_columns`.
        links: Links from the ground to each of their palms, see there.
        joints: Addresses of these links' joints, see `palm_pose`.
        addresses: Address of the pose of each body that moves freely, of shape (nbody,).
        q: Positions of the plant after the step, of shape (nq,); changed.
        v: Velocities of the step, of shape (nv,).
        places: Places of all bodies before it, of shape (nbody, 3), m.
        turns: Quaternions of all bodies before it, of shape (nbody, 4).
        screws: What joints turned and moved then, see `palm_rates`.
        centers: Points to which that refers, by the body on which an arm stands, (nbody, 3), m.
        step: Seconds of the step.
    """
    for k in range(len(holders)):
        body, palm = held[k], holders[k, PALM]
        if body < 0:
            continue
        way, start = slice(holders[k, BEGIN], holders[k, END]), addresses[body]
        before = np.concatenate((places[palm], turns[palm]))
        was = np.concatenate((places[body], turns[body]))
        rates = palm_rates(joints[way], v, screws, places[palm] - centers[holders[k, ROOT]])
        after = palm_pose(links[way], joints[way], q)
        go_with(q[start : start + 7], before, after, was, rates, step)


@kernel
def go_with(
    pose: Vector, before: Vector, after: Vector, was: Vector, rates: Vector, step: float
) -> None:
    """Put a body where it is in the palm's frame, and not where its straight line has led it.

    A step moves a free body along its velocity. The palm's points, turned by joints, move along
    arcs: by half the square of the step times the centripetal acceleration farther. What a body
    that goes with the palm has been moved too little is added.

    Args:
        pose: Position and quaternion of the body after the step, of shape (7,); changed.
        before: Position and quaternion of the palm before the step, of shape (7,).
        after: Those of the palm after it, of shape (7,).
        was: Those of the body before it, of shape (7,).
        rates: Velocity and angular velocity of the palm in the step, of shape (6,).
        step: Seconds of the step.
    """
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
