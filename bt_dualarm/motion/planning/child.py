"""The process that plans as its parent sees it: how it is started, and whether it is stopped."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

_PROGRAM = "from bt_dualarm.motion.planning.worker import serve; serve()"

_ROOT = str(Path(__file__).parents[3])
"""Where the package lies that the process shall import: this one."""


def spawn() -> tuple[subprocess.Popen[bytes], int, int]:
    """A process, the descriptor to write to it, and the one to read from it.

    In a process group of its own: Ctrl-C in a terminal is for the run alone.
    """
    child_in, writing = os.pipe()
    reading, child_out = os.pipe()
    paths = [_ROOT, os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
    try:
        process = subprocess.Popen(  # noqa: S603 - this interpreter, a fixed program
            [sys.executable, "-P", "-c", _PROGRAM],
            stdin=child_in,
            stdout=child_out,
            stderr=subprocess.DEVNULL,
            env=environment,
            process_group=0,
        )
    except OSError:
        os.close(writing)
        os.close(reading)
        raise
    finally:
        os.close(child_in)
        os.close(child_out)
    return process, writing, reading


def stopping_signal(pid: int) -> int:
    """The signal by which a child is stopped now, 0 where it goes on or has ended."""
    try:
        state = os.waitid(os.P_PID, pid, os.WSTOPPED | os.WNOHANG | os.WNOWAIT)
    except ChildProcessError:
        return 0
    return 0 if state is None else state.si_status
