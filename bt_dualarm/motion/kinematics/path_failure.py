"""Why a path of the tool cannot be followed to its end."""

from __future__ import annotations

import numpy as np

from bt_dualarm.errors import Failure
from bt_dualarm.motion.kinematics.chain import Chain
from bt_dualarm.pose import Pose, Vector

SINGULAR_CONDITION = 50.0
"""Condition number of the Jacobian (metres and radians as they are) from which an arm counts as
singular, and goes at half speed: in its worst direction the tool needs fifty times the joint rates
of its best. A UR5 at home has 8, and 50 within 14° of a stretched elbow, 5 mm before it can reach
no farther."""

_AT_LIMIT = 0.02  # rad


def broken(arm: Chain, q: Vector, pose: Pose, fraction: float, branches: int) -> Failure:
    """The refusal of a path.

    Args:
        arm: Arm that was to follow it.
        q: Configuration at the last sample that could be followed, of shape (dof,).
        pose: First pose that could not.
        fraction: Share of the path up to there.
        branches: Number of start configurations that were tried.

    Returns:
        ``SINGULAR`` where the arm is singular, else ``PATH_BROKEN``.
    """
    place = ", ".join(f"{x:.3f}" for x in pose.position)
    how_far = f"the arm can follow only {100.0 * fraction:.0f} % of the path, to ({place}) m"
    numbers = {"fraction": fraction, "branches": branches}
    condition = min(arm.condition(q), 1e12)
    if condition > SINGULAR_CONDITION:
        return Failure(
            "SINGULAR", f"{how_far}: it is singular there", **numbers, condition=condition
        )
    room = np.minimum(q - arm.lower, arm.upper - q)
    joint = int(np.argmin(room))
    why = f": {arm.robot.joints[joint]} is at its limit" if room[joint] < _AT_LIMIT else ""
    return Failure("PATH_BROKEN", how_far + why, **numbers)
