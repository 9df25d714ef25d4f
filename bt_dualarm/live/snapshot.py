"""The copy of a run that pages see: made between two steps, and only while somebody looks."""

from __future__ import annotations

import time
from collections.abc import Callable
from threading import Lock
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.live import physics
from bt_dualarm.live.ahead import WayAhead
from bt_dualarm.live.meshes import Looks, looks_of
from bt_dualarm.live.notes_seen import NotesSeen
from bt_dualarm.live.places import Places, places_of
from bt_dualarm.live.signals import row_of
from bt_dualarm.live.trees import rows_of
from bt_dualarm.runtime.arms import Arms
from bt_dualarm.runtime.parts import ArmView, Controller, IdleObserver
from bt_dualarm.spec.source import Json
from bt_dualarm.world.world import World

_EVERY_S: Final = 0.05
"""Seconds on the wall between two copies."""

_FORGOTTEN_S: Final = 2.0
"""Seconds on the wall after which nobody looks any more."""


class Snapshot(IdleObserver):
    """An observer that copies what a page shows.

    Args:
        world: The world.
        arms: Arms that are in it.
        views: Function that gives all arms as they stand.

    Attributes:
        notes: What was noted of blackboards and pictures; others add to it.
    """

    def __init__(self, world: World, arms: Arms, views: Callable[[], tuple[ArmView, ...]]) -> None:
        self._world, self._arms, self._views = world, arms, views
        self.notes = NotesSeen()
        self._lock, self._last_lock = Lock(), Lock()
        self._is_last = False
        self._asked_at = self._taken_at = -np.inf
        self._generation = -1
        self._model: mujoco.MjModel = world.model
        self._places: dict[str, Places] = {}
        self._ahead: dict[str, WayAhead] = {}
        self._looks: Looks | None = None
        self._now: Json = {}
        self.take()

    @property
    def looks(self) -> Looks:
        """Shapes and meshes of the world, worked out when the first page asks."""
        with self._lock:
            if self._looks is None:
                mounted = self._world.equipment.mounted
                arms = {
                    name: (robot, mounted.get(name)) for name, robot in self._world.robots.items()
                }
                self._looks = looks_of(self._model, arms)
            return self._looks

    @property
    def now(self) -> Json:
        """Time, poses and trees, ready for JSON; asking keeps the copies coming."""
        with self._lock:
            self._asked_at = _clock()
            return self._now

    @property
    def is_watched(self) -> bool:
        """Whether a page has asked of late."""
        return _clock() - self._asked_at < _FORGOTTEN_S

    def after_step(self, time: float) -> None:  # noqa: ARG002 - the world knows it, too
        """Copy what is due."""
        if self.is_watched and _clock() - self._taken_at >= _EVERY_S:
            self.take()

    def take(self) -> None:
        """Copy the run as it is now; to be called between two steps only."""
        model, data = self._world.model, self._world.data
        generation = self._world.generation
        is_new = generation != self._generation
        if is_new:
            self._places = places_of(model, self._world.arms)
            self._ahead = {name: WayAhead(model, arm) for name, arm in self._places.items()}
        controllers = {arm.name: arm.controller for arm in self._arms.present}
        now = {
            "time": round(float(data.time), 4),
            "generation": generation,
            "poses": physics.bodies(data),
            "contacts": physics.contacts(model, data),
            "cameras": [
                {**camera, "look": self.notes.look(str(camera["arm"]))}
                for camera in physics.cameras(model, data, self._places)
            ],
            "arms": [self._arm(view, controllers.get(view.name)) for view in self._views()],
        }
        with self._lock:
            self._now, self._generation, self._model = now, generation, model
            self._looks = None if is_new else self._looks
            self._taken_at = _clock()

    def take_last(self) -> None:
        """Copy, once, a run that is over: from then on any thread may, as nobody advances it."""
        with self._last_lock:
            if not self._is_last:
                self.take()
                self._is_last = True

    def _arm(self, view: ArmView, controller: Controller | None) -> Json:
        said: Json = {
            "arm": view.name,
            "robot": view.robot,
            "outcome": None if view.outcome is None else str(view.outcome),
            "nodes": rows_of(view.tree),
            "board": self.notes.board(view.name),
            "guard": self.notes.guard(view.name),
        }
        arm = self._places.get(view.name)
        if arm is None or controller is None:
            return said
        model, data = self._world.model, self._world.data
        row = row_of(model, data, arm, controller.setpoint.q, data.ctrl[arm.motors])
        gripper = self._world.grippers.get(view.name)
        if gripper is not None:
            said["gripper"] = physics.gripper(model, data, arm, gripper.gripper.name, gripper.force)
        said |= physics.arm_numbers(row)
        return {**said, "ahead": self._ahead[view.name].of(controller, data)}


def _clock() -> float:
    return time.monotonic()
