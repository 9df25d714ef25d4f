"""What tests of several packages share: the command as users type it, and runs in this process."""

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
from tests.plays import Stage
from tests.undrawn import BT_RUN_UNDRAWN, undrawn

# A first example may import what is imported when it is asked for, on a machine with other work.
settings.register_profile("unhurried", deadline=None)
settings.load_profile("unhurried")

BYTE_CODE = "PYTHONPYCACHEPREFIX"


def pytest_configure(config: pytest.Config) -> None:
    """Watch the memory; where Python may not write byte code beside the sources, keep it.

    A few hundred of the tests start a fresh process; compiling what it imports takes longer than
    all else that most of these do.
    """
    config.pluginmanager.register(Memory(), "memory of the tests")
    if sys.dont_write_bytecode and BYTE_CODE not in os.environ:
        folder = tempfile.TemporaryDirectory(prefix="byte_code_")
        link_byte_code(Path(sysconfig.get_path("purelib")), Path(folder.name))
        os.environ[BYTE_CODE] = folder.name
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # test processes inherit both
        config.add_cleanup(folder.cleanup)


def link_byte_code(packages: Path, prefix: Path) -> None:
    """Byte code that was installed with packages, where Python looks for it by a prefix.

    It looks nowhere else then, and would compile them anew: 2 to 4 s for each that starts first.
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
"""New objects after which Python looks for circles: as the commands have it. A run leaves none."""


@pytest.hookimpl(trylast=True)
def pytest_collection_finish() -> None:
    """Look no more for circles among what is imported and collected: all of it stays."""
    keep_what_is_there()
    gc.set_threshold(OBJECTS)


def keep_what_is_there() -> None:
    """Break up circles that nobody needs, and look for none among the rest any more."""
    gc.collect()
    gc.freeze()


GROWTH = 128 * 2**20
"""Bytes by which a process may have grown when it is to give back what its tests have freed."""


class Memory:
    """What a process of tests holds, and gives back: the C library keeps most of it for later.

    Of 689 MB after eleven runs that were recorded it kept 276; of 1,700 MB after eighty cells of
    the matrix, which are one module, 640. What is left by then are caches and what modules share:
    looking through it once more, each time, would take half a second.
    """

    def __init__(self) -> None:
        self._trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # glibc's
        self._after_trim = 0

    def pytest_runtest_logfinish(self) -> None:
        """Give back, where a test has made the process larger."""
        if self._trim is not None and self._resident() > self._after_trim + GROWTH:
            keep_what_is_there()
            self._trim(0)
            self._after_trim = self._resident()

    def _resident(self) -> int:
        try:
            pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
        except OSError:  # only Linux has it
            return 0
        return int(pages) * os.sysconf("SC_PAGESIZE")


@pytest.fixture(scope="session")
def registry() -> Registry:
    """The shipped skills, imported once."""
    return Registry.load()


@pytest.fixture(scope="session")
def main_job(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Ran:
    """The shipped main job with its pictures, run once for all tests of all workers."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if hasattr(request.config, "workerinput") else base) / "main_job"
    folder.mkdir(exist_ok=True)
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        note = folder / "note.json"
        if not note.exists():
            said = io.StringIO()
            arguments = ["pick_and_track", "--renderer", "ray", "--record", str(folder / "out")]
            code = in_this_process("bt-run", arguments, said, said)
            note.write_text(json.dumps((code, said.getvalue())), encoding="utf-8")
    code, text = json.loads(note.read_text(encoding="utf-8"))
    return Ran(code, text, text, folder / "out")


@pytest.fixture
def without_pictures() -> Iterator[None]:
    """Records of this process have no pictures."""
    with undrawn():
        yield


@pytest.fixture
def stage(tmp_path: Path, registry: Registry) -> Stage:
    """Makes plays of the text of tree files."""
    return Stage(tmp_path, registry)


@pytest.fixture
def bt_run(tmp_path: Path) -> BtRun:
    """Runs ``bt-run`` in a fresh process, without its pictures, and reads what it left behind."""
    folders = (tmp_path / f"record{count}" for count in itertools.count(1))

    def run(*arguments: str | Path) -> Ran:
        folder = next(folders)
        done = subprocess.run(
            [sys.executable, "-c", BT_RUN_UNDRAWN, *arguments, *recording_to(folder)],
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
    """Runs ``bt-run`` in this process, which has imported all of it, and likewise."""
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
