"""Functions for campaigns of calls: some succeed, one fails, one kills its process."""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

import numpy as np


def square(number: int, folder: str) -> dict[str, Any]:
    """Square a number, and count the calls in a file of the folder."""
    with (Path(folder) / f"calls_{number}").open("a") as file:
        file.write("x")
    sys.stdout.write("noise on standard output\n")
    root = np.float64(number) / 3
    return {"square": number**2, "third": root, "parts": (number, None), "nan": float("nan")}


def die(number: int, times: int, folder: str) -> int:
    """Kill the process in the first `times` calls."""
    deaths = Path(folder) / f"deaths_{number}"
    before = len(deaths.read_text()) if deaths.exists() else 0
    if before < times:
        deaths.write_text("x" * (before + 1))
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def linger(number: int, folder: str) -> None:
    """Never return, after writing a temporary file."""
    with NamedTemporaryFile() as file:
        (Path(folder) / f"lingers_{number}").write_text(file.name)
        time.sleep(600)


def even(number: int) -> int | None:
    """Return None for odd numbers, which do not count."""
    return None if number % 2 else number


def quarrel(number: int) -> dict[str, Any]:
    """Fails with 3, and has no result that JSON can express with 4."""
    if number == 3:
        raise ValueError(f"nothing comes of {number}")
    if number == 4:
        return {"self": object()}
    return {"outcome": "FAILURE" if number == 5 else "SUCCESS", "code": "ODD"}
