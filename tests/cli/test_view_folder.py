"""A view leaves no folder behind; one that was killed has its own cleared at the next start."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from bt_dualarm.cli.bt_run import view_folder


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def dead() -> int:
    """Number of a process that has ended."""
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    return ended.pid


def test_its_folder_is_gone_afterwards(temporary: Path) -> None:
    with view_folder() as folder:
        (folder / "run.history").write_text("x")
        assert folder.parent == temporary
        assert f"_{os.getpid()}_" in folder.name
    assert not list(temporary.iterdir())


def test_what_a_killed_view_left_behind_goes_and_nothing_else(temporary: Path) -> None:
    left = temporary / f"bt_dualarm_view_{dead()}_abc"
    left.mkdir()
    (left / "run.history").write_text("x")
    elsewhere = temporary / "elsewhere"
    elsewhere.mkdir()
    link = temporary / f"bt_dualarm_view_{dead()}_link"
    link.symlink_to(elsewhere)
    kept = [
        temporary / f"bt_dualarm_view_{os.getppid()}_abc",  # its process lives
        temporary / f"bt_dualarm_view_{dead()}",  # no name of ours
        temporary / f"my_bt_dualarm_view_{dead()}_abc",
    ]
    for folder in kept:
        folder.mkdir()
    with view_folder():
        assert not left.exists()
    assert all(folder.is_dir() for folder in (*kept, elsewhere))
    assert link.is_symlink()
