"""What ends a command where code of a skill cannot be interrupted, or ends processes itself."""

from __future__ import annotations

import faulthandler
import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Final, NoReturn, Self

from bt_dualarm.cli.entry import OVERRUN
from bt_dualarm.runtime.signals import StopRequest

_KEEPING_S: Final = 5.0
"""Seconds that the record gets to be written."""

_SHOW_CURSOR: Final = b"\x1b[?25h"


class ProcessEnd:
    """Ends the process, as the last resort of a `Watchdog`.

    What holds Python's own lock, so that no thread of it runs, is ended by the system: then the
    alarm of virtual time names the line on standard error, and the exit code is the same.

    Args:
        program: Name of the program.
        stop: Request to end; a signal that came decides the exit code.
    """

    def __init__(self, program: str, stop: StopRequest) -> None:
        self._program, self._stop = program, stop

    def __enter__(self) -> Self:
        """Have the alarm tell where Python is held up."""
        faulthandler.register(signal.SIGVTALRM, file=2, all_threads=False, chain=True)
        return self

    def __exit__(self, *error: object) -> None:
        """Turn the alarm off."""
        self.postpone(0.0)
        faulthandler.unregister(signal.SIGVTALRM)

    def postpone(self, seconds: float) -> None:
        """Set the alarm; 0 turns it off."""
        signal.setitimer(signal.ITIMER_VIRTUAL, seconds)

    def end(self, sentence: str, keep: Callable[[], object]) -> NoReturn:
        """Say why, write what is known of the run, and be gone, whether that succeeds or not."""
        code = self._stop.exit_code or OVERRUN
        too_late = threading.Timer(_KEEPING_S, os._exit, (code,))
        too_late.daemon = True
        too_late.start()
        with suppress(OSError):
            if os.isatty(1):
                os.write(1, _SHOW_CURSOR)
            os.write(2, f"{self._program}: error: {sentence}, and cannot be interrupted\n".encode())
        try:
            keep()
        except Exception as error:  # noqa: BLE001 - whatever it is, the end is now
            with suppress(OSError):
                os.write(2, f"{self._program}: error: {error}\n".encode())
        os._exit(code)


@contextmanager
def exit_refused() -> Iterator[None]:
    """Let `os._exit` raise SystemExit in the block: a skill that calls it would end the run of all.

    Of this thread and process only: processes that libraries fork end in this way.
    """
    leave, process, thread = os._exit, os.getpid(), threading.get_ident()

    def refuse(status: int) -> NoReturn:
        if (os.getpid(), threading.get_ident()) == (process, thread):
            raise SystemExit(f"os._exit({status})")
        leave(status)

    os._exit = refuse
    try:
        yield
    finally:
        os._exit = leave
