"""Outputs of sensors, drives and friction for a motion: python -m tests.sim.passed 0 1.

They are written to standard output, pickled, to compare compiled kernels with plain Python.
"""

from __future__ import annotations

import pickle
import sys

import numpy as np

from bt_dualarm.core.pose import Matrix
from bt_dualarm.sim.device_kernels import apply_friction
from bt_dualarm.sim.kernel_arrays import FRICTION, NARROW, RISE
from bt_dualarm.spec.document import DriveErrors, EncoderErrors
from tests.sim.bench import BenchDrives, BenchEncoders

DOF = 4
STEPS = 20


def passed(seed: int) -> Matrix:
    """Readings, velocities, torques, friction and damping, of shape (STEPS, 5 DOF)."""
    rng = np.random.default_rng(seed)
    errors = EncoderErrors(resolution=0.01, noise=0.02, window=0.006, cutoff=80.0)
    encoders = BenchEncoders(errors, DOF, seed)
    sent = DriveErrors(delay=0.003, bandwidth=60.0, quantum=0.001)
    drives = BenchDrives(sent, rng.uniform(0.9, 1.1, DOF), np.full(DOF, 20.0))
    friction = rng.uniform(0.1, 1.0, (DOF, FRICTION))
    friction[:, NARROW] *= -1.0
    friction[::2, RISE] = 0.0
    where = np.stack((np.arange(DOF), np.arange(DOF)), axis=1)
    rows = []
    for step in range(STEPS):
        v = rng.normal(size=DOF)
        encoders.read(rng.normal(size=DOF), v, 0.002 * step)
        torque = drives.passed(20.0 * rng.normal(size=DOF))
        dry, damping = np.empty((2, DOF))
        apply_friction(where, friction, v, dry, damping)
        rows.append(np.concatenate((encoders.q, encoders.v, torque, dry, damping)))
    return np.array(rows)


if __name__ == "__main__":
    sys.stdout.buffer.write(pickle.dumps([passed(int(seed)) for seed in sys.argv[1:]]))
