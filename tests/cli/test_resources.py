"""Commands release their memory, open files, processes and threads."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from tests.cli.test_entry import COMMANDS
from tests.families import some

RUNS = (3, 4)
"""Number of runs before the first measurement, while caches fill, and before the second one."""

MOST_MB = 8.0
"""Memory that the second runs may leave behind. An image, a model or a record that is not released
would exceed it in four runs."""

AT_ONCE = {
    "MALLOC_MMAP_THRESHOLD_": "65536",
    "MALLOC_TRIM_THRESHOLD_": "65536",
    "MALLOC_ARENA_MAX": "1",
}
"""Makes the C library return freed memory at once, so that the remaining memory is in use."""

PROGRAM = f"""
import contextlib, gc, io, json, os, sys, threading
import bt_dualarm.cli as cli

def taken():
    gc.collect()
    children = open(f"/proc/self/task/{{os.getpid()}}/children").read().split()
    pages = int(open("/proc/self/statm").read().split()[1])
    return {{
        "files": sorted(os.listdir("/proc/self/fd")),
        "processes": len(children),
        "threads": threading.active_count(),
        "mb": pages * os.sysconf("SC_PAGE_SIZE") / 1e6,
    }}

found = []
for runs in {RUNS}:
    for _ in range(runs):
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            with contextlib.suppress(SystemExit):  # what `--help` ends with
                getattr(cli, sys.argv[1])(sys.argv[2:])
    found.append(taken())
print(json.dumps(found))
"""


@pytest.mark.slow
@pytest.mark.parametrize("name", some(COMMANDS, 3))
def test_command_releases_its_resources(name: str) -> None:
    """Repeated runs in one process need no more files, processes, threads or memory."""
    command = [sys.executable, "-c", PROGRAM, *COMMANDS[name]]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | AT_ONCE)
    assert done.returncode == 0, done.stderr
    before, after = json.loads(done.stdout.splitlines()[-1])
    assert after["files"] == before["files"]
    assert (before["processes"], after["processes"]) == (0, 0)
    assert (before["threads"], after["threads"]) == (1, 1)
    assert after["mb"] - before["mb"] < MOST_MB


@pytest.mark.slow
@pytest.mark.parametrize("megabytes", [300, 600])
def test_too_little_address_space_is_reported_in_one_line(megabytes: int) -> None:
    """Otherwise libraries that cannot be mapped raise various errors or run out of memory later."""
    limit = f"resource.setrlimit(resource.RLIMIT_AS, ({megabytes * 10**6}, -1))"
    run = "import bt_dualarm.cli as cli, sys; sys.exit(cli.run(['circle', '--duration', '0.1']))"
    command = [sys.executable, "-c", f"import resource; {limit}; {run}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert f"error: the address space is limited to {megabytes} MB (ulimit -v)" in done.stderr
    assert "Traceback" not in done.stderr
