"""A gripper's page as the measures that count for where it can grasp."""

from __future__ import annotations

import numpy as np

from bt_dualarm.motion.grasping.gripper_measures import CupMeasures, JawMeasures
from bt_dualarm.pose import Pose, Vector
from bt_dualarm.world.grippers.gripper import Gripper, Solid

_THICK = 0.02  # m; of a finger whose shape is a mesh


def jaw_measures(page: Gripper, friction: float) -> JawMeasures:
    """Measures of two fingers.

    Args:
        page: Page of the gripper.
        friction: Coefficient of friction of what is to be held.
    """
    finger = page.fingers[0]
    in_tool = page.tool.inverse @ finger.pose
    pad = in_tool @ finger.pad.pose
    width, thickness, length = finger.pad.size
    center = float(pad.position[2])
    corners = [_corners(in_tool @ one.pose, one) for one in (finger.pad, *finger.part.collision)]
    points = np.vstack([one for one in corners if one is not None])
    outside = float(np.abs(points[:, 1]).max()) if len(points) > 8 else thickness + _THICK
    return JawMeasures(
        least_opening=0.0,
        widest_opening=page.stroke,
        pad_length=length,
        pad_width=width,
        palm=-float(in_tool.position[2]),
        tip=float(points[:, 2].max()),
        thickness=outside,
        least_force=page.force.least,
        most_force=page.force.most,
        friction=max(page.friction, friction),
        pad_center=center,
    )


def cup_measures(page: Gripper, friction: float) -> CupMeasures:
    """Measures of a suction cup.

    Args:
        page: Page of the gripper.
        friction: Coefficient of friction of what is to be held.

    Raises:
        ValueError: It has no cup.
    """
    if page.cup is None:
        raise ValueError(f"{page.name} has no cup")
    return CupMeasures(
        radius=page.cup.radius,
        bends=1e-3,
        most_force=page.force.most,
        friction=max(page.friction, friction),
    )


def _corners(pose: Pose, solid: Solid) -> Vector | None:
    """Corners of the box around a shape, of shape (8, 3), m; None of a mesh."""
    if solid.kind == "mesh":
        return None
    size = solid.size
    if solid.kind == "box":
        half = 0.5 * np.asarray(size)
    else:
        half = np.array([size[0], size[0], 0.5 * size[1] if len(size) > 1 else size[0]])
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    corners: Vector = pose.apply(signs * half)
    return corners
