"""Set-points of a servo for some targets: python -m tests.trajectory.served panda ur5.

They are written to standard output, pickled, to compare compiled kernels with plain Python.
"""

from __future__ import annotations

import pickle
import sys

import numpy as np

from bt_dualarm.control.planar_servo import PlaneTarget
from bt_dualarm.core.pose import Matrix
from tests.trajectory.test_planar_servo import Follower, at_rest, circle

SECONDS = 0.5


def served(robot: str) -> Matrix:
    """Positions, velocities, accelerations: on a circle, toward a distant target, and to rest."""
    turning = circle(0.05, 2.0)

    def place(time: float) -> PlaneTarget | None:
        if time < 0.25:
            return turning(time)
        return at_rest(np.array((0.3, 0.1))) if time < 0.4 else None

    motion = Follower(robot).follow(place, SECONDS)
    return np.hstack((motion.q, motion.v, motion.a))


if __name__ == "__main__":
    sys.stdout.buffer.write(pickle.dumps([served(robot) for robot in sys.argv[1:]]))
