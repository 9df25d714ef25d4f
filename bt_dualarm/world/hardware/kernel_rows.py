"""Rows of what the kernels of sensors and drives read: a column a joint."""

from __future__ import annotations

from typing import Final

# Of friction, of shape (FRICTION, dof).
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

# Of the drives, of shape (DRIVES, dof).
PER_STEP: Final = 0
"""Steps of a torque of one, 1/(N m); 0 for none."""
GAIN: Final = 1
"""Torque of a step, or of one, N m."""
EFFORT: Final = 2
"""Effort limits, N m."""
WANTED: Final = 3
"""Torques that they are to give, N m."""
DRIVES: Final = 4

CREEP: Final = 1e-9
"""Speed in rad/s that is added before a secant is taken: that of a joint that stands is a slope."""
