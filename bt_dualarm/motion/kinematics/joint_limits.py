"""Joint targets: refused where the joints cannot go."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bt_dualarm.errors import Failure
from bt_dualarm.pose import Vector
from bt_dualarm.world.robots.robot import JointLimits


def refuse_beyond(joints: Sequence[str], q: Vector, limits: JointLimits) -> None:
    """Check a configuration, of shape (dof,), before anything moves.

    Raises:
        Failure: ``INVALID_TARGET`` for what is no configuration of these joints; ``JOINT_LIMIT``
            with the joint that is farthest beyond its limit.
    """
    if q.shape != (len(joints),) or not np.isfinite(q).all():
        raise Failure("INVALID_TARGET", f"{q.tolist()} are no angles of {len(joints)} joints")
    beyond = np.maximum(limits.lower - q, q - limits.upper)
    worst = int(np.argmax(beyond))
    if beyond[worst] > 1e-9:
        limit = limits.lower[worst] if q[worst] < limits.lower[worst] else limits.upper[worst]
        raise Failure(
            "JOINT_LIMIT",
            f"{joints[worst]} would be {np.rad2deg(beyond[worst]):.1f}° beyond its limit of "
            f"{np.rad2deg(limit):.1f}°",
            joint=joints[worst],
            beyond_rad=float(beyond[worst]),
        )
