"""What tests of several packages share: the command as users type it, and runs in this process."""

from __future__ import annotations

import ctypes
import gc
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from bt_dualarm.skill.registry import Registry
from tests.commands import BtRun, Ran
from tests.plays import Stage

# A first example may import what is imported when it is asked for, on a machine with other work.
settings.register_profile("unhurried", deadline=None)
settings.load_profile("unhurried")

BYTE_CODE = "PYTHONPYCACHEPREFIX"


def pytest_configure(config: pytest.Config) -> None:
    """Where Python may not write byte code beside the sources, keep it for as long as tests run.

    A few hundred of them start a fresh process; compiling what it imports takes longer than all
    else that most of these do.
    """
    if sys.dont_write_bytecode and BYTE_CODE not in os.environ:
        folder = tempfile.TemporaryDirectory(prefix="byte_code_")
        os.environ[BYTE_CODE] = folder.name
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # test processes inherit both
        config.add_cleanup(folder.cleanup)


@pytest.hookimpl(trylast=True)
def pytest_collection_finish() -> None:
    """Look no more for circles among what is imported and collected: all of it stays."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="module", autouse=True)
def memory_is_given_back() -> Iterator[None]:
    """What the tests of a module have freed goes back to the system.

    The C library keeps most of it for later: of 689 MB after eleven runs that were recorded 276.
    """
    yield
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:  # glibc's
        trim(0)


@pytest.fixture(scope="session")
def registry() -> Registry:
    """The shipped skills, imported once."""
    return Registry.load()


@pytest.fixture
def stage(tmp_path: Path, registry: Registry) -> Stage:
    """Makes plays of the text of tree files."""
    return Stage(tmp_path, registry)


@pytest.fixture
def bt_run(tmp_path: Path) -> BtRun:
    """Runs ``bt-run`` in a fresh process and reads what it left behind."""
    count = 0

    def run(*arguments: str | Path) -> Ran:
        nonlocal count
        count += 1
        folder = tmp_path / f"record{count}"
        program = Path(sys.executable).with_name("bt-run")
        options = ("--display", "quiet", "--renderer", "ray", "--record", folder)
        done = subprocess.run(
            [str(part) for part in (program, *arguments, *options)],
            env=os.environ | {"OMP_NUM_THREADS": "1"},
            capture_output=True,
            text=True,
            check=False,
            timeout=300,
        )
        return Ran(done.returncode, done.stdout, done.stderr, folder)

    return run
