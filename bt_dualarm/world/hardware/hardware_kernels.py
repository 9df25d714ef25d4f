"""What sensors, drives and friction do at each physics step, joint by joint, of all arms."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.hardware.kernel_columns import (
    COULOMB,
    COUNT,
    CREEP,
    DROP,
    EFFORT,
    GAIN,
    KEPT,
    LATE,
    NARROW,
    OFFSET,
    PER_STEP,
    RESOLUTION,
    RISE,
    SHARE,
    TAKEN,
    TORQUE,
    VISCOUS,
    WANTED,
    WHOLE,
    WINDOW,
)

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
        joint, place, rate = where[k, 0], where[k, 1], where[k, 2]
        reading = in_steps(q[place] + noise[row, joint], encoders[joint, RESOLUTION])
        past[newest, joint] = readings[0, joint] = reading
        window, count = counts[joint, WINDOW], counts[joint, COUNT]
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
        joint, motor, late = where[k, 0], where[k, 1], int(drives[where[k, 0], WHOLE])
        sent[newest, joint] = drives[joint, WANTED]
        last, before = (
            sent[(newest - late) % count, joint],
            sent[(newest - late - 1) % count, joint],
        )
        asked = last + drives[joint, LATE] * (before - last)
        share, torque = drives[joint, SHARE], drives[joint, TORQUE]
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
        asked, effort = torque[i], drives[i, EFFORT]
        if drives[i, PER_STEP] > 0.0:
            asked = np.rint(asked * drives[i, PER_STEP])
        drives[i, WANTED] = max(min(drives[i, GAIN] * asked, effort), -effort)


@kernel
def rub(where: Numbers, friction: Matrix, v: Vector, dry: Vector, damping: Vector) -> None:
    """Enter friction at velocities of now.

    Args:
        where: Row, and address of the velocity of each joint, of shape (k, 2).
        friction: Friction of the joints, see `kernel_columns`.
        v: Velocities of the plant, of shape (nv,), rad/s.
        dry: Takes dry friction, of shape (nv,), N m.
        damping: Takes what grows with speed, of shape (nv,), N m s/rad.
    """
    for k in range(len(where)):
        joint, i = where[k, 0], where[k, 1]
        fall = friction[joint, DROP]
        if fall != 0.0:
            fall *= math.exp(v[i] * v[i] * friction[joint, NARROW])
        rise, offset = friction[joint, RISE], friction[joint, OFFSET]
        if rise > 0.0:
            speed, start = v[i] + CREEP, math.tanh(offset / rise)
            build_up = math.tanh((speed + offset) / rise) - start
            gentle = (friction[joint, COULOMB] + fall) * build_up / speed
            dry[i], damping[i] = 0.0, friction[joint, VISCOUS] + gentle
        else:
            dry[i], damping[i] = friction[joint, COULOMB] + fall, friction[joint, VISCOUS]
