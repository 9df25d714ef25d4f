"""A trial in which an arm of the catalog tracks a cube: its error, and whether it oscillates."""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
import scipy

from benchmarks.vantage import BASE, POSTURE, vantage
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.behaviors.report import LeafReport
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.values import Plane
from bt_dualarm.spec.yaml_reader import Data

LOOKS: Final = {"yz": (1.0, 0.0, 0.0), "xz": (0.0, 1.0, 0.0), "xy": (0.0, 0.0, -1.0)}
"""Direction in which the camera looks, by the plane."""

DISTANCE_M = 0.35
RADIUS_M = 0.1
SPEED = 0.1
"""Radius and speed of the circle, m and m/s."""

_WIND_UP_S = 3.0
_SETTLED_S = 2.0  # after the start of the run, when the spectrum begins
_LENGTH_S = {"rest": 6.0, "circle": 11.0}
_NOT_FOLLOWING_M = 0.005
_LEAST_HZ = 0.75  # slower motion is drift, which is part of the error
_FEWEST = 500  # smallest number of samples for a spectrum
_ERROR = "error_in_plane_m"
_LIMITS = ("velocity", "acceleration", "jerk")


@dataclass(frozen=True)
class Spot:
    """One case: robot, motion of the cube, and camera.

    Attributes:
        robot: Name of the robot in the catalog.
        plane: A named plane of the world.
        fps: Frame rate, Hz.
        share: Share of the arm's limits.
        latency: Age of an image when it arrives, s.
        motion: Motion of the cube: ``rest`` or ``circle``.
        reality: Deviations of the arm from its model.
        sized: Whether the cube's size is known.
        seed: Seed of the run and of the robot's deviations.
    """

    robot: str
    plane: str
    fps: float = 60.0
    share: float = 1.0
    latency: float = 0.017
    motion: str = "rest"
    reality: str = "ideal"
    sized: bool = False
    seed: int = 0

    def __str__(self) -> str:
        ms = round(1e3 * self.latency)
        camera = f"{self.fps:3g} Hz {ms:2d} ms"
        arm = f"{self.robot:<6} {self.plane} {camera} limits {self.share:3g}"
        sized = " sized" * self.sized
        return f"{arm} {self.motion} {self.reality}{sized} {self.seed}"

    @property
    def goal(self) -> float:
        """Largest allowed RMS error, m."""
        if self.motion == "circle":
            return 2e-3
        return 0.5e-3 if self.fps >= 60.0 else 1e-3


@dataclass(frozen=True)
class Outcome:
    """Measurements of one case.

    Attributes:
        rms: RMS distance from the cube in the plane, m.
        worst: Largest distance, m.
        peak: Amplitude of the highest peak in the spectrum of the tool's path, m.
        peak_hz: Frequency of the peak, Hz.
        growth: Error of the last third over that of the first.
        code: Failure code, or empty.
        lost: Number of times that the cube was lost.
    """

    rms: float
    worst: float
    peak: float
    peak_hz: float
    growth: float
    code: str
    lost: int = 0

    def __str__(self) -> str:
        return (
            f"RMS {1e3 * self.rms:6.3f} mm, max {1e3 * self.worst:6.3f} mm, "
            f"peak {1e3 * self.peak:6.3f} mm at {self.peak_hz:5.2f} Hz, "
            f"growth {self.growth:4.2f} {self.code}"
        )

    def swings(self, goal: float) -> bool:
        """Whether the peak exceeds half of the allowed RMS, or errors grow."""
        grows = self.growth > 2.0 and self.rms > goal / 4
        return grows or self.peak / math.sqrt(2) > goal / 2


@dataclass
class _Carrier(IdleObserver):
    """Moves the cube, and records the positions of the tool."""

    world: World
    place: Vector
    axes: Matrix
    circles: bool
    rows: list[tuple[float, Vector]] = field(default_factory=list)

    def after_step(self, time: float) -> None:
        """Move the cube, and record the tool."""
        if self.circles:
            moved = self.place + circling(time) @ self.axes
            self.world.model.body_pos[self.world.object_body("cube")] = moved
        self.rows.append((time, self.axes @ self.world.arms["arm1"].tool_pose.position))


