"""Asking Ruckig for a motion, where it may find no root."""

from __future__ import annotations

import ruckig

from bt_dualarm.errors import Failure
from bt_dualarm.pose import Vector

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
