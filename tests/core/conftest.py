"""Fixtures: a folder with a kernel, and its compiled code."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.core.doubling import DOUBLE, Compiled, reported, started


@pytest.fixture
def scripts(tmp_path: Path) -> Path:
    """A folder with a module of one kernel."""
    return folder_of_scripts(tmp_path)


def folder_of_scripts(within: Path) -> Path:
    folder = within / "scripts"
    folder.mkdir()
    (folder / "double_kernels.py").write_text(DOUBLE)
    return folder


@pytest.fixture(scope="package")
def compiled_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the cache that a process has filled with the kernel's code, and its scripts."""
    within = tmp_path_factory.mktemp("compiled")
    assert reported(started(within / "cache", folder_of_scripts(within)))[:2] == (6.0, 0)
    return within


@pytest.fixture
def compiled(compiled_once: Path, tmp_path: Path) -> Compiled:
    """A copy of the cache, which the test may damage, and the same scripts: code has their path."""
    shutil.copytree(compiled_once / "cache", tmp_path / "cache")
    (file,) = (tmp_path / "cache").rglob("*.nbc")
    return Compiled(tmp_path / "cache", file, compiled_once / "scripts")
