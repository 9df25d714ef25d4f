"""Where an arm goes back to that touches what it should not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bt_dualarm.errors import Failure, ForceFailure, HitFailure, TouchFailure
from bt_dualarm.motion.setpoints.set_point import SetPointSource
from bt_dualarm.motion.setpoints.trajectory_source import TrajectorySource
from bt_dualarm.pose import Vector

CONTACTS = (TouchFailure, ForceFailure, HitFailure)
"""Failures after which it goes back at all."""

BACK_OFF_S = 0.1
"""Planned seconds that an arm which touches something goes back."""

RECOIL_RAD = 0.02
"""Least way back of the joint that goes farthest, of an arm that presses too hard: where only its
set-point is back, its observer makes up for what pushes it, and it presses on."""


def way_back(
    motion: SetPointSource,
    refusal: Failure,
    q: Vector,
    v: Vector,
    is_free: Callable[[Vector], bool],
) -> Vector:
    """Configuration of shape (dof,), rad, on the way that an arm came.

    Args:
        motion: What it follows.
        refusal: Why it goes back.
        q: Where its joints are, of shape (dof,), rad.
        v: Velocities of the last set-point, of shape (dof,), rad/s: they tell the way of a stream.
        is_free: Whether an arm touches nothing in a configuration of shape (dof,), rad. One that
            has pressed too hard goes back until then: no plan could begin before.
    """
    if not isinstance(motion, TrajectorySource):
        return q - BACK_OFF_S * v
    presses = isinstance(refusal, ForceFailure)
    least = RECOIL_RAD if presses else 0.0
    now, ago = motion.parameter.s, BACK_OFF_S
    here = motion.configuration(now)
    while True:
        there = motion.configuration(max(now - ago, 0.0))
        enough = float(np.abs(there - here).max()) >= least
        if ago >= now or (enough and (not presses or is_free(there))):
            return there
        ago *= 2.0
