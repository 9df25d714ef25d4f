"""Places of what the kernel of two fingers reads."""

from __future__ import annotations

from typing import Final

# Of the drive of two fingers, of shape (DRIVE,). Ways are of the opening, forces of each finger.
STIFFNESS: Final = 0
"""Of the speed loop, N/m."""
DAMPING: Final = 1
"""Of it, N s/m."""
GAIN: Final = 2
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
"""m; opening towards which fingers close that are to press: none of them gets there."""
