"""Asking Ruckig for a motion, where it may find no root."""

from __future__ import annotations

import numpy as np
import ruckig

from bt_dualarm.errors import Failure
from bt_dualarm.pose import Matrix, Vector

_LESS_JERK = (1.0, 0.999, 0.99, 0.9)
"""Shares of the jerk limits that are tried in turn."""


def answer(
    request: ruckig.InputParameter, jerk: Vector, solver: ruckig.Ruckig | None = None
) -> ruckig.Trajectory:
    """Ruckig's trajectory for a request.

    Where a step of the solution takes exactly no time, Ruckig may find no root; a little less jerk
    leads past such a place.

    Args:
        request: State, target and limits but the jerk's.
        jerk: Limits, of shape (dof,), rad/s³.
        solver: Ruckig of as many joints, if there is one already.

    Raises:
        Failure: ``NO_PLAN`` with Ruckig's words.
    """
    solver = solver or ruckig.Ruckig(request.degrees_of_freedom)
    trajectory, refusal = ruckig.Trajectory(request.degrees_of_freedom), ""
    for share in _LESS_JERK:
        request.max_jerk = (share * jerk).tolist()
        try:
            result = solver.calculate(request, trajectory)
        except ruckig.RuckigError as error:
            refusal = str(error)
            continue
        if result in (ruckig.Result.Working, ruckig.Result.Finished):
            return trajectory
        refusal = result.name
    raise Failure(
        "NO_PLAN", f"Ruckig finds no motion within the limits: {' '.join(refusal.split())}"
    )


def states_of(motion: ruckig.Trajectory, times: Vector) -> Matrix:
    """Position, velocity and acceleration of the only joint of a motion, of shape (n, 3).

    What `at_time` says of one time after the other, to the last bit, at a tenth of the cost: each
    piece has an even jerk.

    Args:
        motion: Motion of one joint that begins within its limits, so that it brakes for none.
        times: Times of shape (n,), s, none beyond the end.
    """
    profile = motion.profiles[0][0]
    ends = np.cumsum(profile.t)
    piece = np.searchsorted(ends, times, side="right")
    piece[times >= motion.duration] = len(ends)  # which the sum of all pieces may miss by rounding
    t = times - np.concatenate(((0.0,), ends))[piece]
    p, v, a, j = np.array((profile.p, profile.v, profile.a, (*profile.j, 0.0)))[:, piece]
    states = np.empty((len(t), 3))
    states[:, 0] = p + t * (v + t * (a / 2 + t * j / 6))
    states[:, 1] = v + t * (a + t * j / 2)
    states[:, 2] = a + t * j
    return states
