"""A skill that does not return from where it is told, in the way that it is told."""

from __future__ import annotations

import contextlib
import ctypes
import itertools
import os
import re
import signal
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, ClassVar

from bt_dualarm import PortModel, Skill, SkillContext, port
from bt_dualarm.trajectory.set_points import SetPoint


def spin() -> None:
    """Without a call."""
    while True:
        pass


def swallow() -> None:
    """Whatever is raised in it."""
    while True:
        with contextlib.suppress(BaseException):
            time.sleep(1000)


def deadlock() -> None:
    """In C, where no signal leads out of."""
    library = ctypes.CDLL(None)
    mutex = ctypes.create_string_buffer(128)
    for _ in range(2):
        library.pthread_mutex_lock(mutex)


DEEDS: dict[str, Callable[[], object]] = {
    "spin": spin,
    "sleep": lambda: time.sleep(1000),
    "wait": lambda: threading.Event().wait(),
    "swallow": swallow,
    "deadlock": deadlock,
    "hold the lock of Python": lambda: sum(itertools.repeat(0)),
    "a huge power": lambda: 7 ** (10**9),
    "a huge regular expression": lambda: re.match("(a+)+$", "a" * 60 + "b"),
    "a foreign call": lambda: ctypes.PyDLL(None).sleep(1000),  # which keeps the lock
    "leave": lambda: os._exit(0),
}


class Blocker(Skill):
    """Send signals, then block, in one phase."""

    class Ports(PortModel):
        """Where and how."""

        phase: str = port("step", "where to block")
        action: str = port("spin", "how to block")
        signals: str = port("", "names of signals that this process gets before, with blanks")

    example: ClassVar[str] = "blocker"
    ports: Ports

    def __init__(
        self, ports: PortModel, context: SkillContext, write: Callable[[str, Any], None]
    ) -> None:
        super().__init__(ports, context, write)
        self._block_in("constructor")

    def run(self) -> Iterator[float | None]:
        """Hold the arm by a stream until it blocks."""
        self._block_in("before")
        if self.arm.camera is not None:
            self.arm.camera.subscribe(lambda _: self._block_in("camera"))
        self.arm.stream(self._hold)
        try:
            for _ in range(5):
                yield None
            self._block_in("step")
            while True:
                yield None
        finally:
            self._block_in("finally")

    def _hold(self, _time: float) -> SetPoint:
        self._block_in("stream")
        return self.arm.setpoint

    def _block_in(self, phase: str) -> None:
        if phase == self.ports.phase:
            os.write(1, b"blocking\n")  # for those who measure how long it takes from here on
            for name in self.ports.signals.split():
                os.kill(os.getpid(), getattr(signal, name))
            DEEDS[self.ports.action]()
