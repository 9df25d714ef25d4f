"""How a film looks: colours, letters, marks of statuses."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Final, TypeAlias

from PIL import ImageFont

RGB: TypeAlias = tuple[int, int, int]

ARM_COLORS: Final[tuple[RGB, ...]] = (
    (255, 176, 0),
    (30, 136, 229),
    (67, 190, 90),
    (216, 27, 96),
    (142, 90, 220),
    (0, 172, 193),
)
"""Colours by which arms and their tools' ways are told apart, in the order of the file."""

BORDER: Final[RGB] = (24, 28, 36)
PAPER: Final[RGB] = (250, 250, 248)
INK: Final[RGB] = (28, 32, 40)
FAINT: Final[RGB] = (150, 155, 163)

STATUS: Final[dict[str, tuple[str, RGB]]] = {
    "INVALID": ("·", FAINT),
    "RUNNING": ("▶", (190, 110, 0)),
    "SUCCESS": ("✔", (24, 128, 56)),
    "FAILURE": ("✘", (200, 30, 40)),
}
"""Mark and colour of each status, as on the terminal."""


@cache
def font(size: int, *, bold: bool = False) -> ImageFont.FreeTypeFont:
    """Letters that have the marks of all statuses: DejaVu Sans, which matplotlib brings."""
    import matplotlib as mpl

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(mpl.get_data_path()) / "fonts" / "ttf" / name), size)
