"""A motion from one configuration to another that touches nothing."""

from __future__ import annotations

from bt_dualarm.motion.collision import CollisionChecker
from bt_dualarm.motion.planning import FINE, plan
from bt_dualarm.motion.rounding import rounded
from bt_dualarm.motion.sweep import sweep_radii
from bt_dualarm.motion.timing import point_to_point, time_path
from bt_dualarm.motion.trajectory import Trajectory
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.catalogue import JointLimits


def free_motion(
    checker: CollisionChecker,
    start: Vector,
    goal: Vector,
    limits: JointLimits,
    dt: float,
    seed: int = 0,
) -> Trajectory:
    """The motion from rest to rest, straight in joint space if that is free, else around.

    Args:
        checker: The arm in its world; as it stands now, so execute soon or check again.
        start: Of shape (dof,), rad.
        goal: Of shape (dof,), rad.
        limits: The arm's, scaled by the speed.
        dt: Time between set-points in seconds.
        seed: Chooses the way among many.

    Raises:
        Failure: As ``plan``.
    """
    corners = plan(checker, start, goal, limits, seed)
    if len(corners) == 2:
        return point_to_point(start, goal, limits, dt)
    radii = sweep_radii(checker)
    motion = Trajectory.rest(start, dt)
    for piece in rounded(corners, checker, radii):
        motion = motion.then(time_path(piece, limits, dt))
    refuse_contact(checker, motion.q, radii)
    return motion


def refuse_contact(checker: CollisionChecker, rows: Matrix, radii: Vector) -> None:
    """Check configurations, of shape (n, dof), as they will be sent, every ``FINE`` metres.

    Raises:
        Failure: ``IN_COLLISION`` at the first one that touches something.
    """
    last = rows[0]
    for i, q in enumerate(rows):
        way = abs(q - last) @ radii
        if 0 < i < len(rows) - 1 and way + _step(rows, i, radii) <= FINE:
            continue
        last = q
        contact = checker.contact(q)
        if contact is not None:
            raise contact.failure()


def _step(rows: Matrix, i: int, radii: Vector) -> float:
    return float(abs(rows[i + 1] - rows[i]) @ radii)
