"""How far a motion of the joints can move any point of an arm."""

from __future__ import annotations

from collections.abc import Iterable, Sequence, Set

import mujoco
import numpy as np

from bt_dualarm.pose import Matrix, Vector

FINE = 0.008
"""Most that a point of the arm moves between two checks of a result, in metres: together with the
thickness of a link, too little to step through a wall of 10 mm."""


def sweep_radii(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    joints: Sequence[int],
    moving: Iterable[int],
    held: Set[int],
) -> Vector:
    """Per joint, metres that a point of the arm moves at most per radian, of shape (dof,).

    The way from a joint's axis over all further joints to the farthest shape, stretched out: it
    holds in every configuration.

    Args:
        model: With the arm in it.
        data: The arm in any configuration.
        joints: Their numbers, base to tip.
        moving: Shapes of the arm, and of what it holds.
        held: Those of them that hang on the last joint.
    """
    anchors = data.xanchor[joints]
    links = model.jnt_bodyid[joints].tolist()
    farthest = np.zeros(len(links))
    for geom in moving:
        last = len(links) - 1
        link = last if geom in held else _last_link(links, int(model.geom_bodyid[geom]), model)
        if link is not None:
            distance = np.linalg.norm(data.geom_xpos[geom] - anchors[link])
            farthest[link] = max(farthest[link], distance + model.geom_rbound[geom])
    radii = farthest.copy()
    for i in range(len(links) - 2, -1, -1):
        onwards = np.linalg.norm(anchors[i + 1] - anchors[i]) + radii[i + 1]
        radii[i] = max(radii[i], onwards)
    return radii


def _last_link(links: list[int], body: int, model: mujoco.MjModel) -> int | None:
    """Index of the last joint that moves a body; None for the base, which no joint moves."""
    while body not in links and body != 0:
        body = int(model.body_parentid[body])
    return links.index(body) if body else None


def interpolated(start: Vector, end: Vector, radii: Vector, step: float) -> Matrix:
    """Configurations on a straight line between which no point moves more than ``step`` metres.

    Of shape (n, dof), with both ends.
    """
    way = float(np.abs(end - start) @ radii)
    share = np.linspace(0.0, 1.0, max(int(np.ceil(way / step)), 1) + 1)
    rows: Matrix = start + share[:, None] * (end - start)
    return rows
