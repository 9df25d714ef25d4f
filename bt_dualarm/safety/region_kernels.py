"""Compiled reachability bound: how long an arm may move freely within the room around it."""

from __future__ import annotations

from bt_dualarm.collision.sphere_kernels import reach
from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.trajectory.limit_kernels import max_displacement


@kernel
def longest_free_time(
    room: float,
    waits: Vector,
    levers: Matrix,
    span: float,
    limits: Matrix,
    now: Matrix,
    turns: Vector,
) -> tuple[int, float]:
    """First of several times for which an arm can move freely, and then brake, within the room.

    Args:
        room: Distance that no point of the arm may exceed, m.
        waits: Times in descending order, of shape (n,), s.
        levers: Distances of points from each joint, see `BoundingSpheres.levers`, (m, dof), m.
        span: Largest distance of any point from the first joint, m.
        limits: Joint limits, of shape (5, dof).
        now: Velocities and accelerations, of shape (2, dof), rad/s, rad/s².
        turns: Scratch: displacement of the joints, of shape (dof,), rad.

    Returns:
        Index of the time, -1 for none; and the largest displacement of any point within it, m.
    """
    for k in range(len(waits)):
        for i in range(len(turns)):
            turns[i] = max_displacement(limits, i, now[0, i], now[1, i], waits[k])
        away = reach(levers, turns, span)
        if away <= room:
            return k, away
    return -1, 0.0
