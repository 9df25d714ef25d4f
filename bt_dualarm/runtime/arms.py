"""The runtimes of the arms that are in the world, kept in step with arms that come and go."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from types import MappingProxyType

from bt_dualarm.runtime.arm_runtime import ArmParts, ArmRuntime
from bt_dualarm.runtime.lives import Lives
from bt_dualarm.runtime.outcome import STRICT, Leniency, Outcome
from bt_dualarm.runtime.parts import ArmView, SteppedWorld
from bt_dualarm.runtime.result import ArmResult
from bt_dualarm.runtime.schedule import exact
from bt_dualarm.world.weak_callback import weakly


class Arms:
    """Every arm of the file: not in the world yet, in it, or gone again.

    Args:
        declared: Robot of each arm of the file, by the arm's name; its order is the order in
            which arms act, whatever the order in which they were spawned.
        equip: Maker of what an arm consists of, once it is in the world.
        world: World that says which arms are in it.
        leniency: What the file forgives an arm, by its name; nothing unless said otherwise.
    """

    def __init__(
        self,
        declared: Mapping[str, str],
        equip: Callable[[str], ArmParts],
        world: SteppedWorld,
        leniency: Mapping[str, Leniency] = MappingProxyType({}),
    ) -> None:
        self._declared = declared
        self._equip = equip
        self._world = world
        self._timestep = exact(world.timestep)
        self._lives = {
            name: Lives(name, robot, leniency.get(name, STRICT)) for name, robot in declared.items()
        }
        self.present: tuple[ArmRuntime, ...] = ()
        world.before_removal.append(weakly(self._part_with))

    @property
    def ended(self) -> bool:
        """No tree of an arm in the world is running."""
        # Asked at each step, as the two below: a generator costs more than its answer.
        for arm in self.present:  # noqa: SIM110 - see above
            if arm.outcome is None:
                return False
        return True

    @property
    def at_rest(self) -> bool:
        """Every arm in the world stands still."""
        return all(arm.at_rest for arm in self.present)

    def follow(self, step: int, ticked_from: int) -> None:
        """Begin the life of arms that have come.

        Args:
            step: The physics step that is being made.
            ticked_from: The one in which an arm that has come is ticked first.
        """
        if len(self._world.arms) == len(self.present):
            return
        here = {arm.name: arm for arm in self.present}
        for name in self._declared:
            if name in self._world.arms and name not in here:
                here[name] = ArmRuntime(
                    name,
                    self._equip(name),
                    self._timestep,
                    held_from=step,
                    ticked_from=ticked_from,
                )
                self._lives[name].begin(here[name])
        self.present = tuple(here[name] for name in self._declared if name in here)

    def _part_with(self, name: str) -> None:
        """End the life of an arm that is about to be taken away, while it is still there.

        So whatever its leaves clean up finds the arm as it was; nobody acts on it afterwards.
        """
        leaving = [arm for arm in self.present if arm.name == name]
        self.present = tuple(arm for arm in self.present if arm.name != name)
        for arm in leaving:
            arm.leave(self._world.time)

    def due(self, step: int, time: float) -> bool:
        """Whether a camera or a tree of any arm has something to do; it costs little to ask."""
        for arm in self.present:  # noqa: SIM110 - see `ended`
            if arm.outcome is None and arm.due(step, time):
                return True
        return False

    def controls(self, step: int) -> bool:
        """Whether a controller of any arm is due."""
        for arm in self.present:  # noqa: SIM110 - see `ended`
            if step >= arm.controlled_next:
                return True
        return False

    def capture(self, time: float) -> None:
        """Every camera that is due takes a picture."""
        for arm in self.present:
            arm.capture(time)

    def deliver(self, time: float) -> None:
        """Every picture whose latency is over reaches those who listen."""
        for arm in self.present:
            arm.deliver(time)

    def tick(self, step: int, time: float) -> bool:
        """Tick every tree that is due; whether there was one."""
        ticked = False
        for arm in self.present:
            ticked = arm.tick(step, time) or ticked
        return ticked

    def control(self, step: int, time: float) -> None:
        """Every controller that is due computes."""
        for arm in self.present:
            arm.control(step, time)

    def halt(self, time: float) -> None:
        """End every tree and begin to stop every arm."""
        with ExitStack() as all_of_it:  # also where some of it raises
            for arm in reversed(self.present):
                all_of_it.callback(arm.stop)
                all_of_it.callback(arm.halt, Outcome.UNFINISHED, time)

    def views(self) -> tuple[ArmView, ...]:
        """All arms of the file as they stand now."""
        return tuple(self.view(name) for name in self._declared)

    def view(self, name: str) -> ArmView:
        """One arm of the file as it stands now; of one that is gone, its last moment."""
        return self._lives[name].view()

    def results(self) -> dict[str, ArmResult]:
        """What all arms of the file did, by name."""
        return {name: lives.result() for name, lives in self._lives.items()}
