"""What stands beside the scene of a film: every arm's tree at that time, and the time itself."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

from PIL import Image, ImageDraw

from bt_dualarm.replay.film_style import ARM_COLORS, FAINT, INK, PAPER, RGB, STATUS, font
from bt_dualarm.replay.record import Record
from bt_dualarm.replay.timeline import Change, Node, Timeline

_SIZES: Final = (19, 18, 17, 16, 15, 14, 13, 12, 11, 10)
_INDENT: Final = 1.3
"""Indentation of a child, in heights of a letter."""


@dataclass(frozen=True)
class _Line:
    """One line: how far in, a mark, a text, and what stands at its end."""

    depth: int
    mark: str
    text: str
    color: RGB
    bold: bool = False
    end: str = ""
    lit: bool = False


@dataclass(eq=False)
class FilmPanel:
    """Draws the trees of a record.

    Attributes:
        record: The record.
        size: Width and height of the panel in pixels.
    """

    record: Record
    size: tuple[int, int]
    _letters: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self._timeline = Timeline(self.record)
        whole = len([*self._lines(self.record.until, folded=False)])
        room = self.size[1] - 110 / self._scale
        fitting = [size for size in _SIZES if whole * size * 1.6 < room * self._scale]
        self._folded = not fitting
        self._letters = round((fitting or _SIZES[-1:])[0] / self._scale)

    @property
    def _scale(self) -> float:
        """Panels are laid out for 400 pixels across."""
        return 400.0 / self.size[0]

    def draw(self, time: float) -> Image.Image:
        """The panel at a time in s."""
        image = Image.new("RGB", self.size, PAPER)
        draw = ImageDraw.Draw(image)
        margin = round(20 / self._scale)
        title, small = font(round(22 / self._scale), bold=True), font(round(18 / self._scale))
        draw.text((margin, margin), self.record.name, fill=INK, font=title)
        told = f"{time:.1f} s"
        right = self.size[0] - margin
        draw.text((right, margin + title.size // 6), told, fill=FAINT, font=small, anchor="ra")
        self._draw_bar(draw, time, margin + round(34 / self._scale), margin, right)
        y = margin + round(52 / self._scale)
        for line in self._lines(time, folded=self._folded):
            y = self._write(draw, line, y, margin, right)
            if y > self.size[1] - margin:
                break
        return image

    def _draw_bar(
        self, draw: ImageDraw.ImageDraw, time: float, y: int, left: int, right: int
    ) -> None:
        share = min(1.0, time / max(self.record.until, 1e-9))
        draw.rectangle((left, y, right, y + 3), fill=(222, 224, 226))
        draw.rectangle((left, y, left + share * (right - left), y + 3), fill=INK)
        for event in self.record.events:
            if event["new"] == "FAILURE":
                x = left + event["time_s"] / max(self.record.until, 1e-9) * (right - left)
                draw.rectangle((x - 1, y - 3, x + 1, y + 6), fill=STATUS["FAILURE"][1])

    def _write(self, draw: ImageDraw.ImageDraw, line: _Line, y: int, left: int, right: int) -> int:
        """Write a line; returns where the next one begins."""
        letters = font(self._letters, bold=line.bold)
        step = round(1.6 * self._letters)
        x = left + round(line.depth * _INDENT * self._letters)
        if line.lit:
            box = (x - 4, y - 1, right + 4, y + step - 3)
            draw.rounded_rectangle(box, radius=4, fill=(255, 240, 214))
        if line.mark:
            draw.text((x, y), line.mark, fill=line.color, font=letters)
            x += round(1.4 * self._letters)
        room = right - x - (draw.textlength(line.end, font=letters) + 8 if line.end else 0)
        text = line.text
        while len(text) > 1 and draw.textlength(text, font=letters) > room:
            text = f"{text[:-2]}…"
        draw.text((x, y), text, fill=line.color, font=letters)
        if line.end:
            draw.text((right, y), line.end, fill=line.color, font=letters, anchor="ra")
        return y + step

    def _lines(self, time: float, *, folded: bool) -> Iterator[_Line]:
        for color, (arm, root) in zip(ARM_COLORS * 9, self._timeline.roots.items(), strict=False):
            yield _Line(0, "", "", INK)
            robot = self.record.arms[arm]["robot"]
            yield _Line(0, "●", f"{arm}   {robot}", color, bold=True)
            yield from _of_node(root, root.standing_at(time), 0, time, folded=folded)


def _of_node(
    node: Node, standing: Mapping[str, Change], depth: int, time: float, *, folded: bool
) -> Iterator[_Line]:
    change = standing.get(node.path)
    status = "INVALID" if change is None else change.new
    mark, color = STATUS[status]
    runs = change is not None and status == "RUNNING" and not node.children
    end = f"{time - change.time:.1f} s" if change is not None and runs else ""
    ink = INK if status == "SUCCESS" and node.children else color
    yield _Line(depth, mark, node.path.rpartition("/")[2], ink, bold=runs, end=end, lit=runs)
    if change is not None and status == "FAILURE" and not node.children and change.reason:
        yield from (_Line(depth + 1, "", text, color) for text in _wrapped(change.reason))
    if not folded or status == "RUNNING":
        for child in node.children:
            yield from _of_node(child, standing, depth + 1, time, folded=folded)


def _wrapped(reason: str, width: int = 40) -> list[str]:
    lines = [""]
    for word in reason.split():
        if len(lines[-1]) + len(word) > width:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return lines[:3]
