"""Requests to end a run, made by signals and checked by the runner between two physics steps."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

from bt_dualarm.core.errors import Interruption


@dataclass
class StopRequest:
    """Request to end the run, and its urgency.

    Attributes:
        signal_number: First signal received, else None.
        count: Number of requests. One: stop the arms, write everything. More: skip slow output.
        heard: Number of signals received, including those whose Python handler has not run yet.
    """

    signal_number: int | None = None
    count: int = 0
    heard: int = 0

    @property
    def asked(self) -> bool:
        """Whether the run is to end."""
        return max(self.count, self.heard) > 0

    @property
    def urgent(self) -> bool:
        """Whether the end was requested repeatedly: only what consistent files need is written."""
        return max(self.count, self.heard) > 1

    @property
    def exit_code(self) -> int:
        """Exit code of a program ended by the signal: 129, 130 or 143; 0 without a signal."""
        return 0 if self.signal_number is None else 128 + self.signal_number

    def ask(self) -> None:
        """Request the end without a signal."""
        self.count += 1

    def receive(self, number: int) -> None:
        """Count a signal in its handler; the first one determines the exit code."""
        if self.signal_number is None:
            self.signal_number = number
        self.count += 1

    def hear(self, number: int) -> None:
        """Count a signal on arrival, before its handler runs."""
        if self.signal_number is None:
            self.signal_number = number
        self.heard += 1


@contextmanager
def ctrl_c_ends() -> Iterator[None]:
    """Let Ctrl-C end the whole block, if Python's default handler is installed.

    A KeyboardInterrupt raised inside a skill would be treated as the skill's own error.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed.
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
    """Turn SIGINT, SIGTERM and SIGHUP into requests within the block.

    The handler only counts: the interrupted code (a tick, a half-written file) continues; the third
    signal ends the process at once. SIGHUP is sent when a terminal is closed; if it is ignored, as
    with ``nohup``, it stays ignored.

    Python runs handlers only once the main thread returns to the interpreter; a listening thread
    counts signals on arrival.
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
    """Count signals on arrival, from the pipe that Python's C-level handler writes them to."""
    read_end, write_end = os.pipe()
    os.set_blocking(write_end, False)
    before = signal.set_wakeup_fd(write_end, warn_on_full_buffer=False)

    def listen() -> None:
        while number := os.read(read_end, 1):
            if number[0] in numbers:
                request.hear(number[0])

    thread = threading.Thread(target=listen, name="signals", daemon=True)
    thread.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        os.close(write_end)
        thread.join()
        os.close(read_end)
