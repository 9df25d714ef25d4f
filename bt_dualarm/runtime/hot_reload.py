"""Hot reload: trees of a file that is edited during its run are replaced between two steps."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from threading import Event, Lock, Thread
from types import TracebackType
from typing import Final

from bt_dualarm.core.errors import DualArmError, RunError
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.runtime.file_check import check
from bt_dualarm.runtime.history import tree_facts
from bt_dualarm.runtime.run import Run
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.node_types import NodeSpec


def apply_edit(run: Run, before: TreeFile, now: TreeFile) -> list[str]:
    """Replace the trees of a run by those of an edited file, between two steps.

    Leaves with the same path, node type and ports keep running; other running leaves are halted and
    restarted. Trees that have ended are not changed.

    Args:
        run: The run.
        before: The file as it was last applied.
        now: The edited file, checked with the same skills.

    Returns:
        A sentence on each changed tree.

    Raises:
        RunError: The edit changes more than trees; nothing is applied.
    """
    other = [*_changes_besides_trees(before, now)]
    if other:
        raise RunError(f"{', '.join(other)}: during a run, only trees can be changed; restart it")
    present = {arm.name: arm for arm in run.assembly.arms.present}
    messages = []
    for name, arm in now.arms.items():
        if same(before.arms[name].tree, arm.tree):
            continue
        run.assembly.trees[name] = arm.tree
        if name not in present:
            messages.append(f"{name}: its initial tree has changed")
            continue
        with run.watchdog:
            replaced = present[name].change(arm.tree, run.time)
        messages.append(f"{name}: {'its tree has changed' if replaced else 'its tree has ended'}")
        if replaced and run.open_record is not None:
            run.open_record.trace.of_edit(name, tree_facts(arm.tree))
    return messages


def same(one: NodeSpec, other: NodeSpec) -> bool:
    """Whether two trees have equal node types, names, ports and children."""
    alike = (one.kind, one.name, one.ports, one.slots) == (
        other.kind,
        other.name,
        other.ports,
        other.slots,
    )
    return (
        alike
        and len(one.children) == len(other.children)
        and all(map(same, one.children, other.children))
    )


def _changes_besides_trees(before: TreeFile, now: TreeFile) -> Iterator[str]:
    """Yields the paths of the changes outside of trees."""
    if before.world != now.world:
        yield "world"
    if before.objects != now.objects:
        yield "objects"
    if before.cell != now.cell:
        yield "cell"
    if [*before.arms] != [*now.arms]:
        yield "arms"
        return
    for name, arm in now.arms.items():
        if before.arms[name].model_copy(update={"tree": arm.tree}) != arm:
            yield f"arms.{name}"


_POLL_S: Final = 0.3
"""Wall-clock seconds between two checks of the file's time stamp."""

_log = logging.getLogger(__name__)


class FileWatch(IdleObserver):
    """Observer that replaces a run's trees when their file is saved.

    The file is checked in a separate thread and applied between two steps. If it has errors, they
    are logged and the old trees keep running. A change of skill code is not applied, only logged.

    Args:
        run: The run.
        path: Path of its tree file.
        registry: Skills to check it with.
        params: Values of its parameters, by name.

    Raises:
        SpecError: The file has errors.
    """

    def __init__(
        self, run: Run, path: Path, registry: Registry, params: Mapping[str, object]
    ) -> None:
        self._run = run
        self._path = path
        self._registry = registry
        self._params = params
        self._file = self._checked()
        self._stamps = _stamps(self._parts())
        self._code = _stamps(_code_of(self._file, registry))
        self._lock = Lock()
        self._end = Event()
        self._ready: TreeFile | None = None
        self._problems = ""
        self._saved_code: list[str] = []
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
        """Stop watching."""
        self._end.set()
        self._thread.join(5.0)

    def look(self) -> None:
        """Check the file if it or an included file has been saved since the last call."""
        self._look_at_code()
        stamps = _stamps(self._parts())
        if stamps == self._stamps:
            return
        self._stamps = stamps
        ready = None
        problems = ""
        try:
            ready = self._checked()
            self._stamps = _stamps({*ready.texts, str(self._path)})
        except DualArmError as error:
            problems = str(error)
        with self._lock:
            self._ready = ready
            self._problems = problems

    def after_step(self, time: float) -> None:  # noqa: ARG002 - the run knows it, too
        """Apply pending changes."""
        self.take()

    def take(self) -> bool:
        """Apply a valid edit, log problems; returns whether there was anything to do."""
        if self._ready is None and not self._problems and not self._saved_code:
            return False
        with self._lock:
            ready = self._ready
            problems = self._problems
            saved_code = self._saved_code
            self._ready = None
            self._problems = ""
            self._saved_code = []
        for file in saved_code:
            _log.warning("%s was saved: skill code takes effect in the next run", file)
        if problems:
            message = "%s was saved with errors; the run continues unchanged\n%s"
            _log.warning(message, self._path.name, problems)
        if ready is not None:
            self._apply(ready)
        return True

    def _apply(self, ready: TreeFile) -> None:
        try:
            messages = apply_edit(self._run, self._file, ready)
        except RunError as error:
            _log.warning("%s was saved, but cannot take effect: %s", self._path.name, error)
            return
        self._file = ready
        for sentence in messages:
            _log.info("at %.3f s: %s", self._run.time, sentence)

    def _look_at_code(self) -> None:
        """Collect the skill files used by the trees that were saved since the last call."""
        code = _stamps(_code_of(self._file, self._registry))
        saved = [file for file in code if self._code.get(file, code[file]) != code[file]]
        self._code |= code
        with self._lock:
            self._saved_code += saved

    def _parts(self) -> set[str]:
        return {*self._file.texts, str(self._path)}

    def _checked(self) -> TreeFile:
        checked = check(self._path, self._registry.kinds, self._params, build=False)
        return checked.runnable()

    def _look_on(self) -> None:
        while not self._end.wait(_POLL_S):
            self.look()


def _code_of(file: TreeFile, registry: Registry) -> set[str]:
    """Files of the skills that the trees of a file use."""
    kinds = {node.kind for arm in file.arms.values() for node in arm.tree.walk()}
    origins = {registry.kinds[kind].origin for kind in kinds & registry.kinds.keys()}
    return {origin for origin in origins if origin.endswith(".py")}


def _stamps(files: Iterable[str]) -> dict[str, tuple[int, int]]:
    """Modification time in ns and size in bytes of each file."""
    found = {}
    for file in sorted(files):
        try:
            state = Path(file).stat()
            found[file] = state.st_mtime_ns, state.st_size
        except OSError:  # an editor is replacing the file
            found[file] = 0, 0
    return found
