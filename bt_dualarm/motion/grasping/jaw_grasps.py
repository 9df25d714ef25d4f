"""Candidates of a parallel gripper on a solid: pinches, turned about, that its fingers allow."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bt_dualarm.motion.grasping.antipodal import pinches
from bt_dualarm.motion.grasping.grasp import Grasp
from bt_dualarm.motion.grasping.gripper_measures import JawMeasures, Load
from bt_dualarm.motion.grasping.holding_force import shaken
from bt_dualarm.motion.grasping.solids import Solid
from bt_dualarm.pose import Matrix, Pose, Vector

CLEAR = 0.002
"""Distance in m that open pads, and the palm, keep from what they come around."""

_EACH = 32  # grasps of a pinch at most


def jaw_grasps(
    solid: Solid, jaw: JawMeasures, load: Load, friction: float, seed: int = 0
) -> tuple[Grasp, ...]:
    """All candidates, firmest first.

    Args:
        solid: Solid that is to be taken, in its own frame.
        jaw: Measures of the gripper.
        load: What the grip has to bear.
        friction: Coefficient of friction between the pads and the solid.
        seed: Seed of what is sampled, of meshes.
    """
    length = float(np.linalg.norm(load.gravity))
    down = load.gravity / length if length > 0.0 else np.array([0.0, 0.0, -1.0])
    lines = np.array([
        np.concatenate((one.center, one.axis, one.around))
        for one in pinches(solid, down, np.random.default_rng(seed))
    ]).reshape(-1, 9)  # fmt: skip
    rows = _shut(solid, jaw, load, friction, lines)
    found = [grasp for row in rows for grasp in _both_ways(row, jaw)]
    return tuple(sorted(found, key=lambda grasp: grasp.force))


def _shut(solid: Solid, jaw: JawMeasures, load: Load, friction: float, lines: Matrix) -> Matrix:
    """Where the pads hold it, one row each: as `shut_along` enters them."""
    from bt_dualarm.motion.pinching.jaw_kernels import shut_along

    deep, room = jaw.palm + jaw.pad_center - CLEAR, 0.5 * jaw.widest_opening - CLEAR
    least = jaw.least_opening + CLEAR
    measures = np.array((jaw.pad_length, jaw.pad_width, deep, least, room, jaw.most_force))
    found = np.empty((_EACH * len(lines), 11))
    center = np.ascontiguousarray(load.center, dtype=float)
    count = shut_along(*solid.form, lines, measures, shaken(load), center, float(friction), found)
    return found[:count]


def _both_ways(row: Vector, jaw: JawMeasures) -> Iterator[Grasp]:
    """The grasps of one row: either finger may be on either side."""
    axis, approach = row[3:6].tolist(), row[6:9].tolist()
    width, force = row[9:].tolist()
    margin = jaw.most_force / max(force, 1e-9)
    (a, b, c), (d, e, f) = axis, approach
    x = (b * f - c * e, c * d - a * f, a * e - b * d)
    rows = list(zip(x, axis, approach, strict=True))
    tool = Pose.from_axes(row[:3] - jaw.pad_center * row[6:9], rows)
    w, i, j, k = tool.quaternion.tolist()
    sign = -1.0 if k > 0.0 else 1.0  # so that w is not negative
    yield Grasp(tool, width, force, margin)
    yield Grasp(Pose(tool.position, sign * np.array((-k, j, -i, w))), width, force, margin)


def least_width(solid: Solid, seed: int = 0) -> float:
    """Least distance in m between opposite points of a solid: what a gripper has to open to."""
    down, rng = np.array([0.0, 0.0, -1.0]), np.random.default_rng(seed)
    return min(
        solid.reach(pinch.axis) + solid.reach(-pinch.axis) for pinch in pinches(solid, down, rng)
    )
