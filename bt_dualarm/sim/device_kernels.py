"""Compiled kernels of one physics step: encoders, drives, friction, grippers, contacts.

Each call serves the joints of all arms, whose constants and states are rows of arrays (see
`kernel_arrays`): a call from Python costs more than the arithmetic for one joint.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.sim.kernel_arrays import (
    COMMANDED,
    COMMANDED_FORCE,
    COMMANDED_SPEED,
    COMMANDED_WIDTH,
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
    MOTOR,
    NARROW,
    NEW_WEIGHT,
    NEWEST,
    NOISE_ROW,
    OFFSET,
    OLD_WEIGHT,
    PADS,
    PADS_PERIOD,
    PADS_ROW,
    PADS_S,
    PALM_BODY,
    PER_STEP,
    PRESSED,
    Q_ADDRESS,
    QUANTUM,
    REFERENCE,
    RESOLUTION,
    RISE,
    SENSED_S,
    SHARE,
    SHUT,
    SPEED,
    STIFFNESS,
    TORQUE,
    V_ADDRESS,
    VISCOUS,
    WHOLE,
    WIDTH,
    WINDOW,
    WOUND_UP,
)

# Encoders, drives and friction


Numbers: TypeAlias = npt.NDArray[np.int64]
Stack: TypeAlias = npt.NDArray[np.float64]


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
    """Read all encoders and derive velocities from this and earlier readings.

    Args:
        where: Row, and addresses of position and velocity in the plant, of each joint, (k, 3).
        q: Positions of the plant, of shape (nq,), rad.
        v: Velocities of the plant, of shape (nv,), rad/s.
        encoders: Constants of the encoders, see `kernel_arrays`.
        counts: Windows and numbers of earlier readings, see there; changed.
        noise: Batch of noise, of shape (l, n), rad.
        row: Row of it for this reading.
        past: Ring buffer of positions of earlier readings, of shape (m, n), rad.
        newest: Row of it for this reading.
        step: Seconds between two readings.
        before: Previous positions and velocities, of shape (2, n), rad and rad/s.
        readings: Output: the new ones, of the same shape.
    """
    for k in range(len(where)):
        joint = where[k, 0]
        position = where[k, 1]
        velocity = where[k, 2]
        reading = quantized(q[position] + noise[row, joint], encoders[joint, RESOLUTION])
        past[newest, joint] = readings[0, joint] = reading
        window = counts[joint, WINDOW]
        count = counts[joint, COUNT]
        span = min(count, window)
        if window == 0:
            readings[1, joint] = v[velocity]
        elif span == 0:  # arms are added to the world at rest
            readings[1, joint] = 0.0
        else:
            distance = reading - past[(newest - span) % len(past), joint]
            weight = encoders[joint, NEW_WEIGHT] / (span * step)
            filtered = before[1, joint] * encoders[joint, OLD_WEIGHT]
            readings[1, joint] = filtered + distance * weight
        counts[joint, COUNT] = min(count, window) + 1


@kernel
def quantized(value: float, step: float) -> float:
    """Round a number to a multiple of ``step``; 0 leaves it as it is."""
    return np.rint(value * (1.0 / step)) * step if step > 0.0 else value


@kernel
def apply_torques(
    where: Numbers, sent: Matrix, newest: int, drives: Matrix, motors: Vector
) -> None:
    """Apply the delayed commands after the first-order lag of the drives.

    Args:
        where: Row, and address of the motor in the plant, of each joint, of shape (k, 2).
        sent: Ring buffer of commands of the last steps, of shape (m, n), N m.
        newest: Row of it for the current step.
        drives: Constants and state of the drives, see `kernel_arrays`; changed.
        motors: Controls of the plant, of shape (nu,); changed.
    """
    count = len(sent)
    for k in range(len(where)):
        joint = where[k, 0]
        motor = where[k, 1]
        delay = int(drives[where[k, 0], WHOLE])
        sent[newest, joint] = drives[joint, COMMANDED]
        last = sent[(newest - delay) % count, joint]
        before = sent[(newest - delay - 1) % count, joint]
        delayed = last + drives[joint, LATE] * (before - last)
        share = drives[joint, SHARE]
        torque = drives[joint, TORQUE]
        torque = torque + share * (delayed - torque) if share < 1.0 else delayed
        drives[joint, TORQUE] = motors[motor] = torque


@kernel
def command_torques(torque: Vector, drives: Matrix) -> None:
    """Command torques to drives, which quantize them, have a gain error, and respect effort limits.

    Args:
        torque: Commanded torques, of shape (dof,), N m.
        drives: Constants and state of the drives of these joints, see `kernel_arrays`; changed.
    """
    for i in range(len(torque)):
        commanded = torque[i]
        effort = drives[i, EFFORT]
        if drives[i, PER_STEP] > 0.0:
            commanded = np.rint(commanded * drives[i, PER_STEP])
        drives[i, COMMANDED] = max(min(drives[i, GAIN] * commanded, effort), -effort)


@kernel
def apply_friction(
    where: Numbers, friction: Matrix, v: Vector, dry: Vector, damping: Vector
) -> None:
    """Set the friction of the plant for its current velocities; see `JointFriction` for the model.

    Args:
        where: Row, and address of the velocity in the plant, of each joint, of shape (k, 2).
        friction: Constants of the joints, see `kernel_arrays`.
        v: Velocities of the plant, of shape (nv,), rad/s.
        dry: Dry friction of the plant (``dof_frictionloss``), of shape (nv,), N m; changed.
        damping: Damping of the plant (``dof_damping``), of shape (nv,), N m s/rad; changed.
    """
    for k in range(len(where)):
        joint = where[k, 0]
        i = where[k, 1]
        stribeck = friction[joint, DROP]
        if stribeck != 0.0:
            stribeck *= math.exp(v[i] * v[i] * friction[joint, NARROW])
        rise = friction[joint, RISE]
        offset = friction[joint, OFFSET]
        if rise > 0.0:
            # Friction that builds up gradually is set as a damping coefficient, torque over speed.
            speed = v[i] + CREEP
            start = math.tanh(offset / rise)
            build_up = math.tanh((speed + offset) / rise) - start
            secant = (friction[joint, COULOMB] + stribeck) * build_up / speed
            dry[i], damping[i] = 0.0, friction[joint, VISCOUS] + secant
        else:
            dry[i], damping[i] = friction[joint, COULOMB] + stribeck, friction[joint, VISCOUS]


# Grippers


@kernel
def drive_fingers(width: float, rate: float, drive: Vector, step: float) -> float:
    """Speed loop of two fingers: a spring and damper to a reference that moves at the set speed.

    The reference leads the fingers by no more than the spring needs for the commanded force
    (anti-windup), so blocked fingers press with exactly that force.

    Args:
        width: Opening, m.
        rate: Speed of the opening, m/s.
        drive: Constants, command and state of the drive, see `kernel_arrays`; changed.
        step: Seconds of a physics step.

    Returns:
        Control of the plant: the force on each finger, N.
    """
    limit = drive[COMMANDED_FORCE]
    stiffness = drive[STIFFNESS]
    lead = WOUND_UP * limit / stiffness
    goal = SHUT if drive[COMMANDED_WIDTH] <= 0.0 else drive[COMMANDED_WIDTH]
    stride = drive[COMMANDED_SPEED] * step
    reference = drive[REFERENCE]
    advance = min(max(goal - reference, -stride), stride)
    force = stiffness * (reference - width) + drive[DAMPING] * (advance / step - rate)
    drive[REFERENCE] = min(max(reference + advance, width - lead), width + lead)
    drive[FORCE] = min(max(force, -limit), limit)
    applied: float = min(max(drive[FORCE] * drive[GRIP_GAIN], -drive[MOST]), drive[MOST])
    return applied


@kernel
def write_pad_forces(
    k: int,
    address: int,
    palm: int,
    row: int,
    sensed: Vector,
    rotations: Matrix,
    tools: Stack,
    gains: Matrix,
    noise: Stack,
    forces: Stack,
) -> None:
    """Force of the held object on each pad of a gripper, in the axes of its tool frame.

    Args:
        k: Row of the gripper.
        address: First sensor reading of its pads.
        palm: Body of its palm.
        row: Row of the batch of noise for this reading.
        sensed: As in `read_fingers`.
        rotations: As there.
        tools: As there.
        gains: As there.
        noise: As there ``pad_noise``.
        forces: As there.
    """
    for axis in range(3):
        a, b, c = tools[k, 0, axis], tools[k, 1, axis], tools[k, 2, axis]
        x = rotations[palm, 0] * a + rotations[palm, 1] * b + rotations[palm, 2] * c
        y = rotations[palm, 3] * a + rotations[palm, 4] * b + rotations[palm, 5] * c
        z = rotations[palm, 6] * a + rotations[palm, 7] * b + rotations[palm, 8] * c
        for pad in range(2):
            first = address + 3 * pad
            along = sensed[first] * x + sensed[first + 1] * y + sensed[first + 2] * z
            # The sensor has the force on the object; the force on the pad is the reaction.
            forces[k, pad, axis] = noise[k, row, 3 * pad + axis] - gains[k, pad] * along


@kernel
def read_fingers(
    time: float,
    q: Vector,
    fingers: Numbers,
    drives: Matrix,
    readings: Matrix,
    noise: Matrix,
    widths: Stack,
    sensed: Vector,
    rotations: Matrix,
    tools: Stack,
    gains: Matrix,
    pad_noise: Stack,
    forces: Stack,
) -> bool:
    """Read the opening of all grippers with fingers, and the forces on their pads if that is due.

    Args:
        time: Simulated time, s; a gripper that was read at this time is not read again.
        q: Positions of the plant, of shape (nq,).
        fingers: Addresses and rows of each gripper, see `kernel_arrays`; changed.
        drives: Constants and state of their drives, see there.
        readings: Takes the readings, see there.
        noise: Batches of noise of the openings, of shape (k, l), m.
        widths: Ring buffers of times and openings, of shape (k, r, 2), s and m; changed.
        sensed: Sensor readings of the plant (``sensordata``): force of each pad on the object, in
            the axes of the world, N.
        rotations: Rotation matrices of all bodies, row by row, of shape (nbody, 9).
        tools: Rotation matrix of each tool frame in its palm, of shape (k, 3, 3).
        gains: Factors of the pads' readings, of shape (k, 2).
        pad_noise: Batches of noise of the pads, of shape (k, m, 6), N.
        forces: Takes the forces on the pads, see `write_pad_forces`, of shape (k, 2, 3), N.

    Returns:
        Whether a batch of noise is used up.
    """
    is_used_up = False
    for k in range(len(fingers)):
        first = fingers[k, Q_ADDRESS]
        if first < 0 or readings[k, SENSED_S] == time:
            continue
        readings[k, SENSED_S] = time
        width = q[first] + q[first + 1] + noise[k, fingers[k, NOISE_ROW]]
        fingers[k, NOISE_ROW] += 1
        quantum = readings[k, QUANTUM]
        if quantum > 0.0:
            width = quantum * np.rint(width / quantum)
        rows = widths.shape[1]
        newest = (fingers[k, NEWEST] + 1) % rows
        fingers[k, NEWEST] = newest
        fingers[k, KEPT] = min(fingers[k, KEPT] + 1, rows)
        widths[k, newest, 0] = time
        widths[k, newest, 1] = width
        oldest = (newest - fingers[k, KEPT] + 1) % rows
        span = time - widths[k, oldest, 0]
        readings[k, SPEED] = (width - widths[k, oldest, 1]) / span if span > 0.0 else 0.0
        readings[k, WIDTH] = width
        readings[k, PRESSED] = -drives[k, FORCE]
        pads = fingers[k, PADS]
        if pads >= 0 and time - readings[k, PADS_S] >= readings[k, PADS_PERIOD]:
            row = fingers[k, PADS_ROW]
            fingers[k, PADS_ROW] += 1
            if readings[k, PADS_S] < 0.0:  # before its first step the plant has no forces
                for i in range(6):
                    forces[k, i // 3, i % 3] = pad_noise[k, row, i]
            else:
                palm = fingers[k, PALM_BODY]
                write_pad_forces(
                    k, pads, palm, row, sensed, rotations, tools, gains, pad_noise, forces
                )
            readings[k, PADS_S] = time
        is_used_up |= fingers[k, NOISE_ROW] == noise.shape[1]
        is_used_up |= fingers[k, PADS_ROW] == pad_noise.shape[1]
    return is_used_up


Integers = npt.NDArray[np.int32]

Triple: TypeAlias = tuple[float, float, float]
Quaternion: TypeAlias = tuple[float, float, float, float]
"""With w first. Tuples, as each small array would be allocated."""


@kernel
def held_body(geoms: Integers, distances: Vector, first: int, second: int, bodies: Integers) -> int:
    """Find the body in contact with both pads of a gripper; -1 if there is none.

    Args:
        geoms: Geoms of each contact, of shape (n, 2).
        distances: Distance of each contact, of shape (n,), m.
        first: Geom of one pad.
        second: Geom of the other pad; for a cup the same again.
        bodies: Body of each geom, of shape (ngeom,).
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
def find_held(
    geoms: Integers,
    distances: Vector,
    pads: Numbers,
    bodies: Integers,
    addresses: Numbers,
    positions: Matrix,
    quaternions: Matrix,
    held: Numbers,
    poses: Stack,
) -> int:
    """Find the body that each gripper holds, and store its pose and the palm's before the step.

    Args:
        geoms: Geoms of each contact, of shape (n, 2).
        distances: Distance of each contact, of shape (n,), m.
        pads: Geoms of both pads, and body of the palm, of each gripper, of shape (k, 3).
        bodies: Body of each geom, of shape (ngeom,).
        addresses: First of the seven elements of ``qpos`` of each body's pose; -1 for one that
            cannot move freely.
        positions: Positions of all bodies, of shape (nbody, 3), m.
        quaternions: Quaternions of all bodies, of shape (nbody, 4).
        held: Takes the body that each gripper holds, of shape (k,): -1 for none, and for one that
            an earlier gripper holds, too.
        poses: Takes the poses, see `move_with_palm`, of shape (k, 3, 7).

    Returns:
        Number of held bodies.
    """
    count = 0
    for k in range(len(pads)):
        body = held_body(geoms, distances, pads[k, 0], pads[k, 1], bodies)
        if body >= 0 and addresses[body] < 0:
            body = -1
        for earlier in range(k):
            if held[earlier] == body:
                body = -1
        held[k] = body
        if body >= 0:
            palm = pads[k, 2]
            poses[k, 0, :3], poses[k, 0, 3:] = positions[palm], quaternions[palm]
            poses[k, 2, :3], poses[k, 2, 3:] = positions[body], quaternions[body]
            count += 1
    return count


