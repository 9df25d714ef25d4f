"""Status changes on their way from the trees to those who look on."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from bt_dualarm.runtime.parts import Observer, RunView
from bt_dualarm.tree.report import StatusChange

_log = logging.getLogger(__name__)


class Watch:
    """Holds the changes of a tick back until all trees are ticked, then tells every observer.

    An observer that raises (a display whose terminal is gone) is dropped: the arms do not
    depend on who is looking.

    Args:
        observers: Those who look on, told in this order.
    """

    def __init__(self, observers: Sequence[Observer] = ()) -> None:
        self.observers = list(observers)
        self._changes: list[StatusChange] = []

    def note(self, change: StatusChange) -> None:
        """Take a change up; this is what a tree calls in the middle of its tick."""
        self._changes.append(change)

    def after_ticks(self, run: RunView) -> None:
        """Tell the changes, then that trees were ticked."""
        changes, self._changes = self._changes, []
        for observer in tuple(self.observers):
            try:
                for change in changes:
                    observer.on_event(change)
                observer.after_ticks(run)
            except Exception as error:  # noqa: BLE001 - see `_drop`
                self._drop(observer, error)

    def after_step(self, time: float) -> None:
        """Tell that the physics advanced."""
        for observer in self.observers:
            try:
                observer.after_step(time)
            except Exception as error:  # noqa: BLE001 - see `_drop`
                self._drop(observer, error)

    def _drop(self, observer: Observer, error: Exception) -> None:
        """Let no observer end a run."""
        self.observers = [other for other in self.observers if other is not observer]
        _log.warning("%s stopped looking on: %r", type(observer).__name__, error)
