"""What sensors, drives and friction do at each physics step, joint by joint."""

from __future__ import annotations

import math

import numpy as np

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.hardware.kernel_rows import (
    COULOMB,
    CREEP,
    DROP,
    EFFORT,
    GAIN,
    NARROW,
    OFFSET,
    PER_STEP,
    RISE,
    VISCOUS,
    WANTED,
)


@kernel
def difference(
    q: Vector,
    noise: Matrix,
    row: int,
    resolution: float,
    past: Matrix,
    newest: int,
    oldest: int,
    kept: float,
    rate: float,
    before: Vector,
    read: Matrix,
) -> None:
    """Enter what encoders read into the readings of the past, and what velocities come of it.

    Args:
        q: Positions, of shape (dof,), rad.
        noise: Noise of readings, of shape (n, dof), rad.
        row: Row of it that this reading has.
        resolution: Steps in which they are read, rad; 0 for none.
        past: Earlier readings, of shape (n, dof), rad.
        newest: Row of them that this one takes.
        oldest: Row that it is held against.
        kept: Share of the velocities that stays.
        rate: Velocity for a difference of one, 1/s.
        before: Velocities so far, of shape (dof,), rad/s.
        read: Takes readings and velocities, of shape (2, dof), rad and rad/s.
    """
    for i in range(len(q)):
        reading = q[i] + noise[row, i]
        if resolution > 0.0:
            reading = np.rint(reading * (1.0 / resolution)) * resolution
        past[newest, i] = read[0, i] = reading
        read[1, i] = before[i] * kept + (reading - past[oldest, i]) * rate


@kernel
def pass_on(
    sent: Matrix,
    newest: int,
    wanted: Vector,
    rest: float,
    share: float,
    torque: Vector,
    motors: Vector,
) -> None:
    """Enter torques that were sent a while ago, and what a slow drive makes of them.

    Args:
        sent: Torques of the last steps, of shape (n, dof), N m: rows go round.
        newest: Row of those of now.
        wanted: Torques of now, of shape (dof,), N m.
        rest: Part of a step by which they are late, beyond whole ones.
        share: Share of the way to a torque that is gone in a step.
        torque: Torque of the drives, of shape (dof,), N m.
        motors: Takes the same, in the plant.
    """
    count = len(sent)
    first, second = (newest + 1) % count, (newest + 2) % count
    for i in range(len(torque)):
        sent[newest, i] = wanted[i]
        asked = sent[second, i] + rest * (sent[first, i] - sent[second, i])
        torque[i] = torque[i] + share * (asked - torque[i]) if share < 1.0 else asked
        motors[i] = torque[i]


@kernel
def take_torques(torque: Vector, drives: Matrix) -> None:
    """Enter what motors are to give: in whole steps, with their gain, within their efforts.

    Args:
        torque: Torques that are commanded, of shape (dof,), N m.
        drives: What is known of the drives, see `kernel_rows`; takes the torques.
    """
    for i in range(len(torque)):
        asked, effort = torque[i], drives[EFFORT, i]
        if drives[PER_STEP, i] > 0.0:
            asked = np.rint(asked * drives[PER_STEP, i])
        drives[WANTED, i] = max(min(drives[GAIN, i] * asked, effort), -effort)


@kernel
def rub(joints: Matrix, v: Vector, dry: Vector, damping: Vector) -> None:
    """Enter friction at velocities of now.

    Args:
        joints: Friction of the joints, see `kernel_rows`.
        v: Velocities, of shape (dof,), rad/s.
        dry: Takes dry friction, of shape (dof,), N m.
        damping: Takes what grows with speed, of shape (dof,), N m s/rad.
    """
    for i in range(len(v)):
        fall = joints[DROP, i]
        if fall != 0.0:
            fall *= math.exp(v[i] * v[i] * joints[NARROW, i])
        rise = joints[RISE, i]
        if rise > 0.0:
            speed, start = v[i] + CREEP, math.tanh(joints[OFFSET, i] / rise)
            build_up = math.tanh((speed + joints[OFFSET, i]) / rise) - start
            gentle = (joints[COULOMB, i] + fall) * build_up / speed
            dry[i], damping[i] = 0.0, joints[VISCOUS, i] + gentle
        else:
            dry[i], damping[i] = joints[COULOMB, i] + fall, joints[VISCOUS, i]
