"""Columns of the arrays that the kernels of sensors, drives, friction and fingers work on."""

from __future__ import annotations

from typing import Final

# One row per joint, of all arms.


# Encoders, of shape (n, ENCODERS).
RESOLUTION: Final = 0
"""Quantum of the positions, rad; 0 for none."""
OLD_WEIGHT: Final = 1
"""Weight of the previous velocity in the low-pass filter."""
NEW_WEIGHT: Final = 2
"""Weight of the new velocity in the low-pass filter."""
ENCODERS: Final = 3

# Readings, integers of shape (n, COUNTS).
WINDOW: Final = 0
"""Readings over which positions are differenced to a velocity; 0: the true velocity is read."""
COUNT: Final = 1
"""Number of readings so far, up to the window."""
COUNTS: Final = 2

# Friction, of shape (n, FRICTION).
COULOMB: Final = 0
"""Coulomb friction, N m."""
DROP: Final = 1
"""Static friction in excess of Coulomb friction, N m."""
NARROW: Final = 2
"""-1/v_s² with the Stribeck velocity v_s, s²/rad²."""
VISCOUS: Final = 3
"""Viscous friction, N m s/rad."""
RISE: Final = 4
"""Speed over which dry friction builds up, rad/s; 0 for a step."""
OFFSET: Final = 5
"""Offset of the speed in the sigmoid, rad/s."""
FRICTION: Final = 6

# Drives, of shape (n, DRIVES).
PER_STEP: Final = 0
"""Quanta per unit of torque, 1/(N m); 0 without quantization."""
GAIN: Final = 1
"""True torque of a quantum, N m, or factor of the torque without quantization."""
EFFORT: Final = 2
"""Effort limits, N m."""
COMMANDED: Final = 3
"""Commanded torques, quantized and with the gain error, N m."""
TORQUE: Final = 4
"""Applied torques, N m."""
WHOLE: Final = 5
"""Delay in whole physics steps."""
LATE: Final = 6
"""Remaining delay as a fraction of a step."""
SHARE: Final = 7
"""Weight of the commanded torque per step in the first-order lag."""
DRIVES: Final = 8

CREEP: Final = 1e-9
"""Speed in rad/s that is added before dividing by it: at rest the secant becomes the slope."""


# Drive of two fingers, of shape (DRIVE,). Widths are of the opening, forces of each finger.
STIFFNESS: Final = 0
"""Stiffness of the speed loop, N/m."""
DAMPING: Final = 1
"""Damping of the speed loop, N s/m."""
GRIP_GAIN: Final = 2
"""Factor of the applied force."""
MOST: Final = 3
"""Force limit of the motor, N."""
COMMANDED_WIDTH: Final = 4
"""Commanded opening, m; 0 closes."""
COMMANDED_SPEED: Final = 5
"""Commanded speed, m/s."""
COMMANDED_FORCE: Final = 6
"""Commanded force limit, N."""
REFERENCE: Final = 7
"""Reference of the speed loop: the opening that it tracks now, m."""
FORCE: Final = 8
"""Force by the drive's own model, without gain error, N; positive opens."""
DRIVE: Final = 9

WOUND_UP: Final = 1.2
"""Share of the commanded force up to which the speed loop winds up. Beyond 1, small motions of a
pressed finger do not change the force."""

SHUT: Final = -1.0
"""Target opening of a closing gripper, m: below 0, so that the fingers keep pressing."""
