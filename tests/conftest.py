"""Fixtures shared by several packages: the command as users type it, and runs in this process."""

from __future__ import annotations

import ctypes
import fcntl
import gc
import io
import itertools
import json
import os
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from bt_dualarm.skill.registry import Registry
from tests.commands import BtRun, Ran, in_this_process
from tests.no_plots import BT_RUN_NO_PLOTS, no_plots
from tests.plays import Stage

# A first example may trigger lazy imports, on a busy machine. Each run has the same examples; new
# ones are tried with `pytest --hypothesis-profile=exploring`.
settings.register_profile("unhurried", deadline=None, derandomize=True)
settings.register_profile("exploring", deadline=None)
settings.load_profile("unhurried")

BYTE_CODE = "PYTHONPYCACHEPREFIX"


def pytest_configure(config: pytest.Config) -> None:
    """Watch the memory; cache byte code elsewhere if Python may not write it beside the sources.

    A few hundred of the tests start a fresh process; most of these would spend more time on
    compiling imports than on anything else.
    """
    config.pluginmanager.register(Memory(), "memory of the tests")
    if sys.dont_write_bytecode and BYTE_CODE not in os.environ:
        folder = tempfile.TemporaryDirectory(prefix="byte_code_")
        link_byte_code(Path(sysconfig.get_path("purelib")), Path(folder.name))
        os.environ[BYTE_CODE] = folder.name
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # test processes inherit both
        config.add_cleanup(folder.cleanup)


def link_byte_code(packages: Path, prefix: Path) -> None:
    """Link the byte code installed with packages to where Python looks for it with a prefix.

    It looks nowhere else then, and would recompile the packages: 2 to 4 s for the first process.
    """
    ending = f".{sys.implementation.cache_tag}.pyc"
    for folder, below, names in os.walk(packages):
        below[:] = [name for name in below if name not in ("tests", "testing")]
        if folder.endswith("__pycache__"):
            there = prefix / Path(folder).parent.relative_to("/")
            there.mkdir(parents=True, exist_ok=True)
            for name in names:
                if name.endswith(ending):
                    (there / name).symlink_to(Path(folder, name))


OBJECTS = 100_000
"""New objects after which Python collects cyclic garbage, as in the commands. A run leaves none."""


@pytest.hookimpl(trylast=True)
def pytest_collection_finish() -> None:
    """Exclude imported modules and collected tests from garbage collection: all of them stay."""
    freeze_objects()
    gc.set_threshold(OBJECTS)


def freeze_objects() -> None:
    """Collect cyclic garbage, and exclude the remaining objects from later collections."""
    gc.collect()
    gc.freeze()


GROWTH = 128 * 2**20
"""Growth of a process after which it returns freed memory to the system, bytes."""


class Memory:
    """Returns freed memory of a test process to the system; the C library would keep most of it.

    Of 689 MB after eleven recorded runs, 276 MB were in use; of 1,700 MB after eighty cells of the
    matrix, which are one module, 640 MB. The rest are caches and data of modules: searching them
    for garbage would take half a second each time.
    """

    def __init__(self) -> None:
        self._trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # glibc's
        self._after_trim = 0

    def pytest_runtest_logfinish(self) -> None:
        """Return memory if the tests have enlarged the process."""
        if self._trim is not None and self._resident() > self._after_trim + GROWTH:
            freeze_objects()
            self._trim(0)
            self._after_trim = self._resident()

    def _resident(self) -> int:
        try:
            pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
        except OSError:  # Linux only
            return 0
        return int(pages) * os.sysconf("SC_PAGESIZE")


@pytest.fixture(scope="session")
def registry() -> Registry:
    """The shipped skills, imported once."""
    return Registry.load()


@pytest.fixture(scope="session")
def main_job(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Ran:
    """The shipped main job with its plots, run once for all tests of all workers."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if hasattr(request.config, "workerinput") else base) / "main_job"
    folder.mkdir(exist_ok=True)
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        result = folder / "note.json"
        if not result.exists():
            output = io.StringIO()
            arguments = ["pick_and_track", "--renderer", "ray", "--record", str(folder / "out")]
            code = in_this_process("bt-run", arguments, output, output)
            result.write_text(json.dumps((code, output.getvalue())), encoding="utf-8")
    code, text = json.loads(result.read_text(encoding="utf-8"))
    return Ran(code, text, text, folder / "out")


@pytest.fixture
def without_plots() -> Iterator[None]:
    """Records of this process have no plots."""
    with no_plots():
        yield


@pytest.fixture
def stage(tmp_path: Path, registry: Registry) -> Stage:
    """Factory of plays from tree files."""
    return Stage(tmp_path, registry)


@pytest.fixture
def bt_run(tmp_path: Path) -> BtRun:
    """Runs ``bt-run`` in a fresh process, without plots, and returns its results."""
    folders = (tmp_path / f"record{count}" for count in itertools.count(1))

    def run(*arguments: str | Path) -> Ran:
        folder = next(folders)
        done = subprocess.run(
            [sys.executable, "-c", BT_RUN_NO_PLOTS, *arguments, *recording_to(folder)],
            env=os.environ | {"OMP_NUM_THREADS": "1"},
            capture_output=True,
            text=True,
            check=False,
            timeout=300,
        )
        return Ran(done.returncode, done.stdout, done.stderr, folder)

    return run


@pytest.fixture
def bt_run_here(tmp_path: Path) -> BtRun:
    """Runs ``bt-run`` in this process, which has imported all of it, and returns its results."""
    folders = (tmp_path / f"record_here{count}" for count in itertools.count(1))

    def run(*arguments: str | Path) -> Ran:
        folder = next(folders)
        out = io.StringIO()
        err = io.StringIO()
        code = in_this_process("bt-run", [*arguments, *recording_to(folder)], out, err)
        return Ran(code, out.getvalue(), err.getvalue(), folder)

    return run


def recording_to(folder: Path) -> list[str]:
    return ["--display", "quiet", "--renderer", "ray", "--record", str(folder)]
