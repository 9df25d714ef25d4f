"""Advances cameras, trees, controllers and physics on one simulated clock, in a fixed order."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field

from bt_dualarm.errors import DivergenceError
from bt_dualarm.run.arms import Arms
from bt_dualarm.run.events import Watch
from bt_dualarm.run.outcome import Ending, RunResult
from bt_dualarm.run.pacing import Pacer, Unpaced
from bt_dualarm.run.parts import ArmView, SteppedWorld
from bt_dualarm.run.signals import StopRequest

_log = logging.getLogger(__name__)

STOPPING_S = 5.0
"""Simulated seconds that the arms get to come to rest after the end; a stop takes below 1 s."""


@dataclass(frozen=True)
class Limit:
    """When a run ends that does not end by itself.

    Attributes:
        seconds: Simulated.
        ending: What it means that they are over.
    """

    seconds: float
    ending: Ending = Ending.TIME_LIMIT


@dataclass
class Conditions:
    """What a run depends on besides the world and its arms.

    Attributes:
        limit: When it ends at the latest.
        clock: Seconds on the wall, for the real-time factor only.
        stop: Looked at before every step.
        pacer: Holds simulated time back.
    """

    limit: Limit
    clock: Callable[[], float]
    stop: StopRequest = field(default_factory=StopRequest)
    pacer: Pacer = field(default_factory=Unpaced)


class Runner:
    """One run, from the first tick to arms that stand still.

    In the physics step that begins at time t: cameras that are due take a picture; pictures
    whose latency is over are delivered; trees that are due are ticked; arms that came or went
    are taken up; controllers compute; the world steps; the observers look.

    Args:
        world: The physics.
        arms: The stations of the arms.
        watch: Those who look on.
        conditions: Limit, clock, stop request, pace.
    """

    def __init__(
        self, world: SteppedWorld, arms: Arms, watch: Watch, conditions: Conditions
    ) -> None:
        self._world = world
        self._arms = arms
        self._watch = watch
        self._conditions = conditions
        self._step = 0
        self._error = ""
        self._broken: Ending | None = None

    @property
    def time(self) -> float:
        """Simulated time in seconds."""
        return self._world.time

    def arms(self) -> tuple[ArmView, ...]:
        """All arms of the file as they stand now."""
        return self._arms.views()

    def run(self) -> RunResult:
        """Run to the end, whatever it is, and stop the arms."""
        began = self._conditions.clock()
        self._arms.follow(self._step, ticked_from=self._step)
        ending = self._until_ended()
        self._arms.halt(self.time)
        self._watch.after_ticks(self)
        at_rest = self._until_at_rest()
        return RunResult(
            ending=self._broken or ending,
            sim_time_s=self.time,
            wall_time_s=self._conditions.clock() - began,
            arms=self._arms.results(),
            at_rest=at_rest,
            error=self._error,
        )

    def _until_ended(self) -> Ending:
        """Advance until there is a reason to end."""
        limit, stop = self._conditions.limit, self._conditions.stop
        last = round(limit.seconds / self._world.timestep)
        while not self._arms.ended:
            if stop.asked:
                return Ending.STOPPED
            if self._step >= last:
                return limit.ending
            if not self._advance(trees=True):
                break
        return Ending.FINISHED

    def _until_at_rest(self) -> bool:
        """Advance physics and controllers until every arm stands still; whether they do."""
        last = self._step + round(STOPPING_S / self._world.timestep)
        while self._broken is None and not self._arms.at_rest and self._step < last:
            if self._conditions.stop.urgent:
                break
            self._advance(trees=False)
        at_rest = self._broken is None and self._arms.at_rest
        if not at_rest:
            _log.warning("the run ended with an arm still moving")
        return at_rest

    def _advance(self, *, trees: bool) -> bool:
        """One physics step and all that is due in it; whether the run can go on."""
        time = self._world.time
        try:
            if trees:
                self._see_and_tick(time)
            self._arms.control(self._step, time)
            self._world.step()
        except DivergenceError as error:
            return self._break(Ending.DIVERGED, str(error))
        except Exception as error:  # noqa: BLE001 - the record is written, whatever broke the run
            _log.exception("the run broke at %.3f s", time)
            return self._break(Ending.ERROR, f"{type(error).__name__}: {error}")
        self._step += 1
        self._watch.after_step(self._world.time)
        self._conditions.pacer.pace(self._world.time)
        return True

    def _see_and_tick(self, time: float) -> None:
        self._arms.capture(self._world, time)
        self._arms.deliver(time)
        if self._arms.tick(self._step, time):
            self._arms.follow(self._step, ticked_from=self._step + 1)
            self._watch.after_ticks(self)

    def _break(self, ending: Ending, error: str) -> bool:
        self._broken, self._error = ending, error
        return False
