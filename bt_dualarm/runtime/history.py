"""The history of a run, written as it goes: all that is needed to see it again and ask it why."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Final, Protocol

from bt_dualarm.recording.block import Block
from bt_dualarm.recording.history_file import HistoryWriter
from bt_dualarm.recording.model_pieces import ModelWriter
from bt_dualarm.runtime.history_frames import FramedController, FramedWorld, Frames
from bt_dualarm.runtime.notes import GuardedArm, Held, Notes
from bt_dualarm.runtime.parts import IdleObserver

_GUARD_EVERY: Final = 5
"""States from one look at the guards' counts to the next: a tenth of a second."""

_log = logging.getLogger(__name__)


class HistoryController(FramedController, GuardedArm, Protocol):
    """All that is read of an arm's controller."""


class HistoryArm(Protocol):
    """What is read of an arm that is present."""

    name: str

    @property
    def controller(self) -> HistoryController:
        """Controller of the arm."""


class HistoryWorld(FramedWorld, Protocol):
    """All that is read of the world."""

    @property
    def attachments(self) -> Iterable[Held]:
        """What arms hold, or are believed to hold."""


class History(IdleObserver):
    """An observer that writes a block for each simulated second, and one for each compiled model.

    The file begins with the first step: of a run that never began there is none.
    What it keeps in memory is one second. Where it cannot write, the run goes on without it, and
    the end of the record says so.

    Args:
        path: File to write.
        world: The world.
        arms: Function that gives the arms that are present.
        notes: Notes that others make; taken second by second.
        start: Maker of the first block.
    """

    def __init__(
        self,
        path: Path,
        world: HistoryWorld,
        arms: Callable[[], Sequence[HistoryArm]],
        notes: Notes,
        start: Callable[[], Block],
    ) -> None:
        self._writer = HistoryWriter(path)
        self._world, self._arms, self._notes = world, arms, notes
        self._failure: Exception | None = None
        self._models = ModelWriter()
        self._frames = Frames(world)
        self._kept = 0
        self._begun = False
        self._waiting: deque[Block] = deque()
        self._add(start, self._model)

    def after_step(self, time: float) -> None:  # noqa: ARG002 - the world knows it, too
        """Take up the step; write what is full."""
        if not self._begun:
            self._begun = True
            self._add()
        if self._failure is not None:
            self._notes.take()
            return
        if self._frames.outdated:
            self._flush()
            self._add(self._model)
        if self._frames.after_step():
            self._keep()
            if self._frames.full:
                self._flush()

    def _keep(self) -> None:
        arms = self._arms()
        self._frames.keep((arm.name, arm.controller) for arm in arms)
        self._notes.of_holding(self._world.attachments)
        self._kept += 1
        if self._kept % _GUARD_EVERY == 0:
            for arm in arms:
                self._notes.of_guard(arm.name, arm.controller)

    def flush(self) -> None:
        """Write what has been gathered; to be called between two steps."""
        if self._begun:
            self._flush()

    def finish(self, sha256: str) -> None:
        """Write what is left, and the end.

        Args:
            sha256: Hash of the states of the run, in hexadecimal.

        Raises:
            OSError: It could not be written, or the disk is full now.
        """
        self._begun = True
        self._flush()
        self._add(lambda: Block("end", {"state_sha256": sha256}))
        if isinstance(self._failure, OSError):
            raise self._failure
        if self._failure is not None:
            raise ValueError(str(self._failure)) from self._failure
        self._writer.finish()

    def close(self) -> None:
        """Let go of the file."""
        self._writer.close()

    def _flush(self) -> None:
        self._add(lambda: self._frames.block(self._notes.take()))

    def _add(self, *makers: Callable[[], Block]) -> None:
        """Make blocks; write them and those that wait, once the run has begun."""
        if self._failure is not None:
            return
        try:
            self._waiting.extend(make() for make in makers)
            while self._begun and self._waiting:
                self._writer.add(self._waiting.popleft())
        except (OSError, ValueError) as error:
            self._failure = error
            self._waiting.clear()
            _log.warning("the history is not kept any further: %s", error)

    def _model(self) -> Block:
        """The compiled model, as far as it is new."""
        return self._models.block(self._world.model, self._world.generation)
