"""Candidates of a parallel gripper on a solid: pinches, turned about, that its fingers allow."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from bt_dualarm.motion.grasping.antipodal import Pinch, pinches
from bt_dualarm.motion.grasping.grasp import Grasp
from bt_dualarm.motion.grasping.gripper_measures import JawMeasures, Load
from bt_dualarm.motion.grasping.holding_force import pinching_force
from bt_dualarm.motion.grasping.pads import Hold, held
from bt_dualarm.motion.grasping.solids import Solid
from bt_dualarm.pose import Pose, Vector

ROLLS = 8
"""Approaches around the line of a pinch, of a whole turn."""

CLEAR = 0.002
"""Distance in m that open pads, and the palm, keep from what they come around."""

_HIGHER = (0.0, 0.004, 0.008, 0.016)
"""Metres by which a candidate stays behind the deepest one: where tips need room below."""

_HALF_TURN = Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, math.pi))


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
    found = [
        grasp
        for pinch in pinches(solid, down, np.random.default_rng(seed))
        for approach in _approaches(pinch)
        for grasp in _along(solid, jaw, load, friction, pinch, approach)
    ]
    return tuple(sorted(found, key=lambda grasp: grasp.force))


def least_width(solid: Solid, seed: int = 0) -> float:
    """Least distance in m between opposite points of a solid: what a gripper has to open to."""
    down, rng = np.array([0.0, 0.0, -1.0]), np.random.default_rng(seed)
    return min(
        solid.reach(pinch.axis) + solid.reach(-pinch.axis) for pinch in pinches(solid, down, rng)
    )


def _approaches(pinch: Pinch) -> Iterator[Vector]:
    other = np.cross(pinch.axis, pinch.around)
    for roll in np.arange(ROLLS) * 2.0 * np.pi / ROLLS:
        yield np.cos(roll) * pinch.around + np.sin(roll) * other


def _along(
    solid: Solid, jaw: JawMeasures, load: Load, friction: float, pinch: Pinch, approach: Vector
) -> Iterator[Grasp]:
    """Grasps along one approach, of shape (3,): the deepest, and some that are less deep."""
    behind = solid.reach(-approach) + float(pinch.center @ approach)
    too_deep = max(0.0, behind - (jaw.palm + jaw.pad_center - CLEAR))
    for higher in _HIGHER:
        center = pinch.center - (too_deep + higher) * approach
        hold = _hold(solid, jaw, pinch, center, approach)
        if hold is None:
            return
        left = math.tan(math.atan(friction) - hold.tilt)
        force = pinching_force(load, hold.center, pinch.axis, hold.width, hold.lever, left)
        if force > jaw.most_force:
            continue
        margin = jaw.most_force / max(force, 1e-9)
        middle = center + float((hold.center - center) @ pinch.axis) * pinch.axis
        pose = _tool(middle - jaw.pad_center * approach, pinch.axis, approach)
        for tool in (pose, pose @ _HALF_TURN):
            yield Grasp(tool, hold.width, force, margin)


def _hold(
    solid: Solid, jaw: JawMeasures, pinch: Pinch, center: Vector, approach: Vector
) -> Hold | None:
    """What the pads meet, if they come around the solid and shut on it."""
    size = np.array([jaw.pad_length, jaw.pad_width])
    hold = held(solid, center, pinch.axis, approach, size)
    if hold is None or hold.width < jaw.least_opening + CLEAR:
        return None
    middle = float(hold.center @ pinch.axis)
    beyond = max(solid.reach(pinch.axis) - middle, solid.reach(-pinch.axis) + middle)
    return hold if beyond <= 0.5 * jaw.widest_opening - CLEAR else None


def _tool(place: Vector, axis: Vector, approach: Vector) -> Pose:
    """The tool frame at ``place``: z along the approach, y along the line of the pads."""
    matrix = np.eye(4)
    matrix[:3] = np.column_stack((np.cross(axis, approach), axis, approach, place))
    return Pose.from_matrix(matrix)
