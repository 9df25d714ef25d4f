"""Holds a run between two physics steps: pause, one step, one tick, a speed, a breakpoint.

Trees, controllers and physics stand still together, and nothing of the run knows of it: only
simulated time counts there.
"""

from __future__ import annotations

import reprlib
import time
from collections.abc import Callable
from threading import Condition
from typing import Final

from bt_dualarm.errors import DualArmError
from bt_dualarm.runtime.parts import IdleObserver, RunView
from bt_dualarm.spec.source import Data
from bt_dualarm.tree.report import StatusChange

_LOOK_S: Final = 0.1
"""Seconds on the wall between two looks at whether the run is to end."""

_MOST_BREAKPOINTS: Final = 50
_LONGEST: Final = 300


class GateError(DualArmError):
    """A page asked for something that cannot be done."""


class Gate(IdleObserver):
    """An observer that lets the run go on, or not.

    Args:
        asked_to_end: Function that says whether the run is to end: then nothing is held.
        on_hold: Function that is called when the run is about to be held, between two steps.
        paused: Whether it begins paused.
        speed: Simulated seconds for each second on the wall; infinite for as fast as it can.

    Attributes:
        chores: What is done now and then while the run is held; each says whether it changed what
            is to be seen.
    """

    def __init__(
        self,
        asked_to_end: Callable[[], bool],
        on_hold: Callable[[], object] = lambda: None,
        *,
        paused: bool = True,
        speed: float = 1.0,
    ) -> None:
        self._asked_to_end, self._on_hold = asked_to_end, on_hold
        self._changed = Condition()
        self._paused, self._speed = paused, speed
        self._is_held = False
        self.chores: list[Callable[[], bool]] = []
        self._steps: int | None = None
        self._until_tick = False
        self._breakpoints: dict[str, None] = {}
        self._why = "begins here" if paused else ""
        self._ahead: tuple[float, float] | None = None

    @property
    def state(self) -> dict[str, object]:
        """What a page shows of it, ready for JSON; it is held a moment after it was told to be."""
        speed = None if self._speed == float("inf") else self._speed
        held = {"paused": self._paused, "held": self._is_held, "speed": speed, "why": self._why}
        return {**held, "breakpoints": [*self._breakpoints]}

    def pause(self) -> None:
        """Hold the run after its next step."""
        self._set(paused=True, why="paused")

    def go(self) -> None:
        """Let it go on."""
        self._set(paused=False)

    def step(self) -> None:
        """Let it make one physics step."""
        self._set(paused=False, steps=1)

    def tick(self) -> None:
        """Let it go on until trees have been ticked."""
        self._set(paused=False, until_tick=True)

    def set_speed(self, speed: Data) -> None:
        """Simulated seconds for each second on the wall; None for as fast as it can.

        Raises:
            GateError: It is no number from 0.001 to 1000.
        """
        # Compared as it is: a whole number may be too large to become a float.
        is_number = isinstance(speed, int | float) and not isinstance(speed, bool)
        if speed is not None and not (is_number and 1e-3 <= speed <= 1e3):
            said = reprlib.repr(speed)
            raise GateError(f"a speed is a number from 0.001 to 1000, not {said}")
        with self._changed:
            self._speed = float("inf") if speed is None else float(speed)
            self._ahead = None

    def set_breakpoints(self, names: list[str]) -> None:
        """Pause whenever a node of such a name, kind or path takes another status.

        ``NAME FAILURE`` stops at this status only, ``FAILURE`` at any node's.

        Raises:
            GateError: There are too many of them, or they are too long.
        """
        if len(names) > _MOST_BREAKPOINTS or any(len(name) > _LONGEST for name in names):
            raise GateError(f"at most {_MOST_BREAKPOINTS} breakpoints, each {_LONGEST} characters")
        self._breakpoints = dict.fromkeys(name.strip() for name in names if name.strip())

    def on_event(self, change: StatusChange) -> None:
        """Pause if that is a breakpoint."""
        for name in self._breakpoints:
            node, _, status = name.rpartition(" ")
            if not node and status not in ("SUCCESS", "FAILURE", "RUNNING", "INVALID"):
                node, status = status, ""
            named = node in ("", change.path, change.kind) or change.path.endswith(f"/{node}")
            if named and status in ("", change.new):
                self._set(paused=True, why=f"{change.arm}:{change.path} → {change.new}")

    def after_ticks(self, run: RunView) -> None:  # noqa: ARG002 - that there was one is enough
        """Pause if that was the tick that was asked for."""
        if self._until_tick:
            self._set(paused=True, why="one tick")

    def after_step(self, time: float) -> None:
        """Wait as long as the run is held."""
        if self._steps is not None:
            self._steps -= 1
            if self._steps <= 0:
                self._set(paused=True, why="one step")
        self._keep_pace(time)
        if self._paused:
            self._on_hold()
            self.hold()
            self._ahead = None

    def hold(self) -> None:
        """Wait as long as the run is held."""
        self._is_held = True
        while self._paused and not self._asked_to_end():
            with self._changed:
                if self._paused:
                    self._changed.wait(_LOOK_S)
            for chore in self.chores:
                if chore():
                    self._on_hold()
        self._is_held = False

    def _keep_pace(self, simulated: float) -> None:
        """Sleep as long as simulated time is ahead of the clock on the wall."""
        if self._speed == float("inf"):
            return
        now = time.monotonic()
        if self._ahead is None:
            self._ahead = now, simulated
        began, since = self._ahead
        left = (simulated - since) / self._speed - (now - began)
        while left > 0 and not self._asked_to_end() and self._ahead is not None:
            time.sleep(min(left, _LOOK_S))
            left -= _LOOK_S

    def _set(
        self, *, paused: bool, why: str = "", steps: int | None = None, until_tick: bool = False
    ) -> None:
        with self._changed:
            self._paused, self._why = paused, why
            self._steps, self._until_tick = steps, until_tick
            self._changed.notify_all()
