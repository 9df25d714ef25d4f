"""Columns of what the kernels of sensors, drives and fingers read."""

from __future__ import annotations

from typing import Final

# Columns of what the kernels of sensors and drives read: a row a joint, of all arms.


# Of the encoders, of shape (n, ENCODERS).
RESOLUTION: Final = 0
"""Steps in which positions are read, rad; 0 for none."""
KEPT: Final = 1
"""Share of a velocity that stays from one reading to the next."""
TAKEN: Final = 2
"""Share of a difference that it takes up."""
ENCODERS: Final = 3

# Of their readings, whole numbers of shape (n, COUNTS).
WINDOW: Final = 0
"""Readings over which a velocity is differenced; 0 where it is read as it is."""
COUNT: Final = 1
"""Readings that there have been, as far as a window asks for them."""
COUNTS: Final = 2

# Of friction, of shape (n, FRICTION).
COULOMB: Final = 0
"""Dry friction, N m."""
DROP: Final = 1
"""How much more of it a joint has that stands, N m."""
NARROW: Final = 2
"""-1/v_s² of the speed at which that is left behind, s²/rad²."""
VISCOUS: Final = 3
"""Friction that grows with speed, N m s/rad."""
RISE: Final = 4
"""Speed over which dry friction builds up, rad/s; 0 where it is there at once."""
OFFSET: Final = 5
"""Offset of the speed at which it does, rad/s."""
FRICTION: Final = 6

# Of the drives, of shape (n, DRIVES).
PER_STEP: Final = 0
"""Steps of a torque of one, 1/(N m); 0 for none."""
GAIN: Final = 1
"""Torque of a step, or of one, N m."""
EFFORT: Final = 2
"""Effort limits, N m."""
WANTED: Final = 3
"""Torques that they are to give, N m."""
TORQUE: Final = 4
"""Torques that they give, N m."""
WHOLE: Final = 5
"""Whole steps of physics by which they are late."""
LATE: Final = 6
"""Part of a step by which they are late beyond that."""
SHARE: Final = 7
"""Share of the way to a torque that is gone in a step of physics."""
DRIVES: Final = 8

CREEP: Final = 1e-9
"""Speed in rad/s that is added before a secant is taken: that of a joint that stands is a slope."""


# Places of what the kernel of two fingers reads.


# Of the drive of two fingers, of shape (DRIVE,). Ways are of the opening, forces of each finger.
STIFFNESS: Final = 0
"""Of the speed loop, N/m."""
DAMPING: Final = 1
"""Of it, N s/m."""
GRIP_GAIN: Final = 2
"""Factor of its force."""
MOST: Final = 3
"""Force that no motor exceeds, N."""
ASKED_WIDTH: Final = 4
"""Opening that is asked for, m; 0 closes."""
ASKED_SPEED: Final = 5
"""Speed that is asked for, m/s."""
ASKED_FORCE: Final = 6
"""Most force that is asked for, N."""
REFERENCE: Final = 7
"""Opening that it is after now, m."""
FORCE: Final = 8
"""Force that it takes itself to give, N; positive where it opens."""
DRIVE: Final = 9

WOUND_UP: Final = 1.2
"""Share of the force that is asked for up to which the speed loop winds up: a finger that is
pressed on trembles within it, and the force stays what was asked for."""

SHUT: Final = -1.0
"""m; opening toward which fingers close that are to press: none of them gets there."""
