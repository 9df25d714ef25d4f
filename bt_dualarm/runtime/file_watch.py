"""Looks at a tree file while it is run: checks it when it is saved, and has it taken up."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path
from threading import Event, Lock, Thread
from types import TracebackType
from typing import Final

from bt_dualarm.errors import DualArmError, RunError
from bt_dualarm.preflight.check import check
from bt_dualarm.runtime.editing import take_up
from bt_dualarm.runtime.parts import IdleObserver
from bt_dualarm.runtime.run import Run
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import TreeFile

_EVERY_S: Final = 0.3
"""Seconds on the wall between two looks at the file."""

_log = logging.getLogger(__name__)


class FileWatch(IdleObserver):
    """An observer that changes a run's trees when their file is saved.

    The file is checked in another thread; what is good is taken up between two steps. Of what is
    bad the problems are logged, and the old trees go on.

    Args:
        run: The run.
        path: Path of its tree file.
        registry: Skills that it is checked with.
        params: Values of its parameters, by name.

    Raises:
        SpecError: The file has errors.
    """

    def __init__(
        self, run: Run, path: Path, registry: Registry, params: Mapping[str, object]
    ) -> None:
        self._run, self._path, self._registry, self._params = run, path, registry, params
        self._file = self._checked()
        self._stamps = _stamps(self._file, path)
        self._lock, self._end = Lock(), Event()
        self._ready: TreeFile | None = None
        self._problems = ""
        self._thread = Thread(target=self._look_on, name="watch", daemon=True)

    def __enter__(self) -> FileWatch:
        self._run.watch(self)
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Look no more."""
        self._end.set()
        self._thread.join(5.0)

    def look(self) -> None:
        """Check the file if it, or what it includes, has been saved since the last time."""
        stamps = _stamps(self._file, self._path)
        if stamps == self._stamps:
            return
        self._stamps = stamps
        ready, problems = None, ""
        try:
            ready = self._checked()
            self._stamps = _stamps(ready, self._path)
        except DualArmError as error:
            problems = str(error)
        with self._lock:
            self._ready, self._problems = ready, problems

    def after_step(self, time: float) -> None:  # noqa: ARG002 - the run knows it, too
        """Take up what there is."""
        self.take()

    def take(self) -> bool:
        """Take up what is good, tell what is not; whether there was anything."""
        if self._ready is None and not self._problems:
            return False
        with self._lock:
            ready, problems = self._ready, self._problems
            self._ready, self._problems = None, ""
        if problems:
            said = "%s was saved with errors; the run goes on as it was\n%s"
            _log.warning(said, self._path.name, problems)
        if ready is not None:
            self._take_up(ready)
        return True

    def _take_up(self, ready: TreeFile) -> None:
        try:
            said = take_up(self._run, self._file, ready)
        except RunError as error:
            _log.warning("%s was saved, and is not taken up: %s", self._path.name, error)
            return
        self._file = ready
        for sentence in said:
            _log.info("at %.3f s: %s", self._run.time, sentence)

    def _checked(self) -> TreeFile:
        checked = check(self._path, self._registry.kinds, self._params, build=False)
        return checked.runnable()

    def _look_on(self) -> None:
        while not self._end.wait(_EVERY_S):
            self.look()


def _stamps(file: TreeFile, path: Path) -> dict[str, tuple[int, int]]:
    """When the files were saved that a tree consists of, and how large they are."""
    found = {}
    for part in {*map(Path, file.texts), path}:
        try:
            state = part.stat()
            found[str(part)] = state.st_mtime_ns, state.st_size
        except OSError:  # an editor is about to put another one there
            found[str(part)] = 0, 0
    return found
