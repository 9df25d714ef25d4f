"""What of a gripper counts for where it can grasp: measures in its tool frame, z out of the tool.

The tool frame lies in the middle between the pads; they close along its y axis.
"""

from __future__ import annotations

from dataclasses import dataclass

from bt_dualarm.pose import Vector


@dataclass(frozen=True, eq=False)
class JawMeasures:
    """A parallel gripper of two fingers.

    Attributes:
        least_opening: Distance of the pads in m when it is shut.
        widest_opening: Distance of the pads in m when it is open.
        pad_length: Length of a pad along the tool's z axis, m.
        pad_width: Width of a pad along the tool's x axis, m.
        pad_center: Distance in m from the tool frame to the pads' middle, along z.
        palm: Distance in m from the tool frame back to the palm.
        tip: Distance in m from the tool frame forward to the fingers' tips.
        thickness: Thickness of a finger along the tool's y axis, m.
        least_force: Least force in N of each pad on what is held.
        most_force: Largest force in N, likewise.
        friction: Coefficient of sliding friction of the pads.
        palm_radius: Radius in m that the palm has about the tool's z axis.
    """

    least_opening: float
    widest_opening: float
    pad_length: float
    pad_width: float
    palm: float
    tip: float
    thickness: float
    least_force: float
    most_force: float
    friction: float
    pad_center: float = 0.0
    palm_radius: float = 0.04


@dataclass(frozen=True, eq=False)
class CupMeasures:
    """A suction cup whose rim is at the tool frame.

    Attributes:
        radius: Radius in m of the rim.
        bends: Depth in m by which the rim follows what is not flat.
        most_force: Largest force in N with which it pulls.
        friction: Coefficient of sliding friction of the rim.
    """

    radius: float
    bends: float
    most_force: float
    friction: float


@dataclass(frozen=True, eq=False)
class Load:
    """What a grip has to bear.

    Attributes:
        mass: Mass in kg.
        gravity: Acceleration of gravity in the object's frame, of shape (3,), m/s².
        shake: Largest acceleration of the tool in any direction, m/s².
        center: Centre of mass in the object's frame, of shape (3,), m.
    """

    mass: float
    gravity: Vector
    shake: float
    center: Vector
