"""What the kernels of grippers make of random numbers: python -m tests.world.grippers.passed 0 1.

Writes it, pickled, to standard output: once compiled, once read by Python itself.
"""

from __future__ import annotations

import pickle
import sys

import numpy as np

from bt_dualarm.pose import Matrix
from bt_dualarm.world.grippers.finger_kernels import push, read_width
from bt_dualarm.world.grippers.grip_kernels import carry, held_by
from bt_dualarm.world.grippers.kernel_columns import DRIVE, LINK

STEPS, LINKS, BODIES = 20, 4, 6
HOLDERS = np.array(((0, 1, 2, 1, 0, 3), (2, 2, 4, 1, 1, 4)))  # two fingers, and a cup


def passed(seed: int) -> Matrix:
    """What is held, where that goes, how fingers are driven and read, of shape (STEPS, n)."""
    rng = np.random.default_rng(seed)
    links, joints = rng.normal(size=(LINKS, LINK)), np.array(((0, 0), (1, 1), (-1, -1), (2, 2)))
    free, held = np.array((-1, -1, -1, 3, -1, 10)), np.zeros(2, np.int64)
    drive, past = rng.uniform(0.5, 2.0, DRIVE), np.zeros((5, 2))
    rows = []
    for step in range(STEPS):
        geoms = rng.integers(0, 5, (8, 2)).astype(np.int32)
        bodies = np.array((2, 2, 4, 3, 5), np.int32)
        held_by(geoms, rng.uniform(-1.0, 0.2, 8), HOLDERS, bodies, free, held)
        q, v, places = rng.normal(size=17), rng.normal(size=3), rng.normal(size=(BODIES, 3))
        turns, screws = rng.normal(size=(BODIES, 4)), rng.normal(size=(3, 6))
        carry(held, HOLDERS, links, joints, free, q, v, places, turns, screws, places, 0.002)
        motor, noise = np.zeros(1), float(rng.normal())
        push(q[:2], v[:2], drive, 0.002, motor)
        width = read_width(q[:2], noise, 0.01 * (step % 2), past, step, 0.002 * step)
        rows.append(np.concatenate((held, q, motor, drive, width)))
    return np.array(rows)


if __name__ == "__main__":
    sys.stdout.buffer.write(pickle.dumps([passed(int(seed)) for seed in sys.argv[1:]]))
