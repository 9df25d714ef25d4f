"""Columns of what the kernels of grippers read."""

from __future__ import annotations

from typing import Final

# Of the grippers that can hold something, whole numbers of shape (n, HOLDERS).
FIRST: Final = 0
"""Shape of one pad."""
SECOND: Final = 1
"""Shape of the other pad; of a cup again the same."""
PALM: Final = 2
"""Body of the palm."""
ROOT: Final = 3
"""Body on which the whole arm stands."""
BEGIN: Final = 4
"""First row of the arm's links, from there to the palm."""
END: Final = 5
"""Row after the last of them."""
HOLDERS: Final = 6

# Of the links from there to the palms, of shape (k, LINK).
PLACE: Final = 0
"""Place in the link before it, three columns, m."""
TURN: Final = 3
"""Quaternion in it, four columns."""
AXIS: Final = 7
"""Axis of its joint, three columns; zeros where there is none."""
ZERO: Final = 10
"""Position of the joint in which it is not turned, rad."""
LINK: Final = 11
