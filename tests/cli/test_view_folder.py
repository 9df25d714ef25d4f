"""A view removes its folder; the folder of a killed view is removed at the next start."""

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
    """Id of a process that has ended."""
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    return ended.pid


def test_folder_of_a_view_is_removed_at_its_end(temporary: Path) -> None:
    with view_folder() as folder:
        (folder / "run.history").write_text("x")
        assert folder.parent == temporary
        assert f"_{os.getpid()}_" in folder.name
    assert not list(temporary.iterdir())


def test_only_folders_of_killed_views_are_removed(temporary: Path) -> None:
    left = temporary / f"bt_dualarm_view_{dead()}_abc"
    left.mkdir()
    (left / "run.history").write_text("x")
    elsewhere = temporary / "elsewhere"
    elsewhere.mkdir()
    link = temporary / f"bt_dualarm_view_{dead()}_link"
    link.symlink_to(elsewhere)
    kept = [
        temporary / f"bt_dualarm_view_{os.getppid()}_abc",  # its process is alive
        temporary / f"bt_dualarm_view_{dead()}",  # not a name of a view's folder
        temporary / f"my_bt_dualarm_view_{dead()}_abc",
    ]
    for folder in kept:
        folder.mkdir()
    with view_folder():
        assert not left.exists()
    assert all(folder.is_dir() for folder in (*kept, elsewhere))
    assert link.is_symlink()
