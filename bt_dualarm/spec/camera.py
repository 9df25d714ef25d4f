"""An arm's camera as a tree file describes it."""

from __future__ import annotations

import math
from typing import Annotated, Final, TypeAlias

from pydantic import Discriminator, Field, Tag, ValidationInfo, field_validator

from bt_dualarm.spec.name import Name, written_as
from bt_dualarm.spec.ports import port
from bt_dualarm.spec.values import Duration, PoseSpec, Value

MOST_UNDER_WAY_MB: Final = 100.0
"""Megabytes of pictures that one camera may have taken and not delivered yet."""

_MB_A_PIXEL: Final = 3e-6
_Pixels: TypeAlias = Annotated[int, Field(ge=16, le=1920)]


class CameraSpec(Value):
    """An arm's camera."""

    mount: Annotated[
        Annotated[Name, Tag("name")] | Annotated[PoseSpec, Tag("value")],
        Discriminator(written_as),
    ] = port(
        "wrist",
        "A mount of the robot's catalogue page, or a pose fixed in the world (OpenCV's frame: "
        "x right, y down, z forward)",
    )
    resolution: tuple[_Pixels, _Pixels] = port((320, 240), "Width and height", unit="px")
    fov: float = port(50.0, "Vertical field of view", unit="deg", ge=5.0, le=150.0)
    fps: float = port(30.0, "Frames per simulated second", unit="Hz", ge=0.1, le=1000.0)
    latency: Duration = port(0.0, "Time from a frame's capture to its delivery", le=10.0)
    drop: float = port(0.0, "Share of the frames that get lost on their way", ge=0.0, le=0.9)
    noise: float = port(
        0.0,
        "Standard deviation along x and y of a shake that nobody measures: each exposure looks "
        "past where it believes to look, so all that it sees is shifted",
        unit="px",
        ge=0.0,
        le=20.0,
    )

    @field_validator("latency")
    @classmethod
    def _pictures_under_way_are_bounded(cls, latency: float, info: ValidationInfo) -> float:
        """Keep what waits for its delivery below `MOST_UNDER_WAY_MB`; fields above are known."""
        if "resolution" in info.data and "fps" in info.data:
            (width, height), fps = info.data["resolution"], info.data["fps"]
            picture_mb = _MB_A_PIXEL * width * height
            if latency * fps * picture_mb > MOST_UNDER_WAY_MB:
                allowed = math.floor(1e3 * MOST_UNDER_WAY_MB / picture_mb / fps)
                raise ValueError(
                    f"{latency:g} s at {fps:g} Hz keep {latency * fps:.0f} pictures of "
                    f"{width} x {height} px under way, {latency * fps * picture_mb:.0f} MB; at "
                    f"most {MOST_UNDER_WAY_MB:g} MB: here {allowed} ms"
                )
        return latency

    @property
    def fov_rad(self) -> float:
        """Vertical field of view in radians."""
        return math.radians(self.fov)
