"""Program of a worker process: runs the trials that come in through a pipe.

The process ends when its parent closes the pipe or dies, even in the middle of a trial.
"""

from __future__ import annotations

import os
import queue
import shutil
import signal
import tempfile
import threading
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path

from bt_dualarm.sweeps.job import Job


def serve(scratch: str) -> None:
    """Run one trial after the other, until the pipe is closed.

    Args:
        scratch: Folder for temporary files, which is deleted with the process.
    """
    tempfile.tempdir = scratch
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # for the parent, which then closes the pipe
    requests = Connection(os.dup(0), writable=False)
    answers = Connection(os.dup(1), readable=False)
    os.dup2(2, 1)  # keeps prints of skills and libraries out of the answers
    jobs: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(requests, jobs, scratch), daemon=True).start()
    while (job := jobs.get()) is not None:
        row = job.run()
        with suppress(BrokenPipeError):
            answers.send(dict(row))


def _read(requests: Connection, jobs: queue.SimpleQueue[Job | None], scratch: str) -> None:
    """Read jobs; end the process once the parent is gone, because nobody needs the result then."""
    try:
        while True:
            jobs.put(requests.recv())
    except (EOFError, OSError):
        with suppress(OSError):  # Renamed first: the trial goes on writing to it by its name.
            shutil.rmtree(Path(scratch).rename(f"{scratch}_gone"), ignore_errors=True)
        os.kill(os.getpid(), signal.SIGKILL)
