"""Whether something is where a motion was to bring it."""

from __future__ import annotations

from math import degrees

from bt_dualarm.errors import Failure, Number
from bt_dualarm.pose import Pose


def check_arrival(
    what: str, pose: Pose, goal: Pose, tolerance: float, angle_tolerance: float
) -> dict[str, Number]:
    """Distance and angle of something from its goal, as metrics.

    Args:
        what: Name of what has moved, for the sentence.
        pose: Pose that it has, in the world.
        goal: Pose that it was to have, in the world.
        tolerance: Largest distance in metres.
        angle_tolerance: Largest angle in radians.

    Raises:
        Failure: ``NOT_REACHED`` if that is more than a tolerance.
    """
    away, turn = pose.distance(goal), pose.angle(goal)
    metrics: dict[str, Number] = {"position_error_m": away, "angle_error_rad": turn}
    if away > tolerance or turn > angle_tolerance:
        raise Failure(
            "NOT_REACHED",
            f"{what} is {1000 * away:.2f} mm and {degrees(turn):.2f}° from its target",
            **metrics,
        )
    return metrics
