"""The live view of a run: snapshots taken between two steps, served to pages by a thread."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import partial
from threading import Lock
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.control.controller import JointController
from bt_dualarm.replay.record import ReplayError
from bt_dualarm.runtime.arm_runtime import Arms, ArmView, IdleObserver
from bt_dualarm.runtime.history_file import HistoryError
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.runtime.run import Run
from bt_dualarm.sim.world import World
from bt_dualarm.spec.yaml_reader import Data, Json
from bt_dualarm.viewer import signals
from bt_dualarm.viewer.events import Annotations, EventFeed, rows_of
from bt_dualarm.viewer.past import PastAnswers, Pictures
from bt_dualarm.viewer.server import (
    HOST,
    Asked,
    Gate,
    PageAnswer,
    Query,
    Served,
    ViewError,
    Viewers,
    number_in,
    text_in,
)
from bt_dualarm.viewer.signals import (
    ModelIndices,
    MotionAhead,
    Signals,
    VisualMeshes,
    model_indices,
    row_of,
    visual_meshes,
)

_SNAPSHOT_PERIOD_S: Final = 0.05
"""Wall-clock seconds between two snapshots."""

_WATCHED_S: Final = 2.0
"""Wall-clock seconds after the last request until snapshots stop."""


class Snapshot(IdleObserver):
    """Observer that copies the data of a page, but only while a page requests them.

    Args:
        world: The world.
        arms: Arms of the run.
        views: Returns the current state of all arms.

    Attributes:
        notes: Latest trace events; callers add to it.
    """

    def __init__(self, world: World, arms: Arms, views: Callable[[], tuple[ArmView, ...]]) -> None:
        self._world = world
        self._arms = arms
        self._views = views
        self.notes = Annotations()
        self._lock = Lock()
        self._last_lock = Lock()
        self._is_last = False
        self._requested_at = -np.inf
        self._taken_at = -np.inf
        self._generation = -1
        self._model: mujoco.MjModel = world.model
        self._indices: dict[str, ModelIndices] = {}
        self._ahead: dict[str, MotionAhead] = {}
        self._looks: VisualMeshes | None = None
        self._now: Json = {}
        self.take()

    @property
    def looks(self) -> VisualMeshes:
        """Shapes and meshes of the world, computed on first use."""
        with self._lock:
            if self._looks is None:
                mounted = self._world.devices.mounted
                arms = {
                    name: (robot, mounted.get(name)) for name, robot in self._world.robots.items()
                }
                self._looks = visual_meshes(self._model, arms)
            return self._looks

    @property
    def now(self) -> Json:
        """Time, poses and trees, JSON-ready; reading it keeps the snapshots up to date."""
        with self._lock:
            self._requested_at = _clock()
            return self._now

    @property
    def is_watched(self) -> bool:
        """Whether a page has requested data recently."""
        return _clock() - self._requested_at < _WATCHED_S

    def after_step(self, time: float) -> None:  # noqa: ARG002 - the world knows it, too
        """Take a snapshot if one is due."""
        if self.is_watched and _clock() - self._taken_at >= _SNAPSHOT_PERIOD_S:
            self.take()

    def take(self) -> None:
        """Copy the current state of the run; to be called between two steps only."""
        model = self._world.model
        data = self._world.data
        generation = self._world.generation
        is_new = generation != self._generation
        if is_new:
            self._indices = model_indices(model, self._world.arms)
            self._ahead = {name: MotionAhead(model, arm) for name, arm in self._indices.items()}
        controllers = {arm.name: arm.controller for arm in self._arms.present}
        now = {
            "time": round(float(data.time), 4),
            "generation": generation,
            "poses": signals.bodies(data),
            "contacts": signals.contacts(model, self._world.with_contact_forces()),
            "cameras": [
                {**camera, "look": self.notes.look(str(camera["arm"]))}
                for camera in signals.cameras(model, data, self._indices)
            ],
            "arms": [self._arm(view, controllers.get(view.name)) for view in self._views()],
        }
        with self._lock:
            self._now = now
            self._generation = generation
            self._model = model
            self._looks = None if is_new else self._looks
            self._taken_at = _clock()

    def take_last(self) -> None:
        """Copy a run that is over, once; any thread may call this, as no more steps are made."""
        with self._last_lock:
            if not self._is_last:
                self.take()
                self._is_last = True

    def _arm(self, view: ArmView, controller: JointController | None) -> Json:
        facts: Json = {
            "arm": view.name,
            "robot": view.robot,
            "outcome": None if view.outcome is None else str(view.outcome),
            "nodes": rows_of(view.tree),
            "board": self.notes.blackboard(view.name),
            "guard": self.notes.guard(view.name),
        }
        arm = self._indices.get(view.name)
        if arm is None or controller is None:
            return facts
        model = self._world.model
        data = self._world.data
        row = row_of(model, data, arm, controller.setpoint.q, data.ctrl[arm.motors])
        gripper = self._world.grippers.get(view.name)
        if gripper is not None:
            facts["gripper"] = signals.gripper(
                model, data, arm, gripper.gripper.name, gripper.force
            )
        facts |= signals.arm_numbers(row)
        life = self._arms.lives_of(view.name)
        return {**facts, "life": life, "ahead": self._ahead[view.name].of(controller, data)}


def _clock() -> float:
    return time.monotonic()


_POLL_S: Final = 0.2
"""Wall-clock seconds between two checks of whether a page is still open."""


class LiveView:
    """Serves pages on a run within a ``with`` block.

    By default the run is held until a page continues it. Pages get copies, and can only pause and
    continue the run. Its past, blackboards, images and diagnoses are available if it is recorded.

    Args:
        run: The run.
        stop: Request to end; it also ends a hold.
        port: Port number; 0 selects any free port.
        host: Address of the interface to listen on.
        paused: Whether the run starts paused.

    Raises:
        ViewError: The port is in use, or not allowed.
    """

    def __init__(
        self,
        run: Run,
        stop: StopRequest,
        port: int = 0,
        host: str = HOST,
        *,
        paused: bool = True,
    ) -> None:
        self._run = run
        self._stop = stop
        self._snapshot = Snapshot(run.world, run.assembly.arms, run.views)
        self._events = EventFeed(lambda: run.time)
        self._signals = Signals(run.world, run.assembly.arms)
        self._viewers = Viewers()
        self._pictures = Pictures(run.world, lambda: self._snapshot.is_watched)
        self.gate = Gate(lambda: bool(stop.asked), self._before_hold, paused=paused)
        self._past = None if run.open_record is None else PastAnswers(run.open_record.folder.path)
        self._served = Served(self, port, host)

    @property
    def url(self) -> str:
        """Address of the page."""
        return self._served.url

    def __enter__(self) -> LiveView:
        for observer in (self._events, self._signals, self._snapshot, self.gate):
            self._run.watch(observer)
        if self._run.open_record is not None:
            trace = self._run.open_record.trace
            trace.readers += self._snapshot.notes.add, self._events.add_event
            trace.frame_readers.append(self._pictures.take)
        self._events.listen()
        self._served.begin()
        return self

    def __exit__(self, *error: object) -> None:
        """Stop serving."""
        self._served.end()
        self._events.close()

    def linger(self) -> None:
        """After the run, wait while a page is open and no end is requested."""
        self._snapshot.take()
        while self.is_watched and not self._stop.asked:
            time.sleep(_POLL_S)

    @property
    def is_watched(self) -> bool:
        """Whether a page is open, even if it is idle, or being loaded."""
        return self._viewers.is_anyone_there

    def _before_hold(self) -> None:
        """Take a snapshot and flush the history, so that pages see everything up to now."""
        self._snapshot.take()
        if self._run.open_record is not None:
            self._run.open_record.history.flush()

    @property
    def questions(self) -> Mapping[str, Asked]:
        """Handlers of requests, by name."""
        past = {} if self._past is None else self._past.questions
        return {
            **{name: partial(self._of_past, asked) for name, asked in past.items()},
            "": lambda _: self._page(),
            "now": self._now,
            "series": lambda query: PageAnswer.of(
                self._signals.since(number_in(query, "after", 0.0))
            ),
            "log": lambda query: PageAnswer.of(
                self._events.since(int(number_in(query, "after", 0.0)))
            ),
            "scene": self._scene,
            "mesh": self._mesh,
            "eye": self._eye,
        }

    def do(self, asked: Json) -> Json:
        """Execute a command of the page.

        Raises:
            ViewError: There is no such command, or its value is invalid.
            GateError: A value is outside the allowed range.
        """
        button = self._buttons.get(str(asked.get("action", "")))
        if button is None:
            raise ViewError(f"there is no button {str(asked.get('action'))[:40]!r}")
        try:
            button(asked.get("value"))
        except (TypeError, ValueError, AttributeError) as error:
            raise ViewError(f"invalid value: {error}") from error
        return self.gate.state

    def _page(self) -> PageAnswer:
        self._viewers.fetched()
        return PageAnswer.page()

    def _now(self, query: Query) -> PageAnswer:
        """Current state of the run and of its gate."""
        self._viewers.asked(query.get("page", ""))
        identity = {"kind": "live", "name": self._run.name, "recorded": self._past is not None}
        over = self._run.done
        if over:
            self._snapshot.take_last()
        facts = {"over": over, "timestep": self._run.world.timestep}
        return PageAnswer.of({**identity, **facts, **self._snapshot.now, **self.gate.state})

    def _scene(self, query: Query) -> PageAnswer:
        generation = int(number_in(query, "generation", -1.0)) if "generation" in query else -1
        now = self._snapshot.now["generation"]
        if generation in (-1, now) or self._past is None:
            return PageAnswer.of(self._snapshot.looks.scene(now))
        return PageAnswer.of(self._past.scene(generation))

    def _mesh(self, query: Query) -> PageAnswer:
        name = text_in(query, "name")
        found = self._snapshot.looks.meshes.get(name)
        if found is None and self._past is not None:
            found = self._past.past.mesh(name)
        return PageAnswer.numbers(found)

    def _eye(self, query: Query) -> PageAnswer:
        """Last image of a camera, or its image at a given time."""
        if "t" in query and self._past is not None:
            return self._of_past(self._past.questions["eye"], query)
        return PageAnswer.jpeg(self._pictures.jpeg(text_in(query, "arm")))

    def _of_past(self, asked: Asked, query: Query) -> PageAnswer:
        """Answer of the record, which has nothing until a second has passed or the run is held.

        Raises:
            ViewError: It has nothing yet.
        """
        try:
            return asked(query)
        except (ReplayError, HistoryError) as error:
            if self._past is None or self._past.past.has_states:
                raise
            nothing = "nothing has happened yet: press Go"
            begun = "the first second is not recorded yet: press Pause, or ask again later"
            raise ViewError(begun if self._run.time > 0.0 else nothing) from error

    @property
    def _buttons(self) -> Mapping[str, Callable[[Data], None]]:
        gate = self.gate
        return {
            "pause": lambda _: gate.pause(),
            "go": lambda _: gate.go(),
            "step": lambda _: gate.step(),
            "tick": lambda _: gate.tick(),
            "speed": gate.set_speed,
            "leave": lambda value: self._viewers.left(str(value)),
            "break": lambda value: gate.set_breakpoints(str(value).split("\n")),
        }