@kernel
def move_held(
    pads: Numbers,
    addresses: Numbers,
    positions: Matrix,
    quaternions: Matrix,
    held: Numbers,
    poses: Stack,
    joints: Numbers,
    motions: Matrix,
    centers: Matrix,
    velocities: Vector,
    step: float,
    q: Vector,
) -> None:
    """Move all held bodies with their palms, see `move_with_palm`.

    Args:
        pads: As in `find_held`.
        addresses: As there.
        positions: Positions of all bodies after the step, of shape (nbody, 3), m.
        quaternions: Their quaternions, of shape (nbody, 4).
        held: Result of `find_held`.
        poses: Likewise; changed.
        joints: Root of each palm's tree, then the velocities that move the palm, from there on; -1
            after the last one, of shape (k, 1 + nv).
        motions: Motion axes of all velocities before the step (``cdof``), of shape (nv, 6).
        centers: Centers of mass about which they are (``subtree_com``), of shape (nbody, 3), m.
        velocities: Velocities of the step, of shape (nv,).
        step: Seconds of the step.
        q: Positions of the plant, of shape (nq,); changed.
    """
    for k in range(len(pads)):
        if held[k] >= 0:
            palm = pads[k, 2]
            poses[k, 1, :3], poses[k, 1, 3:] = positions[palm], quaternions[palm]
            start = addresses[held[k]]
            speed, spin = palm_motion(joints[k], poses[k, 0], motions, centers, velocities)
            move_with_palm(q[start : start + 7], poses[k], speed, spin, step)


