"""Helpers for sending signals to processes once their handlers are installed."""

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
"""Start of a program that handles signals, even if the calling shell makes it ignore them."""


def wait_until(process: subprocess.Popen[Any], holds: Callable[[], bool]) -> None:
    """Wait for a condition, without a timeout; fail if the process ends before."""
    while not holds():
        assert process.poll() is None, f"the process has ended with {process.returncode}"
        time.sleep(0.002)


def wait_until_it_listens(process: subprocess.Popen[Any]) -> None:
    """Wait until the process has installed its handlers; Python itself has one for Ctrl-C only."""
    wait_until(process, lambda: _handles(process.pid, (signal.SIGTERM, signal.SIGHUP)))


def _handles(pid: int, numbers: tuple[signal.Signals, ...]) -> bool:
    for line in Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines():
        if line.startswith("SigCgt:"):
            caught = int(line.split()[1], 16)
            return all(caught >> (number - 1) & 1 for number in numbers)
    return False
