"""What ends a command where code of a skill cannot be interrupted, or ends processes itself."""

from __future__ import annotations

import ctypes
import faulthandler
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Final, NoReturn, Self

from bt_dualarm.cli.entry import OVERRUN
from bt_dualarm.runtime.signals import StopRequest

_leave: Final = os._exit  # also where `exit_refused` stands in its place

_KEEPING_S: Final = 5.0
"""Seconds that the record gets to be written."""

_SHOW_CURSOR: Final = b"\x1b[?25h"


_Handler = ctypes.CFUNCTYPE(None, ctypes.c_int)

_LOOKER_ON: Final = """
import os, select, signal, sys, time
process, keeping = int(sys.argv[1]), float(sys.argv[2])
limit = spent = 0.0
before = time.monotonic()
while os.getppid() == process:
    ready = select.select([0], [], [], 0.5)[0]
    now = time.monotonic()
    passed, before = min(now - before, 1.0), now
    if ready:
        said = os.read(0, 65536)
        if not said:
            break
        limit, spent = float(said.split()[-1]), 0.0
        continue
    with open(f"/proc/{process}/stat") as file:
        state = file.read().rpartition(")")[2].split()[0]
    spent += passed if state in "SD" else 0.0
    if limit and spent > limit:
        os.kill(process, signal.SIGVTALRM)
        limit, spent = 2.0 * keeping, 0.0
"""
"""Looks on from outside: counts the time in which a process sleeps and says nothing.

One that is stopped, or that waits for a processor, sleeps not; one that computes has an alarm of
its own. The second signal finds no handler any more, and ends the process.
"""


class ProcessEnd:
    """Ends the process, as the last resort of a `Watchdog`.

    Where code holds Python's own lock, no thread of Python runs. Then a signal comes: from the
    alarm of virtual time where that code computes, from a process that looks on where it sleeps.
    Its handler is one of C, which the system calls in the very thread that holds the lock, and
    which so may run Python: it names the line on standard error and writes what is known of the
    run. Should that fail, as C was in the middle of anything, the next signal ends the process. The
    exit code is the same.

    Args:
        program: Name of the program.
        stop: Request to end; a signal that came decides the exit code.
    """

    def __init__(self, program: str, stop: StopRequest) -> None:
        self._program, self._stop = program, stop
        self.held_up: Callable[[FrameType | None], None] = lambda _: None
        self._handler = _Handler(self._hear)  # C does not keep it alive
        self._before: int | None = None
        self._looker_on: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        """Be there for signals; without a C library that can, only the line is told."""
        install = getattr(ctypes.CDLL(None), "sysv_signal", None)
        if install is None:
            faulthandler.register(signal.SIGVTALRM, file=2, all_threads=False, chain=True)
            return self
        install.argtypes, install.restype = (ctypes.c_int, ctypes.c_void_p), ctypes.c_void_p
        # System V's handlers are called once, and the signal is not blocked meanwhile.
        self._before = install(signal.SIGVTALRM, ctypes.cast(self._handler, ctypes.c_void_p)) or 0
        return self

    def __exit__(self, *error: object) -> None:
        """Turn the alarm off."""
        self.postpone(0.0)
        if self._looker_on is not None and self._looker_on.stdin is not None:
            with suppress(OSError):
                self._looker_on.stdin.close()
            self._looker_on.wait()
        if self._before is None:
            faulthandler.unregister(signal.SIGVTALRM)
        else:
            ctypes.CDLL(None).sysv_signal(signal.SIGVTALRM, ctypes.c_void_p(self._before))

    def postpone(self, seconds: float) -> None:
        """Set the alarm; 0 turns it off."""
        signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
        if self._looker_on is None and seconds and self._before is not None:
            self._looker_on = _begun_to_look_on()
        if self._looker_on is not None and self._looker_on.stdin is not None:
            with suppress(OSError):  # it is gone: only code that computes is ended then
                os.write(self._looker_on.stdin.fileno(), f"{seconds}\n".encode())

    def _hear(self, _number: int) -> None:
        """Handle the signal, in the middle of whatever C does in this thread."""
        signal.setitimer(signal.ITIMER_VIRTUAL, _KEEPING_S)
        faulthandler.dump_traceback(file=2, all_threads=False)
        self.held_up(sys._getframe().f_back)

    def end(self, sentence: str, keep: Callable[[], object]) -> NoReturn:
        """Say why, write what is known of the run, and be gone, whether that succeeds or not."""
        code = self._stop.exit_code or OVERRUN
        too_late = threading.Timer(_KEEPING_S, _leave, (code,))
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
        _leave(code)


def _begun_to_look_on() -> subprocess.Popen[bytes] | None:
    """A process that looks on; None where none can be, or the system does not tell what it asks."""
    if not Path(f"/proc/{os.getpid()}/stat").exists():
        return None
    command = [sys.executable, "-I", "-S", "-c", _LOOKER_ON, str(os.getpid()), str(_KEEPING_S)]
    nobody = subprocess.DEVNULL
    try:
        process = subprocess.Popen(  # noqa: S603 - this Python, with a program of our own
            command, stdin=subprocess.PIPE, stdout=nobody, stderr=nobody, start_new_session=True
        )
    except OSError:
        return None
    if process.stdin is not None:
        os.set_blocking(process.stdin.fileno(), False)
    return process


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
