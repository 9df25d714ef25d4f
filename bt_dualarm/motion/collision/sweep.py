"""How far a motion of the joints can move any point of an arm."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from bt_dualarm.pose import Matrix, Vector

FINE = 0.008
"""Most that a point of the arm moves between two checks of a result, in metres: together with the
thickness of a link, too little to step through a wall of 10 mm."""


def last_joint(model: mujoco.MjModel, links: Sequence[int], body: int) -> int | None:
    """Index of the last joint of an arm that moves a body; None for the base, which none moves.

    Args:
        model: Model with the arm in it.
        links: Ids of the bodies that the arm's joints move, base to tip.
        body: Id of a body of the arm, or of an object that it holds: the last joint's.
    """
    if model.body_rootid[body] != model.body_rootid[links[0]]:
        return len(links) - 1
    while body not in links and body != 0:
        body = int(model.body_parentid[body])
    return links.index(body) if body else None


def stretched(anchors: Matrix, last: Sequence[int], centers: Matrix, bounds: Vector) -> Vector:
    """How far a point can be at most from each joint that moves it, in m, of shape (dof,).

    The way from a joint's axis over all further joints to the farthest ball, stretched out: it
    holds in every configuration.

    Args:
        anchors: Points on the joints' axes, base to tip, of shape (dof, 3), m, in any
            configuration of the arm.
        last: Index of the last joint that moves each ball.
        centers: Centres of balls around all points, in the same configuration, of shape (n, 3), m.
        bounds: Radii of the balls, of shape (n,), m.
    """
    radii = np.zeros(len(anchors))
    np.maximum.at(radii, last, np.linalg.norm(centers - anchors[last], axis=1) + bounds)
    for i in range(len(anchors) - 2, -1, -1):
        onwards = np.linalg.norm(anchors[i + 1] - anchors[i]) + radii[i + 1]
        radii[i] = max(radii[i], onwards)
    return radii


def interpolated(start: Vector, end: Vector, radii: Vector, step: float) -> Matrix:
    """Configurations on a straight line between which no point moves more than ``step`` metres.

    Args:
        start: Configuration of shape (dof,), rad.
        end: Configuration of shape (dof,), rad.
        radii: Metres that a point of the arm moves at most per radian of each joint, (dof,).
        step: Most that a point moves between two rows, in metres.

    Returns:
        Rows of shape (n, dof), with both ends, to the bit: pieces of a path meet.
    """
    way = float(np.abs(end - start) @ radii)
    share = np.linspace(0.0, 1.0, max(int(np.ceil(way / step)), 1) + 1)
    rows: Matrix = start + share[:, None] * (end - start)
    rows[-1] = end
    return rows
