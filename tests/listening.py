"""Processes that are to be sent signals: no sooner than they can take them."""

from __future__ import annotations

import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

HEEDING = (
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    "signal.signal(signal.SIGHUP, signal.SIG_DFL); "
)
"""Begin of a program that heeds signals, whatever the shell behind the tests has it ignore."""


def wait_until(process: subprocess.Popen[Any], holds: Callable[[], bool]) -> None:
    """However slow the machine is; not if the process ends before."""
    while not holds():
        assert process.poll() is None, f"it has ended with {process.returncode}"
        time.sleep(0.002)


def wait_until_it_listens(process: subprocess.Popen[Any]) -> None:
    """Its own handlers of signals stand; Python has one for Ctrl-C only."""
    wait_until(process, lambda: _handles(process.pid, (signal.SIGTERM, signal.SIGHUP)))


def _handles(pid: int, numbers: tuple[signal.Signals, ...]) -> bool:
    for line in Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines():
        if line.startswith("SigCgt:"):
            caught = int(line.split()[1], 16)
            return all(caught >> (number - 1) & 1 for number in numbers)
    return False
