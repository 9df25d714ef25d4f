"""The copy of a run that pages see: made between two steps, and only while somebody looks."""

from __future__ import annotations

import base64
import time
from collections.abc import Callable, Iterator
from threading import Lock
from typing import Final

import numpy as np

from bt_dualarm.replay.page_scene import shapes_of
from bt_dualarm.runtime.parts import ArmView, IdleObserver
from bt_dualarm.spec.source import Json
from bt_dualarm.tree.report import NodeView
from bt_dualarm.world.world import World

_EVERY_S: Final = 0.05
"""Seconds on the wall between two copies."""

_FORGOTTEN_S: Final = 2.0
"""Seconds on the wall after which nobody looks any more."""


class Snapshot(IdleObserver):
    """An observer that copies what a page shows.

    Args:
        name: Name of the tree file.
        world: The world.
        views: Function that gives all arms as they stand.
    """

    def __init__(self, name: str, world: World, views: Callable[[], tuple[ArmView, ...]]) -> None:
        self._name, self._world, self._views = name, world, views
        self._lock = Lock()
        self._asked_at = self._taken_at = -np.inf
        self._generation = -1
        self._scene: Json = {}
        self._now: Json = {}
        self.take()

    @property
    def scene(self) -> Json:
        """Shapes and meshes of the world, ready for JSON."""
        with self._lock:
            return self._scene

    @property
    def now(self) -> Json:
        """Time, poses and trees, ready for JSON; asking keeps the copies coming."""
        with self._lock:
            self._asked_at = time.monotonic()
            return self._now

    def after_step(self, time: float) -> None:  # noqa: ARG002 - the world knows it, too
        """Copy what is due."""
        now = _clock()
        if now - self._asked_at < _FORGOTTEN_S and now - self._taken_at >= _EVERY_S:
            self.take()

    def take(self) -> None:
        """Copy the run as it is now; to be called between two steps only."""
        data, generation = self._world.data, self._world.generation
        scene = self._scene
        if generation != self._generation:
            shapes, meshes = shapes_of(self._world.model)
            scene = {
                "name": self._name,
                "generation": generation,
                "shapes": shapes,
                "meshes": meshes,
            }
        poses = np.hstack((data.xpos, data.xquat)).astype(np.float32)
        now = {
            "time": float(data.time),
            "generation": generation,
            "poses": base64.b64encode(poses.tobytes()).decode("ascii"),
            "arms": [_arm(view) for view in self._views()],
        }
        with self._lock:
            self._scene, self._now, self._generation = scene, now, generation
            self._taken_at = _clock()


def _arm(view: ArmView) -> Json:
    nodes = [] if view.tree is None else [*_nodes(view.tree, 0)]
    outcome = None if view.outcome is None else str(view.outcome)
    return {"arm": view.name, "robot": view.robot, "outcome": outcome, "nodes": nodes}


def _nodes(node: NodeView, depth: int) -> Iterator[Json]:
    yield {
        "depth": depth,
        "name": node.name,
        "kind": node.kind,
        "status": node.status,
        "halted": node.halted,
        "since": round(node.since, 3),
        "progress": node.progress,
        "reason": node.reason,
    }
    for child in node.children:
        yield from _nodes(child, depth + 1)


def _clock() -> float:
    return time.monotonic()
