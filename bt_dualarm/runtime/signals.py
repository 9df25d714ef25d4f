"""Signals become a request to end, which the runner looks at between two physics steps."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

from bt_dualarm.errors import Interruption


@dataclass
class StopRequest:
    """Whether somebody asked the run to end, and how urgently.

    Attributes:
        signal_number: The first signal that came, else None.
        count: Number of requests. One: stop the arms, write everything. More: skip what takes time.
        heard: Number of signals that have come, also where the handler waits for code to return.
    """

    signal_number: int | None = None
    count: int = 0
    heard: int = 0

    @property
    def asked(self) -> bool:
        """The run shall end in an orderly way."""
        return max(self.count, self.heard) > 0

    @property
    def urgent(self) -> bool:
        """Asked again: what is not needed for consistent files is left out."""
        return max(self.count, self.heard) > 1

    @property
    def exit_code(self) -> int:
        """What a shell reports of a program that this signal ended: 129, 130, 143; 0 if none."""
        return 0 if self.signal_number is None else 128 + self.signal_number

    def ask(self) -> None:
        """Ask for the end without a signal."""
        self.count += 1

    def receive(self, number: int) -> None:
        """Note a signal; the first one decides the exit code."""
        if self.signal_number is None:
            self.signal_number = number
        self.count += 1

    def hear(self, number: int) -> None:
        """Note that a signal has come, which its handler will note in its turn."""
        if self.signal_number is None:
            self.signal_number = number
        self.heard += 1


@contextmanager
def ctrl_c_ends() -> Iterator[None]:
    """Let Ctrl-C end the block and nothing less, where Python's own handler would see to it.

    A KeyboardInterrupt that Python raises inside of a skill would pass for the skill's own.

    Raises:
        KeyboardInterrupt: Somebody has pressed Ctrl-C.
    """
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, _interrupt)
    try:
        yield
    except Interruption as interruption:
        raise KeyboardInterrupt().with_traceback(interruption.__traceback__) from None
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise Interruption


@contextmanager
def stop_on_signals(request: StopRequest) -> Iterator[StopRequest]:
    """Turn SIGINT, SIGTERM and SIGHUP into ``request`` for the time of the block.

    The handler only counts: whatever it interrupts (a file half written, a tick) goes on; the third
    signal ends the process where it stands. SIGHUP comes when a terminal is closed; where it is
    ignored, as ``nohup`` does, it stays ignored.

    Handlers wait until the main thread returns to Python; a thread hears of signals before.
    """

    def note(number: int, _frame: FrameType | None) -> None:
        request.receive(number)
        if request.count > 1:
            for other in numbers:
                signal.signal(other, signal.SIG_DFL)

    numbers = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    before = {number: signal.signal(number, note) for number in numbers}
    try:
        with _hearing(request, numbers):
            yield request
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _hearing(request: StopRequest, numbers: Collection[int]) -> Iterator[None]:
    """Note signals when they come, whatever the main thread does; Python writes them to a pipe."""
    ear, mouth = os.pipe()
    os.set_blocking(mouth, False)
    before = signal.set_wakeup_fd(mouth, warn_on_full_buffer=False)

    def listen() -> None:
        while said := os.read(ear, 1):
            if said[0] in numbers:
                request.hear(said[0])

    thread = threading.Thread(target=listen, name="signals", daemon=True)
    thread.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        os.close(mouth)
        thread.join()
        os.close(ear)
