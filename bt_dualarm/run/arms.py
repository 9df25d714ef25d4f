"""The stations of the arms that are in the world, kept in step with arms that come and go."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from bt_dualarm.run.outcome import ArmResult, Outcome
from bt_dualarm.run.parts import ArmView, SteppedWorld
from bt_dualarm.run.schedule import exact
from bt_dualarm.run.station import Equipment, Station


class Arms:
    """Every arm of the file: not in the world yet, in it, or gone again.

    Args:
        declared: Robot of each arm of the file, by the arm's name; its order is the order in
            which arms act, whatever the order in which they were spawned.
        equip: Makes what an arm consists of, once it is in the world.
        world: Says which arms are in it.
    """

    def __init__(
        self, declared: Mapping[str, str], equip: Callable[[str], Equipment], world: SteppedWorld
    ) -> None:
        self._declared = declared
        self._equip = equip
        self._world = world
        self._timestep = exact(world.timestep)
        self._lives: dict[str, list[Station]] = {name: [] for name in declared}
        self.present: tuple[Station, ...] = ()

    @property
    def ended(self) -> bool:
        """No tree of an arm in the world is running."""
        return all(station.outcome is not None for station in self.present)

    @property
    def at_rest(self) -> bool:
        """Every arm in the world stands still."""
        return all(station.at_rest for station in self.present)

    def follow(self, step: int, ticked_from: int) -> None:
        """Begin the life of arms that have come, end that of arms that have gone.

        Args:
            step: The physics step that is being made.
            ticked_from: The one in which an arm that has come is ticked first.
        """
        now = self._world.arms
        if len(now) == len(self.present) and all(station.name in now for station in self.present):
            return
        time = self._world.time
        for station in self.present:
            if station.name not in now:
                station.halt(Outcome.REMOVED, time)
        here = {station.name: station for station in self.present if station.name in now}
        for name in self._declared:
            if name in now and name not in here:
                here[name] = Station(
                    name,
                    self._equip(name),
                    self._timestep,
                    held_from=step,
                    ticked_from=ticked_from,
                )
                self._lives[name].append(here[name])
        self.present = tuple(here[name] for name in self._declared if name in here)

    def capture(self, world: Any, time: float) -> None:
        """Every camera that is due takes a picture."""
        for station in self.present:
            station.capture(world, time)

    def deliver(self, time: float) -> None:
        """Every picture whose latency is over reaches those who listen."""
        for station in self.present:
            station.deliver(time)

    def tick(self, step: int, time: float) -> bool:
        """Tick every tree that is due; whether there was one."""
        ticked = False
        for station in self.present:
            ticked = station.tick(step, time) or ticked
        return ticked

    def control(self, step: int, time: float) -> None:
        """Every controller that is due computes."""
        for station in self.present:
            station.control(step, time)

    def halt(self, time: float) -> None:
        """End every tree and begin to stop every arm."""
        for station in self.present:
            station.halt(Outcome.UNFINISHED, time)
            station.stop()

    def views(self) -> tuple[ArmView, ...]:
        """All arms of the file as they stand now."""
        return tuple(
            lives[-1].view() if lives else ArmView(name, self._declared[name], None, None)
            for name, lives in self._lives.items()
        )

    def results(self) -> tuple[ArmResult, ...]:
        """What all arms of the file did."""
        return tuple(
            _whole([station.result() for station in lives])
            if lives
            else ArmResult(name, self._declared[name], Outcome.NOT_SPAWNED)
            for name, lives in self._lives.items()
        )


def _whole(lives: list[ArmResult]) -> ArmResult:
    """An arm that was removed and spawned again has the outcome of its last life."""
    return replace(
        lives[-1],
        clipped_setpoints=sum(life.clipped_setpoints for life in lives),
        leaves=tuple(leaf for life in lives for leaf in life.leaves),
    )
