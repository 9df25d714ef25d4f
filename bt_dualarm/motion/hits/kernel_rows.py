"""What the kernel that tells hits reads and writes: rows of what joints have, and what counts."""

from __future__ import annotations

from typing import Final

SPAN: Final = 8
"""Periods over which a torque is compared with itself: a hit is there within them, and what masses
and friction are off changes little."""

LATE: Final = 16
"""Periods by which what a change of acceleration does may come later: drives and observer lag."""

DEVIATIONS: Final = 8.0
"""Standard deviations of what was measured without a hit that count as one."""

MODEL_SHARE: Final = 0.25
"""Share of the torques of a change of acceleration by which inertia and delays may be off."""

TURN_SPEED: Final = 0.04
"""Speed in rad/s below which a joint's dry friction may change sides."""

TURN_PERIODS: Final = SPAN + 17
"""Periods that this is remembered for."""

MOST_MEASURED: Final = 100.0
"""Numbers that deviations are measured over."""

LEAST_DEVIATION: Final = 0.1
"""Standard deviation that is believed at least, rad/s²."""

# Rows of what is known of the joints, of shape (HIT_ROWS, dof).
TURNING: Final = 0
"""Torque by which dry friction changes where a joint turns back, N m."""
ASKED: Final = 1
"""Torques of the accelerations that were meant last, N m."""
SINCE_TURN: Final = 2
"""Periods since the joint was slower than `TURN_SPEED`."""
VARIANCE: Final = 3
"""Of what was measured without a hit, rad²/s⁴."""
MEASURED: Final = 4
"""How many numbers that is of."""
CHANGE: Final = 5
"""Change of the torque from outside, N m."""
THRESHOLD: Final = 6
"""What of it counts as a hit, N m."""
HIT_ROWS: Final = 7

# What is to be done with a period; bits.
FIRST: Final = 1
"""Nothing was known before."""
COMPARES: Final = 2
"""Torques are known for long enough to be compared."""
JUDGES: Final = 4
"""They are held against thresholds."""
LEARNS: Final = 8
"""Deviations are measured."""

# What came of it; bits.
MOVES: Final = 1
"""The arm is meant to move."""
WAS_HIT: Final = 2
