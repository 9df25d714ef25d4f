"""Signals while a command has nothing to bring to an end: it ends, with a code and no traceback.

Only what is small is imported here: the handlers stand before all that is heavy is imported.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, Final, TypeAlias

_leave = os._exit  # whatever else is called by that name while skills are imported

_Handler: TypeAlias = Callable[[int, FrameType | None], Any] | signal.Handlers | int | None

_DEFAULTS: Final[dict[signal.Signals, _Handler]] = {
    signal.SIGINT: signal.default_int_handler,
    signal.SIGTERM: signal.SIG_DFL,
    signal.SIGHUP: signal.SIG_DFL,
}
"""The signals, and what comes of them where nobody has said otherwise, as ``nohup`` has."""


class EarlySignals:
    """The signals that have come to a command, and whether they end what it does.

    Attributes:
        numbers: They, in order; the first one decides the exit code.
    """

    def __init__(self) -> None:
        self.numbers: list[int] = []
        self._interrupts = False

    def __bool__(self) -> bool:
        """Whether there was one."""
        return bool(self.numbers)

    def exit_code(self, code: int) -> int:
        """What a shell says of a program that the first one ended; without one, ``code``."""
        return 128 + self.numbers[0] if self.numbers else code

    @contextmanager
    def interrupting(self) -> Iterator[None]:
        """Let a signal end the block.

        Raises:
            KeyboardInterrupt: One has come, or came before.
        """
        self._interrupts = True
        try:
            if self.numbers:
                raise KeyboardInterrupt
            yield
        finally:
            self._interrupts = False

    def note(self, number: int, _frame: FrameType | None = None) -> None:
        """Handle a signal; the second one ends the process at once."""
        self.numbers.append(number)
        if len(self.numbers) > 1:
            _leave(self.exit_code(0))
        sys.unraisablehook = lambda _: None  # a clean-up that it met has nothing to tell
        if self._interrupts:
            raise KeyboardInterrupt


early: Final = EarlySignals()
"""Of this process."""


@contextmanager
def early_signals(*, leaving: bool) -> Iterator[EarlySignals]:
    """Have signals noted for the time of the block.

    Where a signal is ignored or handled by somebody else, that stays.

    Args:
        leaving: Whether the process ends with the command. Signals are ignored from then on: Python
            takes its handlers away long before it is gone, and the exit code would be lost.
    """
    early.numbers.clear()
    ours = [number for number, usual in _DEFAULTS.items() if signal.getsignal(number) is usual]
    hook = sys.unraisablehook
    with suppress(ValueError):  # in a thread: there no signals come
        for number in ours:
            signal.signal(number, early.note)
    try:
        yield early
    finally:
        sys.unraisablehook = hook
        with suppress(ValueError):
            for number in ours:
                signal.signal(number, signal.SIG_IGN if leaving else _DEFAULTS[number])
