"""The wheel carries everything, and runs where no checkout is near."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import venv
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from bt_dualarm.share import share_dir

ROOT = Path(__file__).parent.parent
SHARED = ("assets", "skills", "trees")

pytestmark = pytest.mark.slow


def run(*command: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a program to its end in an environment without this project's own variables."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
    )


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of this checkout, built without network."""
    folder = tmp_path_factory.mktemp("wheel")
    options = ("--no-deps", "--no-build-isolation", "--quiet", "--wheel-dir", folder)
    built = run(sys.executable, "-m", "pip", "wheel", *options, ROOT, cwd=folder)
    assert built.returncode == 0, built.stderr
    (file,) = folder.glob("*.whl")
    return file


@pytest.fixture
def scratch_venv(tmp_path: Path) -> Iterator[Path]:
    """A fresh virtual environment; removed at once, as it grows to over a gigabyte."""
    folder = tmp_path / "venv"
    venv.create(folder)  # this environment's pip fills it: one of its own takes as long again
    yield folder / "bin"
    shutil.rmtree(folder)


def test_the_wheel_carries_every_shared_file(wheel: Path) -> None:
    packed = set(zipfile.ZipFile(wheel).namelist())
    expected = {
        f"bt_dualarm/_share/{kind}/{path.relative_to(share_dir(kind)).as_posix()}"
        for kind in SHARED
        for path in share_dir(kind).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert expected <= packed
    assert "bt_dualarm/py.typed" in packed


def test_the_wheel_carries_nothing_else(wheel: Path) -> None:
    """No tests, no build leftovers, nothing beside the package that could shadow another."""
    tops = {name.split("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"bt_dualarm"}


def test_an_installed_wheel_runs_a_shipped_tree_from_an_empty_folder(
    wheel: Path, scratch_venv: Path, tmp_path: Path
) -> None:
    """As README says: install with pip and no checkout, then run by name."""
    empty = tmp_path / "elsewhere"
    empty.mkdir()
    into = ("--python", scratch_venv / "python")
    # Byte code is for what is imported, not for all of what is installed.
    options = ("--quiet", "--no-compile", "--constraint", ROOT / "constraints.txt")
    installed = run(sys.executable, "-m", "pip", *into, "install", *options, wheel, cwd=empty)
    assert installed.returncode == 0, installed.stderr

    origin = run(
        scratch_venv / "python", "-c", "import bt_dualarm; print(bt_dualarm.__file__)", cwd=empty
    )
    assert str(scratch_venv.parent) in origin.stdout

    listed = run(scratch_venv / "bt-run", "--list", cwd=empty)
    assert listed.returncode == 0, listed.stderr
    for tree in share_dir("trees").glob("*.yaml"):
        assert tree.stem in listed.stdout

    job = run(scratch_venv / "bt-run", "reach_to_pose", "--record", "out", cwd=empty)
    assert job.returncode == 0, job.stdout + job.stderr
    assert (empty / "out" / "summary.json").is_file()
    assert {path.name for path in empty.iterdir()} == {"out"}
