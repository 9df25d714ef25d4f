"""The scene of a film: smooth and with shadows, the tools' ways of late, and wrist cameras."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

import mujoco
import numpy as np
from PIL import Image, ImageDraw

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.replay.film_style import ARM_COLORS, BORDER, RGB, font
from bt_dualarm.replay.record import Facts, Moment, Record
from bt_dualarm.world.rendering.painter import ScenePainter
from bt_dualarm.world.rendering.raycast import RayRenderer
from bt_dualarm.world.rendering.renderer import Exposure
from bt_dualarm.world.rendering.viewpoint import Viewpoint
from bt_dualarm.world.robots.mjspec import TOOL_SITE

FINER: Final = 2
"""Rays a pixel along each direction: edges are smooth by that."""

_TRAIL_S: Final = 3.0
_FADING: Final = 12
"""Pieces of a trail, each fainter than the one after it."""

INSET: Final = 0.27
"""Width of a wrist camera's picture as a share of the scene's."""

_FRESH_S: Final = 0.2


@dataclass(frozen=True, eq=False)
class _World:
    """One compiled model, ready to be drawn."""

    model: mujoco.MjModel
    data: mujoco.MjData
    painter: ScenePainter

    @classmethod
    def of(cls, model: mujoco.MjModel) -> _World:
        return cls(model, mujoco.MjData(model), ScenePainter(model))


@dataclass(eq=False)
class FilmScene:
    """Draws moments of a record, in their order.

    Attributes:
        record: The record.
        size: Width and height of the picture in pixels.
        at_left: Whether the cameras' pictures are at the left.
        at_top: Whether they are at the top.
    """

    record: Record
    size: tuple[int, int]
    at_left: bool = True
    at_top: bool = False
    _worlds: dict[int, _World] = field(default_factory=dict)
    _trails: dict[str, deque[tuple[float, Vector]]] = field(default_factory=dict)
    _looks: dict[str, list[Facts]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._eyes = RayRenderer()
        for arm in self.record.arms:
            own = (note for note in self.record.notes if note["arm"] == arm)
            self._looks[arm] = [note for note in own if note["kind"] == "look"]

    def draw(self, moment: Moment, viewpoint: Viewpoint) -> Image.Image:
        """The picture of a moment."""
        world = self._at(moment)
        width, height = (FINER * side for side in self.size)
        image = Image.fromarray(world.painter.draw(world.data, viewpoint, (width, height), FINER))
        self._draw_trails(image, moment, world, viewpoint)
        image = image.resize(self.size, Image.Resampling.BOX)
        self._draw_insets(image, moment, world)
        return image

    def _at(self, moment: Moment) -> _World:
        if moment.generation not in self._worlds:
            self._worlds = {moment.generation: _World.of(self.record.model(moment.generation))}
        world = self._worlds[moment.generation]
        world.data.qpos[:] = moment.qpos
        mujoco.mj_kinematics(world.model, world.data)
        mujoco.mj_camlight(world.model, world.data)
        return world

    def _draw_trails(
        self, image: Image.Image, moment: Moment, world: _World, viewpoint: Viewpoint
    ) -> None:
        draw = ImageDraw.Draw(image, "RGBA")
        for arm, color in zip(self.record.arms, ARM_COLORS * 9, strict=False):
            trail = self._trails.setdefault(arm, deque())
            site = mujoco.mj_name2id(world.model, mujoco.mjtObj.mjOBJ_SITE, f"{arm}/{TOOL_SITE}")
            if site >= 0:
                trail.append((moment.time, world.data.site_xpos[site].copy()))
            while trail and trail[0][0] < moment.time - _TRAIL_S:
                trail.popleft()
            if len(trail) > 1:
                points = np.array([point for _, point in trail])
                _faded(draw, viewpoint.pixels(points, *image.size), color)

    def _draw_insets(self, image: Image.Image, moment: Moment, world: _World) -> None:
        """What each arm's camera has before it, and a circle around what a tracker found there."""
        at = margin = round(0.02 * self.size[0])
        for arm, facts in self.record.arms.items():
            camera = mujoco.mj_name2id(world.model, mujoco.mjtObj.mjOBJ_CAMERA, f"{arm}/camera")
            if camera >= 0 and facts.get("camera"):
                columns, rows = facts["camera"]["resolution"]
                width = round(INSET * self.size[0])
                height = round(width * rows / columns)
                exposure = Exposure(camera, FINER * width, FINER * height)
                seen = Image.fromarray(self._eyes.render(world.model, world.data, exposure))
                self._mark(seen, arm, moment.time, seen.size[0] / columns)
                seen = seen.resize((width, height), Image.Resampling.BOX)
                x = at if self.at_left else self.size[0] - at - width
                y = margin if self.at_top else self.size[1] - height - margin
                _framed(image, seen, (x, y), f"{arm}  camera")
                at += width + margin

    def _mark(self, seen: Image.Image, arm: str, time: float, scale: float) -> None:
        looks = [n for n in self._looks[arm] if time - _FRESH_S < n["time_s"] <= time]
        if looks and looks[-1]["pixel"] is not None:
            x, y = (scale * each for each in looks[-1]["pixel"])
            radius = scale * (looks[-1]["area_px"] / np.pi) ** 0.5 * 1.5 + 4.0
            color = (60, 220, 90) if looks[-1]["locked"] else (255, 170, 0)
            box = (x - radius, y - radius, x + radius, y + radius)
            ImageDraw.Draw(seen).ellipse(box, outline=color, width=2 * FINER)


def _faded(draw: ImageDraw.ImageDraw, pixels: Matrix, color: RGB) -> None:
    """A line that begins faint and ends bright."""
    cuts = np.linspace(0, len(pixels) - 1, min(_FADING, len(pixels) - 1) + 1).astype(int)
    for number, (first, last) in enumerate(pairwise(cuts), 1):
        piece = [(float(x), float(y)) for x, y in pixels[first : last + 1]]
        alpha = round(230 * number / (len(cuts) - 1))
        draw.line(piece, fill=(*color, alpha), width=3 * FINER, joint="curve")


def _framed(image: Image.Image, seen: Image.Image, corner: tuple[int, int], text: str) -> None:
    """Paste a picture with a thin border and a caption in its corner."""
    x, y = corner
    draw = ImageDraw.Draw(image, "RGBA")
    draw.rectangle((x - 2, y - 2, x + seen.width + 1, y + seen.height + 1), fill=(*BORDER, 255))
    image.paste(seen, corner)
    letters = font(max(11, seen.width // 20))
    box = draw.textbbox((x + 7, y + 5), text, font=letters)
    draw.rectangle((x, y, box[2] + 7, box[3] + 5), fill=(*BORDER, 190))
    draw.text((x + 7, y + 5), text, fill=(255, 255, 255), font=letters)
