"""How far a motion of the joints can move any point of an arm."""

from __future__ import annotations

import mujoco
import numpy as np

from bt_dualarm.motion.collision import CollisionChecker
from bt_dualarm.pose import Matrix, Vector


def sweep_radii(checker: CollisionChecker) -> Vector:
    """Per joint, metres that a point of the arm moves at most per radian, of shape (dof,).

    The way from a joint's axis over all further joints to the farthest shape, stretched out: it
    holds in every configuration. What the arm holds counts as part of its last link.
    """
    model, data = checker.world.model, checker.world.data
    joints = [model.dof_jntid[dof] for dof in checker.body.dof_ids]
    anchors = [data.xanchor[joint] for joint in joints]
    links = [int(model.jnt_bodyid[joint]) for joint in joints]
    farthest = np.zeros(len(joints))
    for geom in np.flatnonzero(checker.moving):
        link = _last_link(links, int(model.geom_bodyid[geom]), model)
        distance = np.linalg.norm(data.geom_xpos[geom] - anchors[link])
        farthest[link] = max(farthest[link], distance + model.geom_rbound[geom])
    radii = farthest.copy()
    for i in range(len(joints) - 2, -1, -1):
        onwards = np.linalg.norm(anchors[i + 1] - anchors[i]) + radii[i + 1]
        radii[i] = max(radii[i], onwards)
    return radii


def _last_link(links: list[int], body: int, model: mujoco.MjModel) -> int:
    """Index of the last joint that moves a body; things held hang on the last one of all."""
    while body not in links and body != 0:
        body = int(model.body_parentid[body])
    return links.index(body) if body else len(links) - 1


def interpolated(start: Vector, end: Vector, radii: Vector, step: float) -> Matrix:
    """Configurations on a straight line between which no point moves more than ``step`` metres.

    Of shape (n, dof), with both ends.
    """
    way = float(np.abs(end - start) @ radii)
    share = np.linspace(0.0, 1.0, max(int(np.ceil(way / step)), 1) + 1)
    rows: Matrix = start + share[:, None] * (end - start)
    return rows
