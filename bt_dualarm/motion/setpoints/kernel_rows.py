"""What the kernels of set-points read and write: rows of what joints have, places in vectors."""

from __future__ import annotations

from typing import Final, NamedTuple

HOLD_BANDWIDTH: Final = 40.0
"""With which the held directions return, rad/s."""

POSTURE_BANDWIDTH: Final = 4.0
"""With which a redundant arm returns to its posture at the start, rad/s."""

BRAKING_BANDWIDTH: Final = 8.0
"""With which the tool comes to rest when there is no target, rad/s."""

LOST_M: Final = 0.02
"""How far the tool may leave its plane in m before it gives up."""

LOST_RAD: Final = 0.1
"""How far the tool may turn from its orientation in rad before it gives up."""

DAMPING: Final = 1e-6
"""Of the Jacobian's inverse: keeps it finite at a singularity."""

# Rows of what a servo works with, of shape (WORK, dof); its first rows are the joints' limits.
NOW_Q: Final = 5
NOW_V: Final = 6
NOW_A: Final = 7
"""Set-point that is asked for; its acceleration is that of the one before."""
POSTURE: Final = 8
"""Configuration to which a redundant arm returns, rad."""
HOLD: Final = 9
"""Accelerations that keep what is held, rad/s²."""
RATES: Final = 10
"""Joint rates that move the tool by one along each axis of the plane, 2 rows."""
JACOBIAN: Final = 12
"""Jacobian of the tool in the world, linear first, 6 rows."""
JACOBIAN_BEFORE: Final = 18
"""That of the set-point before, 6 rows."""
INVERSE: Final = 24
"""Its damped right inverse, transposed, 6 rows."""
WORK: Final = 30

# Places in what a servo sees, of shape (SEEN,).
DISPLACEMENT: Final = 0
"""Of the tool in the plane, from its start, 2 numbers, m."""
VELOCITY: Final = 2
"""Of the tool in the plane, 2 numbers, m/s."""
ACCELERATION: Final = 4
"""Of the tool in the plane by the set-point before, 2 numbers, m/s²."""
OFF: Final = 6
"""How far the tool is out of its plane, m."""
TURN: Final = 7
"""How far it is turned from its orientation, 3 numbers, rad."""
REACH: Final = 10
"""Acceleration and jerk that the joints allow in the plane, 2 numbers, m/s² and m/s³."""
SEEN: Final = 12

# What came of a set-point.
HELD: Final = 0
"""The tool will be in its plane, and oriented as it was."""
LOST: Final = 1
"""It will not."""
TOO_LATE: Final = 2
"""There is none from which all joints could stop within their limits."""


class Reach(NamedTuple):
    """What a point may do in every direction: m/s² and m/s³."""

    acceleration: float
    jerk: float


class Gains(NamedTuple):
    """Of the three loops: ``c`` and ``b`` in 1/s, ``f`` a share a period."""

    c: float
    b: float
    f: float