def circling(time: float) -> Vector:
    """Position on the circle, whose radius grows smoothly, in the plane, of shape (2,), m."""
    grown = min(1.0, time / _WIND_UP_S)
    radius = RADIUS_M * grown**3 * (10 - 15 * grown + 6 * grown**2)
    angle = SPEED / RADIUS_M * time
    return radius * np.array((np.cos(angle), np.sin(angle)))


def follow(spot: Spot, registry: Registry) -> Outcome:
    """Run one case, and measure it."""
    viewpoint = vantage(spot.robot, LOOKS[spot.plane])
    axes = np.array(Plane.model_validate(spot.plane).axes)
    place = viewpoint.ahead(DISTANCE_M)
    with tempfile.TemporaryDirectory() as folder:
        tree = _tree(spot, viewpoint.write_description(Path(folder)), place)
        file = load_tree_file(tree, registry.kinds, folder=Path(folder))
        with Run(file, registry, RunOptions(seed=spot.seed, renderer="ray")) as run:
            carrier = _Carrier(run.world, place, axes, spot.motion == "circle")
            run.watch(carrier)
            arm = run.finish().arms["arm1"]
    errors = [
        one.values for of in arm.series.values() for name, one in of.items() if name == _ERROR
    ]
    return _outcome(arm.runs[0], errors[0] if errors else np.zeros(0), carrier.rows)


def _tree(spot: Spot, robot: str, place: Vector) -> dict[str, Data]:
    """The tree file of a case."""
    xyz, rpy = BASE
    cube = {
        "shape": "box",
        "size": [0.05, 0.05, 0.05],
        "mass": 0.1,
        "color": "yellow",
        "fixed": True,
        "pose": {"xyz": place.tolist()},
    }
    camera = {
        "mount": "wrist",
        "resolution": [320, 240],
        "fov": 50,
        "fps": spot.fps,
        "latency": spot.latency,
    }
    track: dict[str, Data] = {
        "plane": spot.plane,
        "distance": DISTANCE_M,
        "score": "cube",
        "duration": _LENGTH_S[spot.motion],
        "max_error": _NOT_FOLLOWING_M,
    }
    if spot.sized:
        track["target_size"] = 0.05
    arm = {
        "robot": robot,
        "base": {"xyz": list(xyz), "rpy": list(rpy)},
        "posture": POSTURE,
        "camera": camera,
        "limits": dict.fromkeys(_LIMITS, spot.share),
        "tree": {"track": track},
    }
    world = {"scene": "empty", "time_limit": 60.0, "reality": spot.reality}
    return {"bt_dualarm": 1, "world": world, "objects": {"cube": cube}, "arms": {"arm1": arm}}


def _outcome(leaf: LeafReport, errors: Vector, rows: list[tuple[float, Vector]]) -> Outcome:
    third = len(errors) // 3
    parts = [float(np.sqrt(np.mean(np.square(part)))) for part in (errors[:third], errors[-third:])]
    peak_hz, peak = _spectrum(rows)
    return Outcome(
        rms=float(leaf.metrics.get("plane_rms_m", np.nan)),
        worst=float(leaf.metrics.get("plane_max_m", np.nan)),
        peak=peak,
        peak_hz=peak_hz,
        growth=parts[1] / max(parts[0], 1e-9),
        code=str(leaf.code or ""),
        lost=int(leaf.metrics.get("lost_count", 0)),
    )


def _spectrum(rows: list[tuple[float, Vector]]) -> tuple[float, float]:
    """Frequency in Hz and amplitude in m of the highest peak in the spectrum of the tool's path."""
    times = np.array([time for time, _ in rows])
    late = times > times[0] + _SETTLED_S
    path = np.array([place for _, place in rows])[late]
    if len(path) < _FEWEST:
        return np.nan, np.nan
    window = np.hanning(len(path))[:, None]
    lines = np.abs(np.fft.rfft(scipy.signal.detrend(path, axis=0) * window, axis=0))
    lines *= 2.0 / window.sum()
    frequencies = np.fft.rfftfreq(len(path), float(np.median(np.diff(times))))
    both = np.where(frequencies > _LEAST_HZ, np.hypot(*lines.T), 0.0)
    best = int(np.argmax(both))
    return float(frequencies[best]), float(both[best])
