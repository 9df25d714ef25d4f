"""What flat pads meet when they shut on a solid: where, how much of them, how it slopes there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bt_dualarm.motion.grasping.solids import Solid
from bt_dualarm.pose import Vector


@dataclass(frozen=True, eq=False)
class PadContact:
    """The part of a pad that touches.

    Attributes:
        middle: Middle of it, of shape (3,), m.
        share: Share of the pad that touches, from 0 to 1.
        lever: Mean distance in m of what touches from its middle: friction times this is the
            largest moment of friction about the normal, where pressure is even.
        slope: Angle in rad between the pad's normal and the surface's there.
    """

    middle: Vector
    share: float
    lever: float
    slope: float


@dataclass(frozen=True, eq=False)
class Hold:
    """A solid between two pads.

    Attributes:
        center: Place in the middle between what touches, of shape (3,), m.
        width: Distance of the pads in m.
        lever: Smaller one of both pads' levers, m.
        tilt: Largest angle in rad from the pads' normal of the surface, and of the line between
            what touches on both sides.
    """

    center: Vector
    width: float
    lever: float
    tilt: float


def pressed(
    solid: Solid, center: Vector, normal: Vector, along: Vector, size: Vector
) -> PadContact | None:
    """What one pad meets that comes from outside; None if that is nothing.

    Args:
        solid: Solid that it is pressed against.
        center: Any place on the line along which the pad's middle comes, of shape (3,), m.
        normal: Direction from the solid to the pad, of unit length, of shape (3,).
        along: Direction of the pad's length, of unit length, square to the normal.
        size: Length and width of the pad, of shape (2,), m.
    """
    from bt_dualarm.motion.pinching.pad_kernels import press

    met = np.empty(6)
    if not press(*solid.form, center, normal, along, size, met):
        return None
    return PadContact(met[:3], float(met[3]), float(met[4]), float(met[5]))


def held(solid: Solid, center: Vector, axis: Vector, along: Vector, size: Vector) -> Hold | None:
    """What two pads hold that shut along an axis; None if one of them meets nothing.

    Args:
        solid: Solid between them.
        center: Place on the line between the pads' middles, of shape (3,), m.
        axis: Direction in which they close, of unit length, of shape (3,).
        along: Direction of their length, of unit length, square to the axis.
        size: Length and width of a pad, of shape (2,), m.
    """
    from bt_dualarm.motion.pinching.pad_kernels import hold

    between = np.empty(6)
    if not hold(*solid.form, center, axis, along, size, between):
        return None
    return Hold(between[:3], float(between[3]), float(between[4]), float(between[5]))