@kernel
def palm_motion(
    joints: Numbers, palm: Vector, motions: Matrix, centers: Matrix, velocities: Vector
) -> tuple[Triple, Triple]:
    """Velocity and angular velocity of a palm, m/s and rad/s.

    The product of the Jacobian of ``mj_jacBody`` and the velocities, without that Jacobian, which
    has a column for each velocity of the world.

    Args:
        joints: Row of the palm, as in `move_held`.
        palm: Its position, then its quaternion, of shape (7,).
        motions: As in `move_held`.
        centers: As there.
        velocities: As there.
    """
    root = joints[0]
    lever = palm[0] - centers[root, 0], palm[1] - centers[root, 1], palm[2] - centers[root, 2]
    x = y = z = a = b = c = 0.0
    for number in range(1, len(joints)):
        i = joints[number]
        if i < 0:
            break
        axis = motions[i, 0], motions[i, 1], motions[i, 2]
        along = crossed(axis, lever)
        x += (motions[i, 3] + along[0]) * velocities[i]
        y += (motions[i, 4] + along[1]) * velocities[i]
        z += (motions[i, 5] + along[2]) * velocities[i]
        a += axis[0] * velocities[i]
        b += axis[1] * velocities[i]
        c += axis[2] * velocities[i]
    return (x, y, z), (a, b, c)


