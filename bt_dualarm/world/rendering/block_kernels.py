"""Blocks of pixels that share a colour, in an image."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from bt_dualarm.kernels.kernel import kernel


@kernel
def enter(
    image: npt.NDArray[np.uint8],
    region: tuple[int, int, int, int],
    corner: tuple[int, int],
    step: int,
    blocks: npt.NDArray[np.uint8],
) -> None:
    """Enter blocks into a region of an image, of shape (height, width, 3).

    Args:
        image: Image that takes them.
        region: Part that they cover: left, top, right, bottom.
        corner: Column and row of the first pixel of the first block, at most those of the region.
        step: Edge of a block in pixels.
        blocks: Their colours, of shape (rows, columns, 3).
    """
    left, top, right, bottom = region
    flat = image.reshape(image.shape[0], 3 * image.shape[1])
    line = np.empty(3 * step * blocks.shape[1], np.uint8)
    inside = line[3 * (left - corner[0]) : 3 * (right - corner[0])]
    for row in range(blocks.shape[0]):
        filled = 0
        for column in range(blocks.shape[1]):
            for _ in range(step):
                for channel in range(3):
                    line[filled] = blocks[row, column, channel]
                    filled += 1
        first = corner[1] + row * step
        for y in range(max(first, top), min(first + step, bottom)):
            part = flat[y, 3 * left : 3 * right]
            for place in range(len(part)):
                part[place] = inside[place]
