"""Which experiments there are, and the settings that make one of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal, TypeAlias

CurveName: TypeAlias = Literal["circle", "lissajous"]
ControllerName: TypeAlias = Literal["proportional", "predictive"]
RendererName: TypeAlias = Literal["gl", "ray"]

TREE: Final = "experiments/tracking"
"""Name of the tree file that all experiments share."""

CASES: Final[tuple[tuple[CurveName, float], ...]] = (
    ("circle", 0.5),
    ("circle", 1.0),
    ("lissajous", 0.2),
    ("lissajous", 0.5),
    ("lissajous", 1.0),
)
"""Curve and speed of the five experiments."""

HARDEST: Final = ("lissajous", 1.0)

GAIN: Final = 3.0
"""Of proportional control: a step is so many times the error that the image shows.

Near the best of a sweep from 0.35 to 3.5 on the circle at speed 1.0 and 60 Hz; docs/tracking.md.
Above one, because the arm comes only a part of the way until the next image.
"""

_HALF_IMAGE: Final = (0.2176, 0.1632)
"""Metres in half the image's width and height, 0.35 m before a camera of 50° and 4:3."""


@dataclass(frozen=True)
class Cell:
    """One experiment with all its settings; seeds make its repetitions.

    Attributes:
        case: The curve.
        speed: Share of the leading arm's limits.
        controller: Of the following arm.
        renderer: Of its camera.
        fps: Frames a second.
        latency: Of a frame in s; None for the time of one frame.
        drop: Share of the frames that get lost.
        noise: Shake of the camera in px.
        more: Further parameters of the tree file.
    """

    case: CurveName
    speed: float
    controller: ControllerName = "predictive"
    renderer: RendererName = "ray"
    fps: float = 60.0
    latency: float | None = None
    drop: float = 0.0
    noise: float = 0.0
    more: Mapping[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """As it is called in tables."""
        return f"{self.case} {self.speed:g}"

    @property
    def latency_s(self) -> float:
        """Seconds from a frame's exposure to its delivery."""
        return 1.0 / self.fps if self.latency is None else self.latency

    @property
    def params(self) -> dict[str, str]:
        """For the tree file, as one would write them on a command line."""
        settings: dict[str, object] = {
            "case": self.case,
            "speed": self.speed,
            "controller": self.controller,
            "fps": self.fps,
            "latency": round(self.latency_s, 6),
            "drop": self.drop,
            "noise": self.noise,
        }
        if self.controller == "proportional":
            settings |= {"gain_u": GAIN * _HALF_IMAGE[0], "gain_v": GAIN * _HALF_IMAGE[1]}
        return {name: f"{value}" for name, value in settings.items()} | dict(self.more)

    def command(self, seed: int) -> str:
        """What to type to see this run again."""
        params = " ".join(f"--param {name}={value}" for name, value in self.params.items())
        return f"bt-run {TREE} --renderer {self.renderer} --seed {seed} {params}"
