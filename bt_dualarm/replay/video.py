"""A record as a film: the scene by a camera that follows, wrist cameras, the trees beside."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from bt_dualarm.replay.film_camera import clear_corner, followed
from bt_dualarm.replay.film_panel import FilmPanel
from bt_dualarm.replay.film_scene import FilmScene
from bt_dualarm.replay.record import Record, ReplayError

Picture = npt.NDArray[np.uint8]

_PANEL: Final = 0.3125
"""Width of the trees as a share of the picture's."""

_MOST_BYTES: Final = 3 * 2**20
"""Bytes of an animation: what pages on the web show without much ado."""


@dataclass(frozen=True)
class Format:
    """How large a film is, and how many pictures it has.

    Attributes:
        width: Width of its pictures in pixels, even.
        height: Height in pixels, even.
        fps: Pictures for each simulated second.
    """

    width: int
    height: int
    fps: float


FILM: Final = Format(1280, 720, 25.0)
ANIMATION: Final = Format(800, 450, 10.0)


def write_film(record: Record, path: Path) -> None:
    """Write a film in H.264, whole or not at all.

    Args:
        record: The record.
        path: File to write; its name ends with ``.mp4``.

    Raises:
        ReplayError: There is nothing to be seen in the record, or imageio-ffmpeg is not installed.
        OSError: The film cannot be written there.
    """
    beside = path.with_name(f".{path.stem}.half.mp4")
    try:
        beside.touch()
        with closing(Encoder(beside, (FILM.width, FILM.height), FILM.fps)) as film:
            for picture in pictures(record, FILM):
                film.add(picture)
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


class Encoder:
    """Writes pictures as H.264 (yuv420p), one by one.

    Args:
        path: File to write, which ends with ``.mp4``.
        size: Width and height in pixels, even.
        fps: Pictures a second.
        key_every: Pictures from one that stands for itself to the next.

    Raises:
        ReplayError: The package imageio-ffmpeg is not installed.
        OSError: The file cannot be written.
    """

    def __init__(self, path: Path, size: tuple[int, int], fps: float, key_every: int = 50) -> None:
        try:
            import imageio_ffmpeg
        except ImportError as error:
            message = "a film needs the package imageio-ffmpeg (the extra bt_dualarm[export])"
            raise ReplayError(message) from error
        keys = ["-g", str(key_every)]
        self._film = imageio_ffmpeg.write_frames(
            str(path), size, fps=fps, codec="libx264", macro_block_size=2, output_params=keys
        )
        self._film.send(None)

    def add(self, picture: Picture) -> None:
        """Add a picture of shape (height, width, 3), red, green, blue."""
        self._film.send(np.ascontiguousarray(picture).tobytes())

    def close(self) -> None:
        """Finish the file; again changes nothing."""
        self._film.close()


def write_animation(record: Record, path: Path) -> None:
    """Write a film without sound or player, as an animated WebP of 3 MB at most.

    Args:
        record: The record.
        path: File to write; its name ends with ``.webp``.

    Raises:
        ReplayError: There is nothing to be seen in the record.
        OSError: The file cannot be written there.
    """
    images = [Image.fromarray(picture) for picture in pictures(record, ANIMATION)]
    beside = path.with_name(f".{path.stem}.half.webp")
    try:
        for quality in (70, 55, 40, 25, 10):
            images[0].save(
                beside,
                save_all=True,
                append_images=images[1:],
                duration=round(1000 / ANIMATION.fps),
                loop=0,
                quality=quality,
                method=4,
            )
            if beside.stat().st_size <= _MOST_BYTES:
                break
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def pictures(record: Record, form: Format) -> Iterator[Picture]:
    """Pictures of the film, of shape (height, width, 3), red, green, blue.

    Raises:
        ReplayError: There is nothing to be seen in the record.
    """
    if not len(record.times):
        raise ReplayError(f"{record.folder} holds nothing to be seen: no state was kept")
    times = np.arange(float(record.times[0]), record.until, 1.0 / form.fps)
    panel = round(_PANEL * form.width / 2) * 2
    size = form.width - panel, form.height
    aspect = size[0] / size[1]
    viewpoints = followed(record, times.tolist(), aspect)
    scene = FilmScene(record, size, *clear_corner(record, times.tolist(), viewpoints, aspect))
    trees = FilmPanel(record, (panel, form.height))
    for time, viewpoint in zip(times.tolist(), viewpoints, strict=True):
        drawn = scene.draw(record.moment(record.index_at(time)), viewpoint)
        yield np.hstack((np.asarray(drawn, np.uint8), np.asarray(trees.draw(time), np.uint8)))
