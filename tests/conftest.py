"""What tests of several packages share: the command as users type it, and runs in this process."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import settings

from bt_dualarm.skill.registry import Registry
from tests.commands import BtRun, Ran
from tests.plays import Stage

# A first example may import what is imported when it is asked for, on a machine with other work.
settings.register_profile("unhurried", deadline=None)
settings.load_profile("unhurried")


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
