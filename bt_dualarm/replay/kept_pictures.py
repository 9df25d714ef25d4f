"""Pictures that a record kept, as its cameras exposed them."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import PIL.Image

from bt_dualarm.recording.block import Block
from bt_dualarm.recording.history_file import HistoryError, blocks_of
from bt_dualarm.replay.record import Record
from bt_dualarm.replay.record_facts import check_picture
from bt_dualarm.runtime.record_folder import FRAMES
from bt_dualarm.world.rendering.renderer import Image, Region, enter_blocks


@dataclass(frozen=True, eq=False)
class KeptPicture:
    """One picture.

    Attributes:
        arm: Name of the camera's arm.
        time: Simulated time of the exposure in s.
        stamp: Time in s by the camera's clock.
        region: Part of the image that was exposed.
        stride: Edge in pixels of the blocks that share a sample.
        size: Width and height of the whole image in pixels.
        jpeg: The part, a pixel for each block, as JPEG.
    """

    arm: str
    time: float
    stamp: float
    region: Region
    stride: int
    size: tuple[int, int]
    jpeg: bytes

    @property
    def image(self) -> Image:
        """Red, green, blue, of shape (height, width, 3), black outside the region."""
        width, height = self.size
        image = np.zeros((height, width, 3), np.uint8)
        part = cv2.imdecode(np.frombuffer(self.jpeg, np.uint8), cv2.IMREAD_COLOR_RGB)
        if part is not None:
            enter_blocks(image, self.region, self.stride, np.asarray(part, np.uint8))
        return image

    @property
    def whole(self) -> bytes:
        """The whole image as JPEG."""
        if self.stride == 1 and self.region == (0, 0, *self.size):
            return self.jpeg
        bgr = np.ascontiguousarray(self.image[:, :, ::-1])
        return bytes(cv2.imencode(".jpg", bgr, (cv2.IMWRITE_JPEG_QUALITY, 92))[1].tobytes())


def kept_pictures(record: Record) -> Iterator[KeptPicture]:
    """All pictures that were kept, in their order, up to where the file is whole.

    There are none of a run that kept none.

    Raises:
        HistoryError: The file is there, and of another kind, or a picture is not what is said of
            it.
    """
    path = record.folder / FRAMES
    if os.path.lexists(path):
        for number, block in enumerate(blocks_of(path)):
            if block.kind == "picture":
                try:
                    yield _picture(block, record)
                except ValueError as error:
                    raise HistoryError(f"{path}: picture {number}: {error}") from error


def _picture(block: Block, record: Record) -> KeptPicture:
    """A picture, whose JPEG has the size that is said: another could take any memory.

    Raises:
        ValueError: It has not, or something is missing, or of another type.
    """
    said: Any = block.data
    check_picture(said)
    if said["arm"] not in record.arms:
        raise ValueError(f"there is no arm {said['arm']!r}")
    jpeg = block.arrays.get("jpeg")
    if jpeg is None or jpeg.dtype != np.uint8 or jpeg.ndim != 1:
        raise ValueError("expected an array of bytes `jpeg`")
    left, top, right, bottom = said["region"]
    stride = said["stride"]
    expected = -(-(right - left) // stride), -(-(bottom - top) // stride)
    try:
        with PIL.Image.open(io.BytesIO(jpeg.tobytes()), formats=("JPEG",)) as image:
            size = image.size
    except (OSError, SyntaxError, ValueError, PIL.Image.DecompressionBombError) as error:
        raise ValueError(f"its bytes are no JPEG: {error}") from error
    if size != expected:
        raise ValueError(f"is of {size[0]} by {size[1]} pixels; expected {expected}")
    width, height = said["size"]
    return KeptPicture(
        said["arm"],
        float(said["time_s"]),
        float(said["stamp"]),
        (left, top, right, bottom),
        int(said["stride"]),
        (width, height),
        jpeg.tobytes(),
    )
