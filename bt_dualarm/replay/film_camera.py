"""Where a film is seen from: near what moves, and steady."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix
from bt_dualarm.replay.film_scene import INSET
from bt_dualarm.replay.record import Record, ReplayError
from bt_dualarm.world.rendering.still import Still, best_viewpoint
from bt_dualarm.world.rendering.viewpoint import Viewpoint, fitted
from bt_dualarm.world.robots.geom_groups import OBJECT_GROUP, SCENE_GROUP
from bt_dualarm.world.robots.mjspec import TOOL_SITE

_STILLS: Final = 7
"""Moments by which the side is chosen from which the run is seen best."""

_EVERY_S: Final = 0.2
_CALM_S: Final = 1.5
"""Seconds over which the camera is carried along: standard deviation of the mean."""

_NEAR: Final = 0.2
"""How near it goes: 0 shows all of the cell all the time, 1 what moves alone."""

_AT_HAND_M: Final = 0.35


def followed(record: Record, times: Sequence[float], aspect: float) -> list[Viewpoint]:
    """A viewpoint for each time in s: one side of the cell, nearer where the work is.

    Args:
        record: The record.
        times: Simulated times in s, ascending.
        aspect: Width of the picture by its height.

    Raises:
        ReplayError: There is nothing to be seen in the record.
    """
    stills = [_still(record, time) for time in np.linspace(times[0], times[-1], _STILLS).tolist()]
    whole = best_viewpoint(stills, aspect)
    if whole is None:
        raise ReplayError(f"{record.folder} holds nothing to be seen: no arm, no object")
    knots = np.arange(times[0], times[-1] + _EVERY_S, _EVERY_S)
    way = np.array([_wanted(_still(record, time), whole, aspect) for time in knots.tolist()])
    weights = np.exp(-0.5 * ((knots[:, None] - knots[None]) / _CALM_S) ** 2)
    calm = weights @ way / weights.sum(axis=1, keepdims=True)
    columns = [np.interp(times, knots, column) for column in calm.T]
    return [
        Viewpoint(row[:3], row[3:], whole.fov_deg) for row in np.column_stack(columns).astype(float)
    ]


def clear_corner(
    record: Record, times: Sequence[float], viewpoints: Sequence[Viewpoint], aspect: float
) -> tuple[bool, bool]:
    """The corner of the picture where least is hidden: whether it is left, and whether it is top.

    Args:
        record: The record.
        times: Simulated times in s.
        viewpoints: Viewpoint of each time.
        aspect: Width of the picture by its height.
    """
    found = np.zeros((2, 2))
    for place in np.linspace(0, len(times) - 1, _STILLS).astype(int).tolist():
        still = _still(record, times[place])
        own = still.model.geom_group != SCENE_GROUP
        x, y = viewpoints[place].pixels(still.corners(own), 1000, round(1000 / aspect)).T
        share = INSET * 1000 * 1.1
        for left in (False, True):
            for top in (False, True):
                across = x < share if left else x > 1000 - share
                along = y < share if top else y > 1000 / aspect - share
                found[int(left), int(top)] += np.count_nonzero(across & along)
    order = [(True, False), (False, False), (True, True), (False, True)]
    return min(order, key=lambda corner: float(found[int(corner[0]), int(corner[1])]))


def _still(record: Record, time: float) -> Still:
    moment = record.moment(record.index_at(min(time, record.until)))
    return Still(record.model(moment.generation), moment.qpos, moment.time)


def _wanted(still: Still, whole: Viewpoint, aspect: float) -> Matrix:
    """Eye and point looked at, of shape (6,), m: between all of the cell and the work alone."""
    points = still.corners(_work(still))
    if not len(points):
        return np.concatenate((whole.eye, whole.look_at))
    near = fitted(points, whole.eye - whole.look_at, whole.fov_deg, aspect)
    far = np.concatenate((whole.eye, whole.look_at))
    wanted: Matrix = far + _NEAR * (np.concatenate((near.eye, near.look_at)) - far)
    return wanted


def _work(still: Still) -> npt.NDArray[np.bool_]:
    """Which shapes the work is about: the outer halves of the arms, and what is at their tools."""
    model, data = still.model, still.data
    names = [model.body(body).name for body in model.geom_bodyid]
    sites = [s for s in range(model.nsite) if model.site(s).name.endswith(f"/{TOOL_SITE}")]
    tools = data.site_xpos[sites]
    outer = {
        model.body(body).name
        for site in sites
        for body in _outer_half(model, int(model.site_bodyid[site]))
    }
    at_hand = np.zeros(model.ngeom, bool)
    if len(tools):
        away = np.linalg.norm(data.geom_xpos[:, None] - tools[None], axis=2).min(axis=1)
        at_hand = (model.geom_group == OBJECT_GROUP) & (away < _AT_HAND_M)
    found: npt.NDArray[np.bool_] = at_hand | np.array([name in outer for name in names], bool)
    return found


def _outer_half(model: mujoco.MjModel, tip: int) -> list[int]:
    """Bodies from the tool down to the middle of its arm."""
    chain = [tip]
    while model.body_parentid[chain[-1]]:
        chain.append(int(model.body_parentid[chain[-1]]))
    return chain[: -(-len(chain) // 2)]
