"""A record as a film: the scene from outside, beside it every arm's tree at that time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from bt_dualarm.replay.record import Record, ReplayError
from bt_dualarm.replay.timeline import Node, Timeline
from bt_dualarm.world.rendering.still import Still, best_viewpoint

FPS: Final = 25
"""Pictures of a film for each simulated second: every second state that is kept."""

_SCENE: Final = (640, 480)
_PANEL: Final = 320
_LINE: Final = 15
_LONGEST: Final = 44
_EVERY: Final = 2
_MOST_STILLS: Final = 5
_COLORS: Final = {
    "INVALID": (150, 150, 150),
    "RUNNING": (200, 130, 0),
    "SUCCESS": (20, 130, 20),
    "FAILURE": (200, 30, 30),
}

Picture = npt.NDArray[np.uint8]


def write_film(record: Record, path: Path) -> None:
    """Write a film in H.264, whole or not at all.

    Args:
        record: The record.
        path: File to write; its name ends with ``.mp4``.

    Raises:
        ReplayError: There is nothing to be seen in the record, or imageio-ffmpeg is not installed.
        OSError: The film cannot be written there.
    """
    try:
        import imageio_ffmpeg
    except ImportError as error:
        message = "--mp4 needs the package imageio-ffmpeg (the extra bt_dualarm[export])"
        raise ReplayError(message) from error
    beside = path.with_name(f".{path.stem}.half.mp4")
    size = (_SCENE[0] + _PANEL, _SCENE[1])
    film = imageio_ffmpeg.write_frames(str(beside), size, fps=FPS, codec="libx264")
    try:
        beside.touch()
        film.send(None)
        for picture in pictures(record):
            film.send(np.ascontiguousarray(picture).tobytes())
        film.close()
        beside.replace(path)
    finally:
        film.close()
        beside.unlink(missing_ok=True)


def pictures(record: Record) -> Iterator[Picture]:
    """Pictures of the film, of shape (480, 960, 3), red, green, blue.

    Raises:
        ReplayError: There is nothing to be seen in the record.
    """
    count = len(record.times)
    looks = np.linspace(0, count - 1, min(count, _MOST_STILLS)).round().astype(int)
    stills = [_still(record, int(index)) for index in looks]
    viewpoint = best_viewpoint(stills, _SCENE[0] / _SCENE[1])
    if viewpoint is None:
        raise ReplayError(f"{record.folder} holds nothing to be seen: no arm, no object")
    timeline = Timeline(record)
    for index in range(0, count, _EVERY):
        still = _still(record, index)
        scene = still.draw(viewpoint, *_SCENE)
        yield np.hstack((scene, _panel(record, timeline, still.time)))


def _still(record: Record, index: int) -> Still:
    moment = record.moment(index)
    return Still(record.model(moment.generation), moment.qpos, moment.time)


def _panel(record: Record, timeline: Timeline, time: float) -> Picture:
    """The trees at a time, of shape (480, 320, 3)."""
    image = Image.new("RGB", (_PANEL, _SCENE[1]), "white")
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(11)
    lines = [(f"{record.name}  {time:.2f} s", (0, 0, 0))]
    for arm, root in timeline.roots.items():
        lines += [("", (0, 0, 0)), (f"{arm} ({record.arms[arm]['robot']})", (0, 0, 0))]
        lines += _lines(root, 0, time)
    for row, (text, color) in enumerate(lines[: _SCENE[1] // _LINE - 1]):
        draw.text((8, 6 + row * _LINE), text[:_LONGEST], fill=color, font=font)
    return np.asarray(image, np.uint8)


def _lines(node: Node, depth: int, time: float) -> list[tuple[str, tuple[int, int, int]]]:
    status = node.status_at(time)
    name = node.path.rpartition("/")[2]
    lines = [(f"{'   ' * depth}{name}", _COLORS[status])]
    if status == "FAILURE" and not node.children:
        reasons = [change.reason for change in node.changes if change.time <= time + 1e-9]
        lines.append((f"{'   ' * (depth + 1)}{reasons[-1]}", _COLORS[status]))
    for child in node.children:
        lines += _lines(child, depth + 1, time)
    return lines
