"""Rows of a joint's friction as its kernel reads them, of an array of shape (FRICTION, dof)."""

from __future__ import annotations

from typing import Final

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

CREEP: Final = 1e-9
"""Speed in rad/s that is added before a secant is taken: that of a joint that stands is a slope."""
