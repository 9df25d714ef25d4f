"""What the cameras of a record saw, as messages: pictures, intrinsics, what was found in them."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterator

from bt_dualarm.replay.kept_pictures import kept_pictures
from bt_dualarm.replay.message import Message, timestamp
from bt_dualarm.replay.record import Facts, Record
from bt_dualarm.world.cameras.frame import focal_length_px

_LOCKED, _SEEN = (0.1, 0.9, 0.2, 1.0), (1.0, 0.7, 0.0, 1.0)
_CLEAR = (0.0, 0.0, 0.0, 0.0)


def camera_frame(arm: str) -> str:
    """Name of the frame of an arm's camera: x right, y down, z forward."""
    return f"{arm}/camera"


def camera_messages(record: Record) -> Iterator[Message]:
    """``/ARM/camera/image`` where pictures were kept, ``…/calibration`` and ``…/found``."""
    for picture in kept_pictures(record):
        content = {
            "timestamp": timestamp(picture.time),
            "frame_id": camera_frame(picture.arm),
            "data": base64.b64encode(picture.whole).decode(),
            "format": "jpeg",
        }
        topic = f"/{picture.arm}/camera/image"
        yield Message(topic, "foxglove.CompressedImage", picture.time, content)
    for arm, facts in record.arms.items():
        if facts.get("camera"):
            yield from _calibrations(record, arm, facts["camera"])
    for note in record.notes:
        if note["kind"] == "look":
            topic = f"/{note['arm']}/camera/found"
            yield Message(topic, "foxglove.ImageAnnotations", note["time_s"], _found(note))


def _calibrations(record: Record, arm: str, camera: Facts) -> Iterator[Message]:
    """Intrinsics as they are believed, once a second, so that a viewer has them wherever it is."""
    width, height = camera["resolution"]
    focal = focal_length_px(height, math.radians(camera["fov"]))
    matrix = [focal, 0.0, width / 2.0, 0.0, focal, height / 2.0, 0.0, 0.0, 1.0]
    for second in range(math.ceil(record.until)):
        content = {
            "timestamp": timestamp(second),
            "frame_id": camera_frame(arm),
            "width": width,
            "height": height,
            "distortion_model": "",
            "D": [],
            "K": matrix,
            "R": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            "P": [*matrix[:3], 0.0, *matrix[3:6], 0.0, *matrix[6:], 0.0],
        }
        topic = f"/{arm}/camera/calibration"
        yield Message(topic, "foxglove.CameraCalibration", float(second), content)


def _found(note: Facts) -> Facts:
    """A circle of the area of what was found; none where nothing was."""
    if note["pixel"] is None:
        return {"circles": [], "points": [], "texts": []}
    x, y = note["pixel"]
    circle = {
        "timestamp": timestamp(note["time_s"]),
        "position": {"x": x, "y": y},
        "diameter": 2.0 * math.sqrt(note["area_px"] / math.pi),
        "thickness": 1.0,
        "fill_color": _color(_CLEAR),
        "outline_color": _color(_LOCKED if note["locked"] else _SEEN),
        "metadata": [{"key": "locked", "value": str(note["locked"]).lower()}],
    }
    return {"circles": [circle], "points": [], "texts": []}


def _color(rgba: tuple[float, float, float, float]) -> Facts:
    return dict(zip("rgba", rgba, strict=True))
