"""For how long an arm may do as it likes: where it can get meanwhile, against the room it has."""

from __future__ import annotations

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.motion.chains.limit_kernels import turn_and_stop
from bt_dualarm.motion.collision.sphere_kernels import reach
from bt_dualarm.pose import Matrix, Vector


@kernel
def first_within(
    room: float,
    waits: Vector,
    levers: Matrix,
    span: float,
    limits: Matrix,
    now: Matrix,
    turns: Vector,
) -> tuple[int, float]:
    """The first of several times for which an arm, that brakes then, has room enough.

    Args:
        room: Room that it has all around, m.
        waits: Times, of shape (n,), s.
        levers: Distances of its points from each joint, see `BoundingSpheres.levers`, (m, dof), m.
        span: Largest distance of any point from the first joint, m.
        limits: Limits of the joints, of shape (5, dof).
        now: Velocities and accelerations, of shape (2, dof), rad/s, rad/s².
        turns: Takes how far the joints get in that time, of shape (dof,), rad.

    Returns:
        Which of them, -1 for none, and how far any point gets in it, m.
    """
    for k in range(len(waits)):
        for i in range(len(turns)):
            turns[i] = turn_and_stop(limits, i, now[0, i], now[1, i], waits[k])
        away = reach(levers, turns, span)
        if away <= room:
            return k, away
    return -1, 0.0
