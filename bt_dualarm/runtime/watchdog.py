"""Sees to it that code of skills returns: looks on from a thread of its own, and interrupts."""

from __future__ import annotations

import ctypes
import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final, Protocol

from bt_dualarm.errors import Overrun
from bt_dualarm.runtime.signals import StopRequest
from bt_dualarm.runtime.whereabouts import Whereabouts

STOPPING_S: Final = 5.0
"""Seconds that code gets at most once the run is to end."""

_LOOK_S: Final = 0.1
"""Seconds from one look to the next. A look that comes late, in a process that was suspended or on
a machine that is busy, counts no more than twice as much."""

_AGAIN_S: Final = 1.0
"""Seconds from one interruption of the same code to the next."""

_SHELTER_S: Final = 1.0
"""Seconds more that code of this package gets to return to the skill that has called it: what is
interrupted in the middle of something may be of no use afterwards."""

_MOST: Final = 3
"""Interruptions of the same code; what takes no notice of them cannot be interrupted."""

_WAKE: Final = signal.SIGURG
"""Lets system calls return, so that Python looks at what is pending. By default it is ignored, so
that one which comes late is harmless."""


class LastResort(Protocol):
    """What becomes of a run whose code nothing can interrupt; of a command, it ends the process.

    Attributes:
        held_up: Function to be called, with the frame that stands still, where code holds Python's
            own lock and never gives it back: no thread looks on any more.
    """

    held_up: Callable[[FrameType | None], None]

    def postpone(self, seconds: float) -> None:
        """Say that Python runs: if it does not for so many seconds of computing, it is over."""

    def end(self, sentence: str, keep: Callable[[], object]) -> None:
        """Say why, have kept what can be kept, and end it."""


class Watchdog:
    """A budget of time on the wall for every tick and callback of a skill.

    A ``with`` block around such code starts the time anew. Within the budget nothing happens: the
    run is the same to the last bit. Code that has used it up gets an `Overrun` where it stands; the
    main thread also out of calls of the system. Time does not count in which a debugger has it, or
    in which it waits for a terminal or for a plan.

    Args:
        budget: Seconds; infinite for none of its own, so that it acts when the run is to end only;
            None for no watchdog at all.
        stop: Request to end early: code gets `STOPPING_S` from then on, no time when it is urgent.
        of: What it watches, for what it says of code that is no arm's.

    Attributes:
        overrun: Sentence on the code that was the first to use up its time; empty where none has.
        keep: Function that writes what is known of the run, for the last resort.
        last_resort: What to do where interruptions are of no use; None waits.
    """

    def __init__(self, budget: float | None, stop: StopRequest, of: str = "the run") -> None:
        self.overrun = ""
        self.keep: Callable[[], object] = lambda: None
        self.last_resort: LastResort | None = None
        self._budget = budget
        self._stop = stop
        self._of = of
        self._section = 0  # odd within a block, another one for each block
        self._aimed_at = 0
        self._thread = 0
        self._is_over = threading.Event()
        self._lock = threading.Lock()
        self._looking: threading.Thread | None = None

    def __enter__(self) -> None:
        """Start the time of what follows."""
        self._section = (self._section + 1) | 1

    def __exit__(self, *error: object) -> None:
        """Nothing in it can be interrupted from here on."""
        with self._lock:
            self._section = (self._section + 1) & ~1

    @contextmanager
    def awake(self) -> Iterator[None]:
        """Look on while this thread runs the block."""
        if self._budget is None or self._is_over.is_set():
            yield
            return
        if self.last_resort is not None:
            self.last_resort.held_up = self._held_up
        self._postpone()
        self._thread = threading.get_ident()
        if self._looking is None:
            self._looking = threading.Thread(target=self._look_on, name="watchdog", daemon=True)
            self._looking.start()
        is_main = threading.current_thread() is threading.main_thread()
        before = signal.signal(_WAKE, lambda *_: None) if is_main else None
        try:
            yield
        finally:
            if is_main:
                signal.signal(_WAKE, before)

    def close(self) -> None:
        """Look no more."""
        self._is_over.set()
        if self._looking is not None:
            self._looking.join()
            if self.last_resort is not None:
                self.last_resort.postpone(0.0)

    def _look_on(self) -> None:
        seen, spent, strikes, before = 0, 0.0, 0, time.monotonic()
        while not self._is_over.wait(_LOOK_S):
            now = time.monotonic()
            passed, before = min(now - before, 2 * _LOOK_S), now
            self._postpone()
            section = self._section
            if section % 2 == 0 or section != seen:
                seen, spent, strikes = section, 0.0, 0
                continue
            where = Whereabouts.of(self._thread, self._of)
            if where.is_excused and not self._stop.asked:
                continue
            spent += passed
            again_s = _LOOK_S if self._stop.urgent else _AGAIN_S
            sheltered = where.is_in_package and not strikes and not self._stop.urgent
            if spent > self._patience() + strikes * again_s + (_SHELTER_S if sheltered else 0.0):
                strikes += 1
                self._act(section, strikes, where, spent)

    def _held_up(self, frame: FrameType | None) -> None:
        """End a run whose code holds Python's own lock; this very thread runs that code."""
        self._is_over.set()  # the thread that looks on is not to interrupt what follows
        ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(self._thread), None)
        sentence = f"{Whereabouts.of_frame(frame, self._of)} does not return, nor lets Python go on"
        self.overrun = self.overrun or sentence
        if self.last_resort is not None:
            self.last_resort.end(sentence, self.keep)

    def _postpone(self) -> None:
        """Give the last resort, which is for Python itself being held up, its time anew."""
        patience = self._patience()
        if self.last_resort is not None and math.isfinite(patience):
            self.last_resort.postpone(patience + STOPPING_S)

    def _patience(self) -> float:
        """Seconds that code gets now."""
        if self._stop.urgent:
            return 0.0
        budget = math.inf if self._budget is None else self._budget
        return min(budget, STOPPING_S) if self._stop.asked or self.overrun else budget

    def _act(self, section: int, strikes: int, where: Whereabouts, spent: float) -> None:
        sentence = f"{where} has not returned for {spent:.1f} s"
        self.overrun = self.overrun or sentence
        if strikes <= _MOST or self.last_resort is None:
            self._interrupt(section, sentence)
        else:
            self.last_resort.end(sentence, self.keep)

    def _interrupt(self, section: int, sentence: str) -> None:
        """Have an `Overrun` raised in the code that runs, if it is still the same."""
        error = type("Overrun", (Overrun,), {"__str__": lambda _: sentence})
        with self._lock:
            if self._section != section:
                return
            set_error = ctypes.pythonapi.PyThreadState_SetAsyncExc
            set_error(ctypes.c_ulong(self._thread), ctypes.py_object(error))
            if self._thread == threading.main_thread().ident:
                signal.pthread_kill(self._thread, _WAKE)
