"""Sensors, drives, friction and fingers at one physics step: compiled."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.sim.kernel_columns import (
    ASKED_FORCE,
    ASKED_SPEED,
    ASKED_WIDTH,
    COULOMB,
    COUNT,
    CREEP,
    DAMPING,
    DROP,
    EFFORT,
    FORCE,
    GAIN,
    GRIP_GAIN,
    KEPT,
    LATE,
    MOST,
    NARROW,
    OFFSET,
    PER_STEP,
    REFERENCE,
    RESOLUTION,
    RISE,
    SHARE,
    SHUT,
    STIFFNESS,
    TAKEN,
    TORQUE,
    VISCOUS,
    WANTED,
    WHOLE,
    WINDOW,
    WOUND_UP,
)

# What sensors, drives and friction do at each physics step, joint by joint, of all arms.


Numbers: TypeAlias = npt.NDArray[np.int64]


@kernel
def read_joints(
    where: Numbers,
    q: Vector,
    v: Vector,
    encoders: Matrix,
    counts: Numbers,
    noise: Matrix,
    row: int,
    past: Matrix,
    newest: int,
    step: float,
    before: Matrix,
    readings: Matrix,
) -> None:
    """Read positions, and what velocities come of them and of earlier readings.

    Args:
        where: Row, and addresses of position and velocity of each joint, of shape (k, 3).
        q: Positions of the plant, of shape (nq,), rad.
        v: Velocities of the plant, of shape (nv,), rad/s.
        encoders: What is known of the encoders, see `kernel_columns`.
        counts: Windows and numbers of earlier readings, see there; changed.
        noise: Noise of readings, of shape (l, n), rad.
        row: Row of it that this reading has.
        past: Positions of earlier readings, of shape (m, n), rad: rows go round.
        newest: Row of them that this reading takes.
        step: Seconds between two readings.
        before: Positions and velocities so far, of shape (2, n), rad and rad/s.
        readings: Takes those of now, likewise.
    """
    for k in range(len(where)):
        joint = where[k, 0]
        place = where[k, 1]
        rate = where[k, 2]
        reading = in_steps(q[place] + noise[row, joint], encoders[joint, RESOLUTION])
        past[newest, joint] = readings[0, joint] = reading
        window = counts[joint, WINDOW]
        count = counts[joint, COUNT]
        span = min(count, window)
        if window == 0:
            readings[1, joint] = v[rate]
        elif span == 0:  # an arm comes into the world at rest
            readings[1, joint] = 0.0
        else:
            way = reading - past[(newest - span) % len(past), joint]
            taken = encoders[joint, TAKEN] / (span * step)
            readings[1, joint] = before[1, joint] * encoders[joint, KEPT] + way * taken
        counts[joint, COUNT] = min(count, window) + 1


@kernel
def in_steps(value: float, step: float) -> float:
    """A number in whole steps; a step of 0 leaves it as it is."""
    return np.rint(value * (1.0 / step)) * step if step > 0.0 else value


@kernel
def pass_on(where: Numbers, sent: Matrix, newest: int, drives: Matrix, motors: Vector) -> None:
    """Enter torques that were sent a while ago, and what a slow drive makes of them.

    Args:
        where: Row and address of the motor of each joint, of shape (k, 2).
        sent: Torques of the last steps, of shape (m, n), N m: rows go round.
        newest: Row of those of now.
        drives: What is known of the drives, see `kernel_columns`; takes what they give.
        motors: Takes the same, in the plant, of shape (nu,).
    """
    count = len(sent)
    for k in range(len(where)):
        joint = where[k, 0]
        motor = where[k, 1]
        late = int(drives[where[k, 0], WHOLE])
        sent[newest, joint] = drives[joint, WANTED]
        last = sent[(newest - late) % count, joint]
        before = sent[(newest - late - 1) % count, joint]
        asked = last + drives[joint, LATE] * (before - last)
        share = drives[joint, SHARE]
        torque = drives[joint, TORQUE]
        torque = torque + share * (asked - torque) if share < 1.0 else asked
        drives[joint, TORQUE] = motors[motor] = torque


@kernel
def take_torques(torque: Vector, drives: Matrix) -> None:
    """Enter what motors are to give: in whole steps, with their gain, within their efforts.

    Args:
        torque: Torques that are commanded, of shape (dof,), N m.
        drives: What is known of the drives of these joints, see `kernel_columns`; takes the
            torques.
    """
    for i in range(len(torque)):
        asked = torque[i]
        effort = drives[i, EFFORT]
        if drives[i, PER_STEP] > 0.0:
            asked = np.rint(asked * drives[i, PER_STEP])
        drives[i, WANTED] = max(min(drives[i, GAIN] * asked, effort), -effort)


@kernel
def apply_friction(
    where: Numbers, friction: Matrix, v: Vector, dry: Vector, damping: Vector
) -> None:
    """Enter friction at velocities of now.

    Args:
        where: Row, and address of the velocity of each joint, of shape (k, 2).
        friction: Friction of the joints, see `kernel_columns`.
        v: Velocities of the plant, of shape (nv,), rad/s.
        dry: Takes dry friction, of shape (nv,), N m.
        damping: Takes what grows with speed, of shape (nv,), N m s/rad.
    """
    for k in range(len(where)):
        joint = where[k, 0]
        i = where[k, 1]
        fall = friction[joint, DROP]
        if fall != 0.0:
            fall *= math.exp(v[i] * v[i] * friction[joint, NARROW])
        rise = friction[joint, RISE]
        offset = friction[joint, OFFSET]
        if rise > 0.0:
            speed = v[i] + CREEP
            start = math.tanh(offset / rise)
            build_up = math.tanh((speed + offset) / rise) - start
            gentle = (friction[joint, COULOMB] + fall) * build_up / speed
            dry[i], damping[i] = 0.0, friction[joint, VISCOUS] + gentle
        else:
            dry[i], damping[i] = friction[joint, COULOMB] + fall, friction[joint, VISCOUS]


# What moves fingers: compiled, for each step of physics.


@kernel
def push(q: Vector, v: Vector, drive: Vector, step: float, motor: Vector) -> None:
    """The speed loop: a reference runs ahead at the speed asked for, as far as force allows.

    Args:
        q: Ways of both fingers, of shape (2,), m.
        v: Their speeds, of shape (2,), m/s.
        drive: What is known of the drive, see `kernel_columns`; changed.
        step: Seconds of a step of physics.
        motor: Takes the force on each finger, of shape (1,), N.
    """
    asked = drive[ASKED_FORCE]
    stiffness = drive[STIFFNESS]
    width = q[0] + q[1]
    rate = v[0] + v[1]
    ahead = WOUND_UP * asked / stiffness
    goal = SHUT if drive[ASKED_WIDTH] <= 0.0 else drive[ASKED_WIDTH]
    stride = drive[ASKED_SPEED] * step
    reference = drive[REFERENCE]
    way = min(max(goal - reference, -stride), stride)
    force = stiffness * (reference - width) + drive[DAMPING] * (way / step - rate)
    drive[REFERENCE] = min(max(reference + way, width - ahead), width + ahead)
    drive[FORCE] = min(max(force, -asked), asked)
    motor[0] = min(max(drive[FORCE] * drive[GRIP_GAIN], -drive[MOST]), drive[MOST])


# What two pads feel, turned into the tool frame: compiled, for each reading.


@kernel
def felt_in_tool(
    felt: Vector, palm: Vector, turn: Matrix, gains: Vector, noise: Matrix, row: int
) -> Matrix:
    """Force of what is held on each pad, in the axes of the tool frame, of shape (2, 3), N.

    Args:
        felt: Force of each pad on what it touches, in the axes of the world, of shape (6,), N.
        palm: Rotation of the palm, row by row, of shape (9,).
        turn: Rotation of the tool frame in the palm, of shape (3, 3).
        gains: Share of a force that each pad's sensor reads, of shape (2,).
        noise: What readings have of noise, of shape (n, 6), N.
        row: The one of them to take.
    """
    forces = np.empty((2, 3))
    for axis in range(3):
        x = palm[0] * turn[0, axis] + palm[1] * turn[1, axis] + palm[2] * turn[2, axis]
        y = palm[3] * turn[0, axis] + palm[4] * turn[1, axis] + palm[5] * turn[2, axis]
        z = palm[6] * turn[0, axis] + palm[7] * turn[1, axis] + palm[8] * turn[2, axis]
        for pad in range(2):
            first = 3 * pad
            along = felt[first] * x + felt[first + 1] * y + felt[first + 2] * z
            forces[pad, axis] = noise[row, first + axis] - gains[pad] * along
    return forces


# What lies between pads, and where it goes with the palm: compiled, for each step of a hold.


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
    before = rows[0]
    after = rows[1]
    was = rows[2]
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


# Whether a contact is one that anybody minds, without looking at each from Python.


Pairs: TypeAlias = npt.NDArray[np.int32]
ContactNumbers: TypeAlias = npt.NDArray[np.int64]


@kernel
def any_unrequested(geoms: Pairs, owner: ContactNumbers, holder: ContactNumbers) -> bool:
    """Whether an arm touches what is neither its own nor held by it.

    Args:
        geoms: Numbers of the shapes of each contact, of shape (n, 2).
        owner: Number of the arm that has a shape, by the shape's number; -1 for none.
        holder: Number of the arm that holds it, likewise; less than -1 for none.
    """
    for i in range(len(geoms)):
        one = geoms[i, 0]
        other = geoms[i, 1]
        mine = owner[one]
        theirs = owner[other]
        if mine == theirs or max(mine, theirs) < 0:
            continue
        if holder[one] != theirs and holder[other] != mine:
            return True
    return False
