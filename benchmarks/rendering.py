"""Cost of a frame: rendering, detection, estimation; run ``python -m benchmarks.rendering``.

Scene of ``trees/pick_and_track.yaml`` after 10 s: the UR5 moves the cube in front of the Panda's
wrist camera, which tracks it. Times are the best of many, in milliseconds; ratios are relative to
``mj_multiRay`` for the whole image.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import mujoco
import numpy as np

import bt_dualarm as bt
from benchmarks.constant_jerk import ConstantJerk
from bt_dualarm.core.errors import RendererError
from bt_dualarm.perception.detection import ColorFilter, detect
from bt_dualarm.perception.target_filter import Oscillator, TargetEstimate
from bt_dualarm.robots.mjspec import LOOP_GROUPS
from bt_dualarm.sim.camera import Camera
from bt_dualarm.sim.frame import RendererKind, Window
from bt_dualarm.sim.renderers import camera_rays, choose_renderer
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import CameraSpec
from bt_dualarm.spec.values import Color

TRACKED_S = 10.0
"""Simulated time of the scene, s."""

WINDOW = (132, 92, 188, 148)
ROUNDS = 40


def main() -> None:
    """Print a line per measurement."""
    with demo_world() as world:
        measure(world)


@contextmanager
def demo_world() -> Iterator[World]:
    """World of the demo while the Panda tracks the cube."""
    with bt.open("pick_and_track", renderer="ray") as run:
        run.step(TRACKED_S)
        yield run.world


def measure(world: World) -> None:
    """Print a line per measurement in a world."""
    camera_id = world.arms["arm2"].camera_id
    whole = best_ms(lambda: cast_by_mujoco(world, camera_id))
    report("mj_multiRay, whole image 320 x 240", whole, whole)
    kinds: tuple[RendererKind, ...] = ("ray", "gl")
    for kind in kinds:
        try:
            renderer = choose_renderer(kind).create()
        except RendererError as error:
            print(f"{kind}: {error}")
            continue
        camera = Camera("arm2/camera", CameraSpec(resolution=(320, 240)), renderer)
        for label, cost in per_frame(world, camera):
            report(f"{kind}, {label}", cost, whole)
    for label, cost in estimation():
        report(label, cost, whole)


def per_frame(world: World, camera: Camera) -> Iterator[tuple[str, float]]:
    """Costs of a whole image, a coarse one, a window around the cube, and of detection, ms."""
    yellow = ColorFilter(Color.named("yellow"))
    windows = {
        "whole image": Window(),
        "search, every 3rd pixel": Window(None, 3),
        "window 56 x 56": Window(WINDOW),
    }
    for label, window in windows.items():
        camera.aim = partial(_always, window)
        yield label, best_ms(partial(camera.capture, world))
        frame = camera.capture(world)
        if detect(frame, yellow) is None:
            raise SystemExit(f"{label}: the cube was not found")
        yield f"{label}: detection", best_ms(partial(detect, frame, yellow))


def _always(window: Window, *_: object) -> Window:
    return window


def estimation() -> Iterator[tuple[str, float]]:
    """Costs of an update and of a prediction with each model, ms."""
    for model in (ConstantJerk(), Oscillator()):
        name = type(model).__name__
        estimate = TargetEstimate(model)
        yield f"{name}: update", best_ms(updates(estimate))
        yield f"{name}: prediction", best_ms(partial(estimate.predict, 2.0))


def updates(estimate: TargetEstimate) -> Callable[[], None]:
    """An action that processes the next measurement of a target at rest, at 60 Hz."""
    stamps = itertools.count(0.0, 1.0 / 60.0)
    place = np.array([0.7, 0.1, 0.7])
    return lambda: estimate.update(next(stamps), place, 1e-4)


def cast_by_mujoco(world: World, camera_id: int) -> None:
    """Cast the rays of the same image with one call of MuJoCo."""
    data: Any = world.data
    rays = camera_rays(320, 240, float(world.model.cam_fovy[camera_id]), 1).reshape(3, -1)
    rays = np.ascontiguousarray((data.cam_xmat[camera_id].reshape(3, 3) @ rays).T)
    groups = np.zeros(mujoco.mjNGROUP, np.uint8)
    groups[list(LOOP_GROUPS)] = 1
    count = len(rays)
    mujoco.mj_multiRay(
        world.model, data, data.cam_xpos[camera_id], rays.ravel(), groups, True, -1,
        np.empty(count, np.int32), np.empty(count), np.empty(3 * count), count, 1e10,
    )  # fmt: skip


def best_ms(action: Callable[[], object], rounds: int = ROUNDS) -> float:
    """Shortest duration of an action in ms: other processes can only add to it."""
    action()
    durations = []
    for _ in range(rounds):
        start = time.perf_counter()
        action()
        durations.append(time.perf_counter() - start)
    return 1e3 * min(durations)


def report(label: str, cost_ms: float, whole_ms: float) -> None:
    """Print a cost, and its ratio to that of the whole image by MuJoCo's rays."""
    print(f"{label:42s} {cost_ms:8.3f} ms   1/{whole_ms / cost_ms:.0f}")


if __name__ == "__main__":
    main()
