"""One run of one tree, from the assembled world to its result, in steps or in one go."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction

from bt_dualarm.errors import DualArmError, RunError
from bt_dualarm.runtime.assembly import Assembly
from bt_dualarm.runtime.compiling import compile_kernels
from bt_dualarm.runtime.handles import ArmHandle, TreeHandle
from bt_dualarm.runtime.named import Named
from bt_dualarm.runtime.options import RunOptions, checked_seconds
from bt_dualarm.runtime.parts import ArmView, Observer
from bt_dualarm.runtime.prepared import Kept, prepare
from bt_dualarm.runtime.result import RunResult
from bt_dualarm.runtime.schedule import exact
from bt_dualarm.runtime.signals import StopRequest
from bt_dualarm.runtime.watchdog import Watchdog
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.problems import Problem
from bt_dualarm.world.world import World


class Run:
    """A tree that is run once, in steps or in one go; at first nothing has moved.

    It belongs in a ``with`` block, whose end closes it: a run that is not over then is broken off
    where it stands, and the record is written, if there is to be one. What it has come to can
    still be looked at afterwards.

    Args:
        file: The tree file, checked with the skills of ``registry``.
        registry: The skills.
        options: What overrides the file.
        stop: Request to end early, which a signal or another thread may make.
        warnings: What the check of the file warned of.

    Attributes:
        warnings: What the check of the file warned of.

    Raises:
        CatalogueError: A robot or scene is unknown or broken.
        RendererError: The renderer asked for cannot work here.
        WorldError: The parts do not compile to one world, or two of them are in one place.
        RecordError: The folder of the record cannot be used.
    """

    def __init__(
        self,
        file: TreeFile,
        registry: Registry,
        options: RunOptions | None = None,
        *,
        stop: StopRequest | None = None,
        warnings: Sequence[Problem] = (),
    ) -> None:
        self.warnings = tuple(warnings)
        self._stop = stop or StopRequest()
        compile_kernels()  # what it says, once on a machine, is not of this run
        self._parts = prepare(file, registry, options or RunOptions(), self._stop)
        self._asked = Fraction(0)
        self._is_busy = False
        self._is_recorded = self._parts.recorder is None
        self._result: RunResult | None = None
        world, arms = self.world, self.assembly.arms
        self._arms = {name: ArmHandle(name, world, arms) for name in file.arms}
        self._trees = {name: TreeHandle(name, arm.tree, arms) for name, arm in file.arms.items()}

    @property
    def name(self) -> str:
        """Name of the tree file."""
        return self._parts.name

    @property
    def assembly(self) -> Assembly:
        """What the run consists of; to be looked at, not to be advanced."""
        return self._parts.assembly

    @property
    def time(self) -> float:
        """Simulated time in seconds."""
        return self._parts.runner.time

    @property
    def done(self) -> bool:
        """Whether the run is over: every tree has ended and the arms stand still, or it broke."""
        return self._result is not None

    @property
    def result(self) -> RunResult:
        """What the run did.

        Raises:
            RunError: It is not over.
        """
        if self._result is None:
            raise RunError(f"the run is not over: it is at {self.time:.3f} s of simulated time")
        return self._result

    @property
    def world(self) -> World:
        """The world as it is now, to be looked at; what is changed in it is part of the run."""
        return self.assembly.world

    @property
    def arms(self) -> Mapping[str, ArmHandle]:
        """The arms of the file as they are now, by name."""
        return Named("arm", self._arms)

    @property
    def trees(self) -> Mapping[str, TreeHandle]:
        """The arms' trees as they are now, by the arm's name."""
        return Named("arm", self._trees)

    @property
    def seed(self) -> int:
        """Seed of everything random."""
        return self.assembly.seed

    @property
    def renderer(self) -> str | None:
        """``gl``, ``ray``, or None where no arm has a camera."""
        return self._parts.renderer

    @property
    def renderer_message(self) -> str:
        """One sentence on which renderer is used and why; empty without cameras."""
        return self.assembly.message

    def step(self, seconds: float | Fraction) -> None:
        """Advance by so much simulated time, or to the end of the run if that comes first.

        Whole steps of physics are made, as many as fit into the time asked for in all: the run is
        the same to the last bit, whatever parts it is advanced in.

        Args:
            seconds: Simulated seconds, above 0.

        Raises:
            RunError: The run is over or closed, or ``seconds`` is no number above 0.
        """
        checked_seconds(seconds, "step")
        if self._result is not None:
            raise RunError(f"the run ended at {self.time:.3f} s: there is nothing left to step")
        # What is too fine for a decimal number must count, too, or it could be asked for forever.
        asked = self._asked + (exact(seconds) or Fraction(seconds))
        self._advance(asked // exact(self.world.timestep))
        self._asked = asked

    def finish(self) -> RunResult:
        """Run to the end, whatever it is; a run that is over stays as it is."""
        if self._result is None:
            self._advance(math.inf)
        return self.result

    def stop(self) -> None:
        """Ask the run to end: trees are halted, arms brought to rest; asked again, at once.

        It may be called from other threads, and takes effect while the run is advanced.
        """
        self._stop.ask()

    def watch(self, observer: Observer) -> None:
        """Let somebody look on from now on, after those who do already."""
        self._parts.watch.observers.append(observer)

    @property
    def kept(self) -> Kept | None:
        """What of it is on the disk while it goes on, None without a record."""
        return self._parts.kept

    @property
    def watchdog(self) -> Watchdog:
        """What looks after the time that skills take."""
        return self._parts.watchdog

    def spawn_all(self) -> None:
        """Bring every arm that the file declares into the world, before the first step."""
        for name in self._arms.keys() - self.world.arms.keys():
            self.world.spawn_arm(name)
        self.assembly.arms.follow(0, ticked_from=0)

    def views(self) -> tuple[ArmView, ...]:
        """All arms of the file as they stand now, as displays show them."""
        return self._parts.runner.views()

    def write_record(self) -> None:
        """Write the record, if one was asked for; else the end of the ``with`` block does it.

        Raises:
            RunError: The run is not over.
            RecordError: The disk is full, or the folder is gone.
        """
        result, recorder = self.result, self._parts.recorder
        if recorder is not None and not self._is_recorded:
            self._is_recorded = True
            recorder.write(result, self._stop)

    def close(self) -> None:
        """Break off what is not over, write the record, give back what the run holds.

        Raises:
            RecordError: The disk is full, or the folder is gone.
        """
        with self._parts.resources, self._parts.at_work():
            if self._result is None:
                self._parts.runner.break_off()
                self._take_result()
            self.write_record()

    def __enter__(self) -> Run:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        """Close it; what went wrong in the block comes before what goes wrong here."""
        try:
            self.close()
        except DualArmError as another:
            if error is None:
                raise
            error.add_note(str(another))

    def __repr__(self) -> str:
        arms = ", ".join(
            f"{arm.name} {arm.outcome or ('RUNNING' if arm.is_present else 'not in the world')}"
            for arm in self._arms.values()
        )
        return f"<Run {self.name} {'over' if self.done else 'at'} {self.time:.3f} s: {arms}>"

    def _advance(self, until: float) -> None:
        """Make physics steps until so many have been made in all."""
        if self._is_busy:
            raise RunError("the run is being advanced already: its own parts cannot do that")
        self._is_busy = True
        try:
            with self._parts.at_work():
                self._parts.runner.advance(until)
        finally:
            self._is_busy = False
        self._take_result()

    def _take_result(self) -> None:
        result = self._parts.runner.result
        if result is not None:
            self._result = self._parts.completed(result)
