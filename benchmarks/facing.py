"""Tracking in space with a camera that faces its target, compared with a fixed orientation.

    python -m benchmarks.facing [--robot NAME ...] [--motion KIND ...] [--camera FPS/MS ...]
        [--reality lab rough] [--seconds S] [--seed S] [--kept]

A ball moves in front of the follower's wrist camera for ``--seconds``. Prints for each trial the
outcome and three RMS values: the true error across the camera's axis, minus its mean, the angle
between the optical axis and the ball, and the error of the distance.
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.campaign import Campaign, add_options
from benchmarks.following_trial import DISTANCE_M, LOOKS
from benchmarks.measured_robots import MEASURED
from benchmarks.vantage import BASE, POSTURE, vantage
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.core.pose import Matrix, Vector, camera_pose
from bt_dualarm.robots.robot_description import robot_names
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.yaml_reader import Data

MOTIONS: Final = ("around", "sideways", "approach", "lissajous", "hidden 0.2 s", "lost")
"""An arc of 50° to either side; a swing across the line of sight; one along it; motion in all
directions; the same, once hidden for 0.2 s; the same, hidden for good."""

_SIDE_M = 0.05
_REST_S = 2.0
_HIDDEN_S = 4.0  # time at which the ball can no longer be recognized
_COVER_AT = np.array((0.0, 0.0, 0.25))  # position of the cover in the camera frame, m
_AWAY = (0.0, 0.0, 20.0)
_BEHIND_M = 0.4
_WIDE = math.radians(50.0)
_PERIOD_S = 6.0


@dataclass
class _Carrier(IdleObserver):
    """Moves the ball, and hides it."""

    world: World
    place: Vector
    axes: Matrix
    motion: str

    def after_step(self, time: float) -> None:
        hidden = {"hidden 0.2 s": _HIDDEN_S + 0.2, "lost": math.inf}.get(self.motion, 0.0)
        model = self.world.model
        body = self.world.object_body("cube")
        model.body_pos[body] = self.at(time)
        # A gray ball in front of the camera hides the ball, whose motion goes on.
        cover = self.world.object_body("cover")
        camera = camera_pose(self.world.data, model.camera("arm1/camera").id)
        is_hidden = _HIDDEN_S <= time < hidden
        model.body_pos[cover] = camera.apply(_COVER_AT) if is_hidden else _AWAY

    def at(self, time: float) -> Vector:
        """Position of the ball, of shape (3,), m; it starts smoothly within half a period."""
        since = max(0.0, time - _REST_S)
        grown = min(1.0, since / (0.5 * _PERIOD_S))
        grown = grown**3 * (10.0 - 15.0 * grown + 6.0 * grown**2)
        phase = 2.0 * np.pi * since / _PERIOD_S
        swing = grown * np.sin(phase)
        if self.motion == "around":
            # The axis is 0.4 m behind the camera.
            axis = self.place - (DISTANCE_M + _BEHIND_M) * self.axes[2]
            turn = Rotation.from_rotvec(_WIDE * swing * self.axes[1])
            arc: Vector = axis + turn.apply(self.place - axis)
            return arc
        if self.motion == "sideways":
            shares = np.array((0.25 * swing, 0.0, 0.0))
        elif self.motion == "approach":
            shares = np.array((0.0, 0.0, 0.08 * swing))
        else:
            shares = np.array((0.12 * swing, 0.08 * grown * np.sin(2.0 * phase), 0.05 * swing))
        position: Vector = self.place + shares @ self.axes
        return position


def follow(
    robot: str,
    motion: str,
    camera: str,
    reality: str,
    orientation: str,
    plane: str,
    seconds: float,
    seed: int,
) -> str:
    """Run one trial; returns the line to print."""
    registry = Registry.load()
    viewpoint = vantage(robot, LOOKS[plane])
    fps, _, latency = camera.partition("/")
    place = viewpoint.ahead(DISTANCE_M)
    xyz, rpy = BASE
    with tempfile.TemporaryDirectory() as folder:
        track: dict[str, Data] = {
            "plane": "free",
            "orientation": orientation,
            "distance": DISTANCE_M,
            "target_size": _SIDE_M,
            "score": "cube",
            "reach": 1.5,
            "duration": seconds,
            "max_error": 0.05,
        }
        ball: dict[str, Data] = {
            "shape": "sphere",
            "size": [_SIDE_M / math.sqrt(math.pi)],
            "mass": 0.1,
            "color": "yellow",
            "fixed": True,
            "pose": {"xyz": place.tolist()},
        }
        cover: dict[str, Data] = {
            "shape": "sphere",
            "size": [0.04],
            "mass": 0.1,
            "color": "gray",
            "fixed": True,
            "pose": {"xyz": list(_AWAY)},
        }
        arm: dict[str, Data] = {
            "robot": viewpoint.write_description(Path(folder)),
            "base": {"xyz": list(xyz), "rpy": list(rpy)},
            "posture": POSTURE,
            "camera": {
                "mount": "wrist",
                "resolution": [320, 240],
                "fov": 50,
                "fps": float(fps),
                "latency": 1e-3 * float(latency),
            },
            "tree": {"track": track},
        }
        world: dict[str, Data] = {"scene": "empty", "time_limit": 60.0, "reality": reality}
        tree: dict[str, Data] = {
            "bt_dualarm": 1,
            "world": world,
            "objects": {"cube": ball, "cover": cover},
            "arms": {"arm1": arm},
        }
        file = load_tree_file(tree, registry.kinds, folder=Path(folder))
        with Run(file, registry, RunOptions(seed=seed, renderer="ray")) as run:
            run.watch(_Carrier(run.world, place, viewpoint.camera.rotation_matrix.T, motion))
            leaf = run.finish().arms["arm1"].runs[0]
    metrics = leaf.metrics
    numbers = [float(metrics.get(name, np.nan)) for name in ("plane_rms_m", "distance_rms_m")]
    aim = math.degrees(float(metrics.get("aim_rms_rad", np.nan)))
    code = "SUCCESS" if str(leaf.status) == "SUCCESS" else str(leaf.code)
    cause = str(metrics.get("cause", ""))
    return (
        f"{robot:<6} {motion:<12} {camera:<6} {reality:<5} {orientation:<6} "
        f"{1e3 * numbers[0]:7.2f} mm {aim:6.2f}° {1e3 * numbers[1]:6.2f} mm  {code} {cause} "
        f"{leaf.ended_s or math.nan:.1f} s"
    )


def main(arguments: list[str]) -> int:
    """Print a line per trial."""
    parser = argparse.ArgumentParser(description="facing a target")
    parser.add_argument("--robot", nargs="+", default=list(MEASURED), choices=robot_names())
    parser.add_argument("--motion", nargs="+", default=list(MOTIONS), choices=MOTIONS)
    parser.add_argument("--camera", nargs="+", default=["60/20"])
    parser.add_argument("--reality", nargs="+", default=["lab"])
    parser.add_argument("--plane", default="yz", choices=list(LOOKS))
    parser.add_argument("--seconds", type=float, default=12.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kept", action="store_true", help="also keep the orientation")
    add_options(parser)
    options = parser.parse_args(arguments)
    orientations = ("facing", "kept") if options.kept else ("facing",)
    names = ("robot", "motion", "camera", "reality", "orientation")
    each = itertools.product(
        options.robot, options.motion, options.camera, options.reality, orientations
    )
    common = {"plane": options.plane, "seconds": options.seconds, "seed": options.seed}
    trials = [dict(zip(names, trial, strict=True)) | common for trial in each]
    with Campaign(options) as campaign:
        for _, line in campaign.run(follow, trials):
            print(line, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