@kernel
def move_with_palm(pose: Vector, rows: Matrix, speed: Triple, spin: Triple, step: float) -> None:
    """Move a held body with the palm along its arc, instead of along a straight line.

    MuJoCo moves a free body along its velocity for a step. Points of the palm, which joints rotate,
    move along arcs: farther by half the squared step times the centripetal acceleration. The
    difference between the arc of a point fixed in the palm and its straight line is added to the
    body's pose, which keeps any true motion relative to the palm.

    Args:
        pose: Position and quaternion of the body after the step, of shape (7,); changed.
        rows: Position and quaternion of the palm before and after the step, and of the body before
            it, of shape (3, 7).
        speed: Velocity of the palm's origin in the step, m/s.
        spin: Angular velocity of the palm in the step, rad/s.
        step: Seconds of the step.
    """
    x, y, z = rows[0, 0], rows[0, 1], rows[0, 2]
    lever = rows[2, 0] - x, rows[2, 1] - y, rows[2, 2] - z
    before = rows[0, 3], rows[0, 4], rows[0, 5], rows[0, 6]
    after = rows[1, 3], rows[1, 4], rows[1, 5], rows[1, 6]
    turn = product(after, conjugate(before))
    arc = turned(turn, lever)
    straight = crossed(spin, lever)
    for i in range(3):
        pose[i] += (rows[1, i] + arc[i]) - (rows[2, i] + step * (speed[i] + straight[i]))
    integrated = rotation((step * spin[0], step * spin[1], step * spin[2]))
    rest = product(turn, conjugate(integrated))
    pose[3], pose[4], pose[5], pose[6] = product(rest, (pose[3], pose[4], pose[5], pose[6]))


