"""One run of one file, from the assembled world to its result."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from bt_dualarm.registry import Registry
from bt_dualarm.run.assembly import assemble
from bt_dualarm.run.events import Watch
from bt_dualarm.run.outcome import Ending, RunResult
from bt_dualarm.run.pacing import Pacer, Unpaced
from bt_dualarm.run.parts import Observer
from bt_dualarm.run.record import Facts, Recorder, prepare_folder
from bt_dualarm.run.runner import Conditions, Limit, Runner
from bt_dualarm.run.signals import StopRequest
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.world.rendering import RendererKind


@dataclass(frozen=True)
class Wishes:
    """What the command line says over the file.

    Attributes:
        seed: Of everything random; None takes the file's.
        duration: Simulated seconds after which the run ends; None for no end of its own.
        renderer: None takes the file's.
    """

    seed: int | None = None
    duration: float | None = None
    renderer: RendererKind | None = None


class Session:
    """A file made ready to be run once; gives back what it holds at the end of ``with``.

    Args:
        file: Checked with the skills of ``registry``.
        registry: The installed skills.
        wishes: What overrides the file.

    Raises:
        CatalogueError: A robot or scene is unknown or broken.
        RendererError: The renderer asked for cannot work here.
        WorldError: The parts do not compile to one world.
    """

    def __init__(self, file: TreeFile, registry: Registry, wishes: Wishes | None = None) -> None:
        wishes = wishes or Wishes()
        self._watch = Watch()
        self._limit = _limit(file.world.time_limit, wishes.duration)
        self.assembly = assemble(
            file, registry, self._watch.note, seed=wishes.seed, renderer=wishes.renderer
        )

    def __enter__(self) -> Session:
        """Nothing is taken before it is needed."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Give the renderer back, end the process that plans."""
        self.assembly.planning.close()
        if self.assembly.renderer is not None:
            self.assembly.renderer.close()

    @property
    def renderer_name(self) -> str | None:
        """``gl``, ``ray``, or None where no arm has a camera."""
        return None if self.assembly.renderer is None else self.assembly.renderer.name

    def recorder(self, folder: Path) -> Recorder:
        """An observer that writes the record of this run.

        Raises:
            RecordError: The folder cannot be used.
        """
        facts = Facts(self.assembly.seed, self.renderer_name)
        return Recorder(prepare_folder(folder), self.assembly.world, facts, self.assembly.series)

    def run(
        self,
        observers: Sequence[Observer],
        clock: Callable[[], float],
        stop: StopRequest | None = None,
        pacer: Pacer | None = None,
    ) -> RunResult:
        """Run to the end, whatever it is.

        Args:
            observers: Look on.
            clock: Seconds on the wall, for the real-time factor only.
            stop: Asks for an early end.
            pacer: Holds simulated time back.
        """
        self._watch.observers.extend(observers)
        conditions = Conditions(self._limit, clock, stop or StopRequest(), pacer or Unpaced())
        assembly = self.assembly
        return Runner(assembly.world, assembly.arms, self._watch, conditions).run()


def _limit(time_limit: float, duration: float | None) -> Limit:
    """Whichever comes first."""
    if duration is not None and duration <= time_limit:
        return Limit(duration, Ending.DURATION)
    return Limit(time_limit, Ending.TIME_LIMIT)
