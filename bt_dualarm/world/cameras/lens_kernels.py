"""Which part of a picture before a lens a part of the picture behind it comes from."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.kernels.kernel import kernel

Places: TypeAlias = npt.NDArray[np.float32]
"""Where the rays of all pixels come from, along one axis, in pixels, of shape (height, width)."""


@kernel
def needed(
    columns: Places, rows: Places, region: tuple[int, int, int, int], stride: int
) -> tuple[int, int, int, int]:
    """The pixels before the lens that a part of the picture behind it is made of.

    Args:
        columns: Places along x; not a number where nothing is seen.
        rows: Places along y.
        region: Part of the picture: left, top, right, bottom.
        stride: Edge in pixels of the blocks of which the corner alone is looked at.

    Returns:
        Left, top, right, bottom, inside the image: four pixels about each place; the first pixel
        where nothing is seen.
    """
    height, width = columns.shape
    left, right, top, bottom = np.inf, -np.inf, np.inf, -np.inf
    for row in range(region[1], region[3], stride):
        for column in range(region[0], region[2], stride):
            x, y = columns[row, column], rows[row, column]
            if not np.isnan(x):
                left, right = min(left, x), max(right, x)
                top, bottom = min(top, y), max(bottom, y)
    if right < left:
        return 0, 0, 1, 1
    # What lies beyond the border has its colour.
    return (
        min(max(int(left), 0), width - 1), min(max(int(top), 0), height - 1),
        min(int(right) + 2, width), min(int(bottom) + 2, height),
    )  # fmt: skip