@kernel
def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Product of two quaternions."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


@kernel
def conjugate(a: Quaternion) -> Quaternion:
    """Conjugate of a unit quaternion, the inverse rotation."""
    return a[0], -a[1], -a[2], -a[3]


@kernel
def crossed(a: Triple, b: Triple) -> Triple:
    """Cross product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def turned(turn: Quaternion, vector: Triple) -> Triple:
    """Rotate a vector by a unit quaternion."""
    axis = turn[1], turn[2], turn[3]
    half = crossed(axis, vector)
    twice = 2.0 * half[0], 2.0 * half[1], 2.0 * half[2]
    more = crossed(axis, twice)
    return (
        vector[0] + turn[0] * twice[0] + more[0],
        vector[1] + turn[0] * twice[1] + more[1],
        vector[2] + turn[0] * twice[2] + more[2],
    )


@kernel
def rotation(angles: Triple) -> Quaternion:
    """Quaternion of a rotation vector, rad."""
    half = 0.5 * math.sqrt(angles[0] ** 2 + angles[1] ** 2 + angles[2] ** 2)
    share = 0.5 * math.sin(half) / half if half > 1e-12 else 0.5
    return math.cos(half), share * angles[0], share * angles[1], share * angles[2]


# Contacts


@kernel
def any_foreign_contact(geoms: Integers, owner: Numbers, holder: Numbers) -> bool:
    """Whether an arm is in contact with something that it neither owns nor holds.

    Args:
        geoms: Geoms of each contact, of shape (n, 2).
        owner: Number of the arm that owns a geom, by the geom's id; -1 for none.
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


