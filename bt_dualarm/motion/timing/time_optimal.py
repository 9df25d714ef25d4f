"""The fastest motion along a path under velocity and acceleration limits.

TOPP-RA (Pham and Pham, A new approach to time-optimal path parameterization based on reachability
analysis, T-RO 2018): a backward pass finds at each place the largest speed from which the end can
still be reached at rest, a forward pass takes the largest acceleration that keeps below it. Both
are compiled (`reach_kernels`).
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy

from bt_dualarm.motion.timing.kernel_arrays import PathOnGrid
from bt_dualarm.motion.timing.profile import Profile
from bt_dualarm.pose import Vector
from bt_dualarm.world.robots.robot import JointLimits

_STILL = 1e-12
"""Slope in rad below which a joint does not move: it bounds no speed."""


def _steps(samples: int) -> int:
    """Steps of the grid for a path through so many samples.

    Enough between two of them for a path that bends at each; many samples are of a smooth one.
    """
    return min(max(200, 2 * samples, min(8 * samples, 500)), 1500)


class TimeOptimal:
    """The fastest motions along a path, with more and less of the acceleration at each place.

    Args:
        path: Joint angles in rad over a path parameter that starts at zero.
        limits: Velocity and acceleration to keep; jerk is not looked at.

    Attributes:
        path: The path.
        grid: Places along the path at which its motion is decided, of shape (n,).
    """

    def __init__(self, path: scipy.interpolate.CubicSpline, limits: JointLimits) -> None:
        self.path = path
        self.grid = np.linspace(0.0, path.x[-1], _steps(len(path.x)) + 1)
        slope = path(self.grid, 1)
        fastest = (limits.velocity / np.maximum(np.abs(slope), _STILL)).min(axis=1)
        self._on_grid = PathOnGrid(self.grid, slope, path(self.grid, 2), fastest**2)
        self._acceleration = limits.acceleration

    @cached_property
    def fastest(self) -> Profile:
        """The fastest motion with all of the acceleration, which nothing else can go below."""
        return self.profile(np.ones_like(self.grid))

    def profile(self, share: Vector) -> Profile:
        """The fastest motion from rest to rest: a bound for any other.

        Args:
            share: Share of the acceleration limits that may be used at each place, of shape (n,),
                in (0, 1].
        """
        from bt_dualarm.motion.timing.reach_kernels import squares_of_rates

        squares = squares_of_rates(self._on_grid, self._acceleration, share)
        return Profile.from_rates(self.grid, np.sqrt(squares))
