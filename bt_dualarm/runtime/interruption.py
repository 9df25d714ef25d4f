"""What ends a run from outside: requests by signals, and the watchdog of skill code.

`StopRequest` is checked by the runner between two physics steps. The watchdog interrupts skill code
that does not return, from a separate thread.
"""

from __future__ import annotations

import ctypes
import math
import os
import signal
import sys
import sysconfig
import threading
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Final, Protocol

from bt_dualarm.core.errors import Interruption, Overrun


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


_LEAF: Final = "bt_dualarm.behaviors.leaf", "Leaf"
_ARM: Final = "bt_dualarm.runtime.arm_runtime", "ArmRuntime"
"""Module and class name of the owners of skill code. Not imported here, because py_trees imports
slowly; as long as no module has imported them, none of their code can be running."""

_PACKAGE: Final = str(Path(__file__).parents[1])
_LIBRARIES: Final = (
    "<",
    *{sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")},
)
"""Prefixes of the file names of library code, as opposed to skill code."""

_WAITING: Final = (
    "bdb",
    "_pydevd_bundle",
    "bt_dualarm.cli.safe_streams",
    "bt_dualarm.planning.process",
)
"""Modules and packages that wait for a user at a debugger or terminal, or have their own limits."""


@dataclass(frozen=True)
class StackLocation:
    """Current location of a thread: code line, and the leaf and arm for which it runs.

    Attributes:
        arm: Name of the arm whose code runs; empty if it belongs to none.
        leaf: Path of the leaf, or of all running leaves in a stream callback; empty if unknown.
        position: File, line and function of the innermost frame outside libraries.
        is_excused: Whether it waits for a user or for code with its own time limit, or runs no
            skill code.
        is_in_package: Whether it is in code of this package, which a skill may have called.
        default_owner: Owner to report if the code belongs to no arm.
    """

    arm: str = ""
    leaf: str = ""
    position: str = "an unknown location"
    is_excused: bool = False
    is_in_package: bool = False
    default_owner: str = "the run"

    @classmethod
    def of(cls, thread: int, default_owner: str = "the run") -> StackLocation:
        """Returns the current location of a thread.

        Args:
            thread: Identity of the thread.
            default_owner: Owner to report if the code belongs to no arm.
        """
        return cls.of_frame(sys._current_frames().get(thread), default_owner)

    @classmethod
    def of_frame(cls, innermost: FrameType | None, default_owner: str = "the run") -> StackLocation:
        """Returns the location of a thread with this innermost frame; see `of`."""
        frames = []
        arm = None
        leaf = None
        for frame in _outwards(innermost):
            owner = frame.f_locals.get("self") if _is_of_a_run(frame) else None
            if _is_a(owner, _ARM):
                arm = owner
                break
            leaf = leaf or (owner if _is_a(owner, _LEAF) else None)
            frames.append(frame)
        own = [frame for frame in frames if not _is_of_a_library(frame)]
        return cls(
            arm.name if arm else "",
            leaf.path if leaf else ", ".join(arm.running if arm else ()),
            _position(own or frames),
            (not own and leaf is None) or any(_waits(frame) for frame in frames),
            bool(frames) and _module(frames[0]).startswith("bt_dualarm."),
            default_owner,
        )

    def __str__(self) -> str:
        who = f"{self.arm}: {self.leaf}" if self.leaf else self.arm
        return f"{who or self.default_owner} at {self.position}"


def _outwards(frame: FrameType | None) -> Iterator[FrameType]:
    while frame is not None:
        yield frame
        frame = frame.f_back


def _module(frame: FrameType) -> str:
    return str(frame.f_globals.get("__name__", ""))


def _is_of_a_run(frame: FrameType) -> bool:
    """Whether a frame may have a leaf or arm as ``self``; reading locals of others is costly."""
    return _module(frame) in (_LEAF[0], _ARM[0])


def _is_a(owner: object, kind: tuple[str, str]) -> bool:
    """Whether ``owner`` is an instance of a class given by module and name."""
    module, name = kind
    return isinstance(owner, getattr(sys.modules.get(module), name, ()))


def _waits(frame: FrameType) -> bool:
    return _module(frame).startswith(_WAITING)


def _position(frames: list[FrameType]) -> str:
    if not frames:
        return StackLocation.position
    code = frames[0].f_code
    return f"{Path(code.co_filename).name}:{frames[0].f_lineno}, in {code.co_name}"


def _is_of_a_library(frame: FrameType) -> bool:
    return frame.f_code.co_filename.startswith((_PACKAGE, *_LIBRARIES))


STOPPING_S: Final = 5.0
"""Longest wall-clock budget in s once the run is to end."""

_POLL_S: Final = 0.1
"""Polling period in s. A late poll, in a suspended process or on a busy machine, counts as twice
the period at most."""

_RETRY_S: Final = 1.0
"""Seconds between two interruptions of the same code."""

_GRACE_S: Final = 1.0
"""Additional seconds for code of this package to return to the skill that called it: interrupting
it could leave its objects in an inconsistent state."""

_MOST_INTERRUPTIONS: Final = 3
"""Most interruptions of the same code before the last resort is used."""

_WAKE: Final = signal.SIGURG
"""Signal that makes system calls return, so that Python raises the pending exception. It is ignored
by default, so a late one is harmless."""


class LastResort(Protocol):
    """Handles code that cannot be interrupted; for a command, it ends the process.

    Attributes:
        held_up: Callback, with the blocked frame, for code that never releases the global
            interpreter lock, so that the watchdog thread cannot run either.
    """

    held_up: Callable[[FrameType | None], None]

    def postpone(self, seconds: float) -> None:
        """Restart the countdown: without another call within ``seconds`` of CPU time, `held_up`."""

    def end(self, sentence: str, keep: Callable[[], object]) -> None:
        """Report ``sentence``, call ``keep``, and end the process."""


class Watchdog:
    """Wall-clock budget for every tick and callback of a skill.

    A ``with`` block around such code restarts the budget. Within the budget the watchdog has no
    effect: the run is bitwise the same. In code that exceeds it, an `Overrun` is raised; in the
    main thread it also interrupts system calls. Time spent in a debugger or waiting for a terminal
    or for a plan does not count.

    Args:
        budget: Seconds; infinity limits code only once the run is to end; None disables the
            watchdog.
        stop: Request to end early: code gets `STOPPING_S` from then on, none if it is urgent.
        owner: Owner to report for code that belongs to no arm.

    Attributes:
        overrun: Sentence on the code that first exceeded its budget; empty if none has.
        keep: Writes the interim record, for the last resort.
        last_resort: Handles code that cannot be interrupted; None keeps waiting.
    """

    def __init__(self, budget: float | None, stop: StopRequest, owner: str = "the run") -> None:
        self.overrun = ""
        self.keep: Callable[[], object] = lambda: None
        self.last_resort: LastResort | None = None
        self._budget = budget
        self._stop = stop
        self._owner = owner
        self._section = 0  # odd within a block, with a new value for each block
        self._thread = 0
        self._is_over = threading.Event()
        self._lock = threading.Lock()
        self._poller: threading.Thread | None = None

    def __enter__(self) -> None:
        """Restart the budget."""
        self._section = (self._section + 1) | 1

    def __exit__(self, *error: object) -> None:
        """End the budget: the code of the block cannot be interrupted any more."""
        with self._lock:
            self._section = (self._section + 1) & ~1

    @contextmanager
    def awake(self) -> Iterator[None]:
        """Watch this thread while it runs the block."""
        if self._budget is None or self._is_over.is_set():
            yield
            return
        if self.last_resort is not None:
            self.last_resort.held_up = self._held_up
        self._postpone()
        self._thread = threading.get_ident()
        if self._poller is None:
            self._poller = threading.Thread(target=self._poll, name="watchdog", daemon=True)
            self._poller.start()
        is_main = threading.current_thread() is threading.main_thread()
        before = signal.signal(_WAKE, lambda *_: None) if is_main else None
        try:
            yield
        finally:
            if is_main:
                signal.signal(_WAKE, before)

    def close(self) -> None:
        """End the watchdog thread."""
        self._is_over.set()
        if self._poller is not None:
            self._poller.join()
            if self.last_resort is not None:
                self.last_resort.postpone(0.0)

    def _poll(self) -> None:
        seen = 0
        spent = 0.0
        strikes = 0
        before = time.monotonic()
        while not self._is_over.wait(_POLL_S):
            now = time.monotonic()
            passed = min(now - before, 2 * _POLL_S)
            before = now
            self._postpone()
            section = self._section
            if section % 2 == 0 or section != seen:
                seen = section
                spent = 0.0
                strikes = 0
                continue
            location = StackLocation.of(self._thread, self._owner)
            if location.is_excused and not self._stop.asked:
                continue
            spent += passed
            retry_s = _POLL_S if self._stop.urgent else _RETRY_S
            has_grace = location.is_in_package and not strikes and not self._stop.urgent
            allowed = self._allowed_s() + strikes * retry_s + (_GRACE_S if has_grace else 0.0)
            if spent > allowed:
                strikes += 1
                self._act(section, strikes, location, spent)

    def _held_up(self, frame: FrameType | None) -> None:
        """End a run whose code never releases the interpreter lock; runs in that code's thread."""
        self._is_over.set()  # so that the watchdog thread does not interrupt what follows
        ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(self._thread), None)
        sentence = f"{StackLocation.of_frame(frame, self._owner)} does not return and blocks Python"
        self.overrun = self.overrun or sentence
        if self.last_resort is not None:
            self.last_resort.end(sentence, self.keep)

    def _postpone(self) -> None:
        """Restart the countdown of the last resort, to show that Python still runs."""
        allowed = self._allowed_s()
        if self.last_resort is not None and math.isfinite(allowed):
            self.last_resort.postpone(allowed + STOPPING_S)

    def _allowed_s(self) -> float:
        """Current wall-clock budget in s."""
        if self._stop.urgent:
            return 0.0
        budget = math.inf if self._budget is None else self._budget
        return min(budget, STOPPING_S) if self._stop.asked or self.overrun else budget

    def _act(self, section: int, strikes: int, location: StackLocation, spent: float) -> None:
        sentence = f"{location} has not returned for {spent:.1f} s"
        self.overrun = self.overrun or sentence
        if strikes <= _MOST_INTERRUPTIONS or self.last_resort is None:
            self._interrupt(section, sentence)
        else:
            self.last_resort.end(sentence, self.keep)

    def _interrupt(self, section: int, sentence: str) -> None:
        """Raise an `Overrun` in the watched thread, if it still runs the same block."""
        error = type("Overrun", (Overrun,), {"__str__": lambda _: sentence})
        with self._lock:
            if self._section != section:
                return
            set_error = ctypes.pythonapi.PyThreadState_SetAsyncExc
            set_error(ctypes.c_ulong(self._thread), ctypes.py_object(error))
            if self._thread == threading.main_thread().ident:
                signal.pthread_kill(self._thread, _WAKE)
