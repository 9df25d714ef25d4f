"""The experiments and their settings."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal, TypeAlias

import numpy as np

from bt_dualarm.core.pose import Matrix
from bt_dualarm.spec.reality import RealityName
from bt_dualarm.spec.values import Plane
from bt_dualarm.spec.yaml_reader import read_text, with_tuples

CurveName: TypeAlias = Literal["circle", "lissajous", "drawn"]
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

_TUNED_AT_HZ: Final = (30.0, 60.0)
"""Frame rates at which gains were swept."""

GAINS: Final[Mapping[CurveName, Mapping[float, tuple[float, float]]]] = {
    "circle": {0.5: (2.25, 3.0), 1.0: (2.25, 3.25)},
    "lissajous": {0.2: (1.5, 2.0), 0.5: (1.75, 2.5), 1.0: (2.25, 3.25)},
    "drawn": {1.0: (2.25, 3.25)},
}
"""The best constant gain of proportional control, by curve and speed, at 30 and at 60 Hz.

A gain is the ratio of the commanded step to the error in the image; it exceeds one, because the arm
completes only a part of a step before the next image. Values are from
``benchmarks/proportional_gain.py``; a change of 25 % costs a few percent. The
curve drawn by hand has the others' gain at full speed.
"""

JERK: Final = 0.4
"""Fraction of its jerk limit that the leading arm uses; see docs/tracking.md for the reason.

Relative to the catalog's 100 rad/s³; Universal Robots publishes no jerk limit.
"""

_HALF_IMAGE: Final = (0.2176, 0.1632)
"""Half width and height in m of the image plane at 0.35 m, for a field of view of 50° and 4:3."""

_AXES: Final = {(1.0, 0.0, 0.0): "x", (0.0, 1.0, 0.0): "y", (0.0, 0.0, 1.0): "z"}


@dataclass(frozen=True)
class Cell:
    """One experiment with all its settings; repetitions differ in their seed.

    Attributes:
        case: Name of the curve.
        speed: Fraction of its limits that the leading arm uses.
        controller: Controller of the following arm.
        renderer: Renderer of its camera.
        fps: Frames a second.
        latency: Time from exposure to delivery of a frame in s; None for one frame period.
        drop: Fraction of lost frames.
        noise: Camera shake, standard deviation in px.
        jerk: Fraction of its jerk limit that the leading arm uses.
        reality: Model mismatch of both arms.
        more: Further parameters of the tree file.
        label: Name in tables; by default curve and speed.
    """

    case: CurveName
    speed: float
    controller: ControllerName = "predictive"
    renderer: RendererName = "ray"
    fps: float = 60.0
    latency: float | None = None
    drop: float = 0.0
    noise: float = 0.0
    jerk: float = JERK
    reality: RealityName = "lab"
    more: Mapping[str, str] = field(default_factory=dict)
    label: str = ""

    @property
    def name(self) -> str:
        """The cell's name in tables."""
        return self.label or f"{self.case} {self.speed:g}"

    @property
    def axes(self) -> Matrix:
        """Axes of the plane as rows, of shape (2, 3), in the world."""
        notation = read_text(self.more.get("plane", "yz")).data
        return np.array(Plane.model_validate(with_tuples(notation)).axes)

    @property
    def axis_names(self) -> tuple[str, str]:
        """Names of `axes`: those of world axes, otherwise u and v."""
        names = [_AXES.get(tuple(np.round(axis, 9))) for axis in self.axes.tolist()]
        return names[0] or "u", names[1] or "v"

    @property
    def latency_s(self) -> float:
        """Seconds from a frame's exposure to its delivery."""
        return 1.0 / self.fps if self.latency is None else self.latency

    @property
    def params(self) -> dict[str, str]:
        """Parameters of the tree file, as on a command line."""
        settings: dict[str, object] = {
            "case": self.case,
            "speed": self.speed,
            "jerk": self.jerk,
            "controller": self.controller,
            "fps": self.fps,
            "latency": round(self.latency_s, 6),
            "drop": self.drop,
            "noise": self.noise,
        }
        if self.controller == "proportional":
            settings |= gain_params(best_gain(self.case, self.speed, self.fps))
        return {name: f"{value}" for name, value in settings.items()} | dict(self.more)

    def command(self, seed: int) -> str:
        """Command that repeats this run."""
        settings = (f"{name}={value}" for name, value in self.params.items())
        params = " ".join(f"--param {shlex.quote(setting)}" for setting in settings)
        options = f"--renderer {self.renderer} --reality {self.reality} --seed {seed}"
        return f"bt-run {TREE} {options} {params}"


def best_gain(case: CurveName, speed: float, fps: float) -> float:
    """The best constant gain of proportional control: from the table, interpolated linearly."""
    tuned = GAINS[case]
    at_rate = [float(np.interp(fps, _TUNED_AT_HZ, gains)) for gains in tuned.values()]
    return float(np.interp(speed, list(tuned), at_rate))


def gain_params(gain: float) -> dict[str, str]:
    """Parameters of the tree file for a step of ``gain`` times the error in the image."""
    return {"gain_u": f"{gain * _HALF_IMAGE[0]}", "gain_v": f"{gain * _HALF_IMAGE[1]}"}


UNTUNED: Final[tuple[Cell, ...]] = (
    Cell("circle", 1.0, label="circle of 60 mm", more={"radius": "0.06"}),
    Cell(
        "circle",
        1.0,
        label="circle elsewhere",
        more={
            "cube": "{xyz: [0.68, 0.17, 0.751]}",
            "stand": "{xyz: [0.68, 0.17, 0.388]}",
        },
    ),
    Cell(
        "circle",
        1.0,
        label="circle in XZ",
        more={
            "plane": "xz",
            "cube": "{xyz: [-0.11, 0.686, 0.701], rpy: [0, 0, 90]}",
            "stand": "{xyz: [-0.11, 0.686, 0.338], rpy: [0, 0, 90]}",
            "approach": "[0, 1, 0]",
            "leader": "{xyz: [0, 0, 0.40], rpy: [0, 0, 90]}",
            "follower": "{xyz: [-0.11, 1.60, 0.28], rpy: [0, 0, -90]}",
        },
    ),
    Cell(
        "lissajous",
        1.0,
        label="lissajous 3:2",
        more={"a": "3", "b": "2", "turns": "1", "waypoints": "60"},
    ),
    Cell("drawn", 1.0, label="drawn by hand", more={"turns": "2"}),
)
"""Five curves at full speed that were not used to tune filter or gains."""