# One physics step


@kernel
def drive_plant(
    joints: Numbers,
    sent: Matrix,
    newest: int,
    drives: Matrix,
    fingers: Numbers,
    finger_drives: Matrix,
    q: Vector,
    v: Vector,
    step: float,
    motors: Vector,
) -> bool:
    """Apply the torques of all joints, see `apply_torques`, and the forces of all fingers.

    Args:
        joints: Row, and address of the motor in the plant, of each joint, of shape (k, 2).
        sent: As in `apply_torques`.
        newest: As there.
        drives: As there; changed.
        fingers: Addresses of the grippers with fingers, see `kernel_arrays`.
        finger_drives: Constants, commands and states of their drives, see there; changed.
        q: Positions of the plant, of shape (nq,).
        v: Velocities of the plant, of shape (nv,).
        step: Seconds of a physics step.
        motors: Controls of the plant, of shape (nu,); changed.

    Returns:
        Whether all controls are finite: MuJoCo would replace all of them by zero.
    """
    apply_torques(joints, sent, newest, drives, motors)
    for k in range(len(fingers)):
        first = fingers[k, Q_ADDRESS]
        if first >= 0:
            start = fingers[k, V_ADDRESS]
            width = q[first] + q[first + 1]
            rate = v[start] + v[start + 1]
            motors[fingers[k, MOTOR]] = drive_fingers(width, rate, finger_drives[k], step)
    return math.isfinite(square(motors))


@kernel
def square(vector: Vector) -> float:
    """Square of a vector's length."""
    total = 0.0
    for one in vector:
        total += one * one
    return total


@kernel
def pass_between(
    most_speed: float,
    q: Vector,
    v: Vector,
    joints: Numbers,
    friction: Matrix,
    dry: Vector,
    damping: Vector,
    geoms: Integers,
    distances: Vector,
    pads: Numbers,
    bodies: Integers,
    addresses: Numbers,
    positions: Matrix,
    quaternions: Matrix,
    held: Numbers,
    poses: Stack,
    owner: Numbers,
    holder: Numbers,
) -> int:
    """Check the velocities of a step, set friction for them, and find what grippers hold and touch.

    Args:
        most_speed: Speed that no valid state reaches, rad/s or m/s.
        q: Positions of the plant after the integration, of shape (nq,).
        v: Its velocities, of shape (nv,).
        joints: Row, and address of the velocity in the plant, of each joint with friction, (k, 2).
        friction: As in `apply_friction`.
        dry: As there; changed.
        damping: As there; changed.
        geoms: As in `find_held`.
        distances: As there.
        pads: As there.
        bodies: As there.
        addresses: As there.
        positions: As there.
        quaternions: As there.
        held: As there; changed.
        poses: As there; changed.
        owner: As in `any_foreign_contact`.
        holder: As there.

    Returns:
        Twice the number of held bodies, plus 1 if there is a foreign contact; -1 if the state is
        not finite or impossibly fast, and nothing has been changed.
    """
    if not (square(v) < most_speed * most_speed and math.isfinite(square(q))):
        return -1
    apply_friction(joints, friction, v, dry, damping)
    count = find_held(
        geoms, distances, pads, bodies, addresses, positions, quaternions, held, poses
    )
    return 2 * count + any_foreign_contact(geoms, owner, holder)


@kernel
def read_sensors(
    time: float,
    joints: Numbers,
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
    fingers: Numbers,
    finger_drives: Matrix,
    finger_readings: Matrix,
    finger_noise: Matrix,
    widths: Stack,
    sensed: Vector,
    rotations: Matrix,
    tools: Stack,
    gains: Matrix,
    pad_noise: Stack,
    forces: Stack,
) -> bool:
    """Read all encoders, see `read_joints`, and all fingers, see `read_fingers`."""
    read_joints(joints, q, v, encoders, counts, noise, row, past, newest, step, before, readings)
    return read_fingers(
        time,
        q,
        fingers,
        finger_drives,
        finger_readings,
        finger_noise,
        widths,
        sensed,
        rotations,
        tools,
        gains,
        pad_noise,
        forces,
    )
