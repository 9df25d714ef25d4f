"""The runner: advances cameras, trees, controllers and physics on one simulated clock."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, field

from bt_dualarm.core.errors import RAISED_BY_SKILLS, DivergenceError, Overrun
from bt_dualarm.runtime.arm_runtime import Arms, ArmView
from bt_dualarm.runtime.clock import Pacer, Unpaced
from bt_dualarm.runtime.interruption import StopRequest, Watchdog
from bt_dualarm.runtime.observations import StatusFeed
from bt_dualarm.runtime.outcome import Ending, RunResult
from bt_dualarm.sim.world import World

_log = logging.getLogger(__name__)

STOPPING_S = 5.0
"""Simulated seconds granted to the arms to come to rest after the end; a stop takes below 1 s."""


@dataclass(frozen=True)
class Limit:
    """Latest end of a run.

    Attributes:
        seconds: Simulated seconds.
        ending: Ending reported when they have elapsed.
    """

    seconds: float
    ending: Ending = Ending.TIME_LIMIT


@dataclass
class Conditions:
    """Settings and services of a run in addition to its world and arms.

    Attributes:
        limit: Simulated time at which the run ends at the latest.
        clock: Wall clock in seconds, used for the real-time factor only.
        stop: Request to end, checked before every step.
        pacer: Limits the rate of simulated time.
        watchdog: Limits the wall-clock time of skill code.
        violation: Sentence on a violated invariant, empty while there is none.
        inject: Starts and ends the faults that are due, before each step; None if there are none.
    """

    limit: Limit
    clock: Callable[[], float]
    stop: StopRequest = field(default_factory=StopRequest)
    pacer: Pacer = field(default_factory=Unpaced)
    watchdog: Watchdog = field(default_factory=lambda: Watchdog(None, StopRequest()))
    violation: Callable[[], str] = str
    inject: Callable[[], None] | None = None


class Runner:
    """One run, from the first tick until the arms are at rest.

    In the physics step that begins at time t: injected faults that are due start or end; cameras
    that are due capture a frame; frames whose latency has elapsed are delivered; trees that are due
    are ticked; spawned and removed arms are taken over; controllers compute; the world steps;
    observers are notified.

    A run can be advanced in portions of any length: the result does not depend on them.

    Args:
        world: The physics.
        arms: The arms of the file.
        feed: Distributes status changes and steps to the observers.
        conditions: Limit, clock, stop request, pacer, watchdog.
    """

    def __init__(self, world: World, arms: Arms, feed: StatusFeed, conditions: Conditions) -> None:
        self._world = world
        self._arms = arms
        self._feed = feed
        self._conditions = conditions
        self._watchdog = conditions.watchdog
        self._inject = conditions.inject
        self._step = 0
        self._last_step = round(conditions.limit.seconds / world.timestep)
        self._error = ""
        self._ending: Ending | None = None
        self._wall_s = 0.0
        self._result: RunResult | None = None
        arms.follow(0, ticked_from=0)

    @property
    def time(self) -> float:
        """Simulated time in seconds."""
        return self._world.time

    @property
    def result(self) -> RunResult | None:
        """Result of the run, None before its end."""
        return self._result

    def views(self) -> tuple[ArmView, ...]:
        """Current state of every arm of the file."""
        return self._arms.views()

    def advance(self, until: float = math.inf) -> None:
        """Make physics steps up to a total number of steps, or to the end of the run.

        Args:
            until: Number of steps since the start of the run.
        """
        began = self._conditions.clock()
        while not self._has_ended() and self._step < until:
            self._make_step(trees=self._ending is None)
        self._wall_s += self._conditions.clock() - began
        if self._has_ended() and self._result is None:
            self._result = self._made_result()

    def break_off(self, *, quietly: bool = False) -> None:
        """End the run at once: trees are halted, arms get no time to come to rest.

        Args:
            quietly: Whether to log nothing about arms that still move.
        """
        if self._result is None:
            if self._ending is None:
                self._begin_to_end(Ending.CLOSED)
            self._result = self._made_result(quietly=quietly)

    def abandon(self) -> None:
        """Halt the trees of a run whose result is not needed; arms get no time to come to rest."""
        if self._ending is None:
            self._begin_to_end(Ending.CLOSED)

    def so_far(self) -> RunResult:
        """Interim result of a run that cannot continue because skill code blocks its thread."""
        if self._ending is None:
            self._ending = Ending.STOPPED if self._conditions.stop.asked else Ending.OVERRUN
        return self._made_result()

    def _has_ended(self) -> bool:
        """Whether the run has ended; starts the shutdown when a reason to end has appeared."""
        if self._ending is None:
            ending = self._reason_to_end()
            if ending is None:
                return False
            self._begin_to_end(ending)
        return (
            self._ending in (Ending.DIVERGED, Ending.ERROR)
            or self._arms.at_rest
            or self._step >= self._last_step
            or self._conditions.stop.urgent
        )

    def _reason_to_end(self) -> Ending | None:
        if self._watchdog.overrun and not self._conditions.stop.asked:
            return Ending.OVERRUN
        if self._conditions.violation():
            return Ending.INVARIANT
        if self._arms.ended:
            return Ending.FINISHED
        if self._conditions.stop.asked:
            return Ending.STOPPED
        return self._conditions.limit.ending if self._step >= self._last_step else None

    def _begin_to_end(self, ending: Ending) -> None:
        """Halt the trees and start stopping the arms, which get `STOPPING_S` for it."""
        self._ending = ending
        self._last_step = self._step + round(STOPPING_S / self._world.timestep)
        try:
            with self._watchdog:
                self._arms.halt(self.time)
        except RAISED_BY_SKILLS as error:
            _log.exception("the arms could not be halted")
            self._error = self._error or f"{type(error).__name__}: {error}"
            self._ending = Ending.ERROR
        self._feed.after_ticks(self)

    def _made_result(self, *, quietly: bool = False) -> RunResult:
        broken = self._ending in (Ending.DIVERGED, Ending.ERROR)
        at_rest = not broken and self._arms.at_rest
        if not (at_rest or quietly):
            _log.warning("the run ended with an arm still moving")
        return RunResult(
            ending=self._verdict(),
            sim_time_s=self.time,
            wall_time_s=self._wall_s,
            arms=self._arms.results(),
            at_rest=at_rest,
            error="; ".join(
                filter(None, (self._watchdog.overrun, self._error, self._conditions.violation()))
            ),
        )

    def _verdict(self) -> Ending:
        """Ending to report: cleanup code that does not return turns an orderly end into OVERRUN."""
        ending = self._ending or Ending.CLOSED
        is_due = self._watchdog.overrun and ending not in (Ending.STOPPED, Ending.DIVERGED)
        return Ending.OVERRUN if is_due else ending

    def _make_step(self, *, trees: bool) -> None:
        """Make one physics step with everything that is due in it."""
        time = self._world.time
        try:
            if self._inject is not None:
                self._inject()
            if trees and self._arms.due(self._step, time):
                self._capture_and_tick(time)
            if self._arms.controls(self._step):
                with self._watchdog:
                    self._arms.control(self._step, time)
            self._world.step()
        except DivergenceError as error:
            self._break(Ending.DIVERGED, str(error))
            return
        except Overrun:  # raised after the skill had returned; the run ends before the next step
            return
        except Exception as error:  # noqa: BLE001 - the record is written whatever broke the run
            _log.exception("the run failed at %.3f s", time)
            self._break(Ending.ERROR, f"{type(error).__name__}: {error}")
            return
        self._step += 1
        time = self._world.time
        self._feed.after_step(time)
        self._conditions.pacer.pace(time)

    def _capture_and_tick(self, time: float) -> None:
        with self._watchdog:
            self._arms.capture(time)
            self._arms.deliver(time)
            self._world.look_for_passengers()
            ticked = self._arms.tick(self._step, time)
            if ticked:
                self._arms.follow(self._step, ticked_from=self._step + 1)
        if ticked:
            self._feed.after_ticks(self)

    def _break(self, ending: Ending, error: str) -> None:
        self._error = error
        if self._ending is None:
            self._begin_to_end(ending)
        self._ending = ending
