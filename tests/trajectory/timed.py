"""Motions along random paths, timed by the kernels.

As a program, it writes the pickled motions of the given seeds to standard output.
"""

from __future__ import annotations

import pickle
import sys

import numpy as np

from bt_dualarm.core.pose import Matrix
from bt_dualarm.robots.robot import JointLimits
from bt_dualarm.trajectory.path_timing import time_path

FAR = np.full(3, np.inf)
LIMITS = JointLimits(
    -FAR, FAR, np.array((1.0, 2.0, 3.0)), np.array((2.0, 5.0, 8.0)), np.full(3, 60.0), FAR
)


def timed(seed: int) -> tuple[Matrix, Matrix, Matrix]:
    """Set-points of a motion along an open path for even seeds, and a closed one for odd seeds."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 2.0 * np.pi, 12)[:, None]
    rows = rng.uniform(0.1, 0.4, 3) * np.sin(rng.integers(1, 3, 3) * t + rng.uniform(0.0, 6.0, 3))
    motion = time_path(rows, LIMITS, 0.02, closed=seed % 2 == 1)
    return motion.q, motion.v, motion.a


if __name__ == "__main__":
    sys.stdout.buffer.write(pickle.dumps([timed(int(seed)) for seed in sys.argv[1:]]))
