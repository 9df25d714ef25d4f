"""A kernel that doubles a number, and a process that uses it and reports the result."""

from __future__ import annotations

import ctypes
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from tests.source import ROOT

PR_CAPBSET_DROP = 24
CAP_DAC_OVERRIDE = 1
CAP_DAC_READ_SEARCH = 2
"""Constants of Linux's prctl(2) and capabilities(7)."""

DOUBLE = """
from bt_dualarm.core.kernel import kernel

@kernel
def doubled(x):
    return 2.0 * x

def warm_up():
    doubled(2.0)
"""
USE = """
import json, logging, sys
from bt_dualarm.core.kernel import compile_once
from bt_dualarm.core.share import code_folder
said = []
handler = logging.Handler()
handler.emit = lambda record: said.append(record.getMessage())
logging.getLogger("bt_dualarm").addHandler(handler)
logging.getLogger("bt_dualarm").setLevel(logging.INFO)
from double_kernels import doubled
compile_once({"doubling": ["double_kernels:warm_up"]})
result = doubled(3.0)
hits = sum(doubled.stats.cache_hits.values()) if hasattr(doubled, "stats") else 0
print(json.dumps([result, hits, said, str(code_folder())]))
"""
"""Compiles one small kernel; reports its result, the number of cache hits, and the log."""


@dataclass(frozen=True)
class Compiled:
    """Code of the kernel: its cache, its file and the folder of its source."""

    cache: Path
    file: Path
    scripts: Path


def environment(cache: Path, scripts: Path) -> dict[str, str]:
    """Environment with a separate cache, the kernel's module, and no settings of numba."""
    set_here = ("NUMBA_CPU_NAME",)  # by this process, which may have used kernels
    return {name: value for name, value in os.environ.items() if name not in set_here} | {
        "XDG_CACHE_HOME": str(cache),
        "PYTHONPATH": os.pathsep.join((str(scripts), str(ROOT))),
    }


def started(
    cache: Path, scripts: Path, *flags: str, first: str = "", **settings: str
) -> subprocess.Popen[str]:
    """A process that runs a first line and uses the kernel; file modes apply to it even as root."""
    return subprocess.Popen(
        [sys.executable, *flags, "-c", first + USE],
        env=environment(cache, scripts) | settings,
        preexec_fn=give_up_rights,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def give_up_rights() -> None:
    """Drops root's capabilities to ignore file modes; without effect for other users."""
    libc = ctypes.CDLL(None)
    for right in CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH:
        libc.prctl(PR_CAPBSET_DROP, right, 0, 0, 0)


def reported(process: subprocess.Popen[str]) -> tuple[float, int, list[str], Path]:
    """The result of a process, its number of cache hits, its log, and the folder of its code."""
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    result, hits, log, folder = json.loads(out)
    return result, hits, log, Path(folder)
