"""Looks at a tree file while it is run: checks it when it is saved, and has it taken up."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
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
    bad the problems are logged, and the old trees go on. So it is told that the code of a skill was
    saved, which is not taken up.

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
        self._stamps = _stamps(self._parts())
        self._code = _stamps(_code_of(self._file, registry))
        self._lock, self._end = Lock(), Event()
        self._ready: TreeFile | None = None
        self._problems = ""
        self._told: list[str] = []
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
        self._look_at_code()
        stamps = _stamps(self._parts())
        if stamps == self._stamps:
            return
        self._stamps = stamps
        ready, problems = None, ""
        try:
            ready = self._checked()
            self._stamps = _stamps({*ready.texts, str(self._path)})
        except DualArmError as error:
            problems = str(error)
        with self._lock:
            self._ready, self._problems = ready, problems

    def after_step(self, time: float) -> None:  # noqa: ARG002 - the run knows it, too
        """Take up what there is."""
        self.take()

    def take(self) -> bool:
        """Take up what is good, tell what is not; whether there was anything."""
        if self._ready is None and not self._problems and not self._told:
            return False
        with self._lock:
            ready, problems, told = self._ready, self._problems, self._told
            self._ready, self._problems, self._told = None, "", []
        for file in told:
            _log.warning("%s was saved: code of skills takes effect at the next run", file)
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

    def _look_at_code(self) -> None:
        """Note which files of skills that the trees name have been saved since the last time."""
        code = _stamps(_code_of(self._file, self._registry))
        saved = [file for file in code if self._code.get(file, code[file]) != code[file]]
        self._code |= code
        with self._lock:
            self._told += saved

    def _parts(self) -> set[str]:
        return {*self._file.texts, str(self._path)}

    def _checked(self) -> TreeFile:
        checked = check(self._path, self._registry.kinds, self._params, build=False)
        return checked.runnable()

    def _look_on(self) -> None:
        while not self._end.wait(_EVERY_S):
            self.look()


def _code_of(file: TreeFile, registry: Registry) -> set[str]:
    """Files of the skills that the trees of a file name."""
    kinds = {node.kind for arm in file.arms.values() for node in arm.tree.walk()}
    origins = {registry.kinds[kind].origin for kind in kinds & registry.kinds.keys()}
    return {origin for origin in origins if origin.endswith(".py")}


def _stamps(files: Iterable[str]) -> dict[str, tuple[int, int]]:
    """When files were saved, and how large they are."""
    found = {}
    for file in sorted(files):
        try:
            state = Path(file).stat()
            found[file] = state.st_mtime_ns, state.st_size
        except OSError:  # an editor is about to put another one there
            found[file] = 0, 0
    return found
