"""The wheel contains everything, and runs without a checkout."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tarfile
import venv
import zipfile
from contextlib import suppress
from importlib.metadata import Distribution, PackageNotFoundError, PathDistribution, distribution
from pathlib import Path

import pytest

from bt_dualarm.core.share import share_dir

ROOT = Path(__file__).parent.parent
SHARED = ("assets", "skills", "trees")

pytestmark = pytest.mark.slow


OWN = {"PYTHONPATH", "PYTHONPYCACHEPREFIX"}
"""Variables set for the tests: paths of packages and byte code."""


def run(*command: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a program to its end in an environment without this project's own variables."""
    environment = {name: value for name, value in os.environ.items() if name not in OWN}
    environment["PYTHONDONTWRITEBYTECODE"] = "1"  # linked packages belong to another environment
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


def required_by(wheel: Path) -> dict[str, Distribution]:
    """Installed distributions that a wheel requires, directly or indirectly, by name."""
    found: dict[str, Distribution] = {}
    (metadata,) = (path for path in zipfile.Path(wheel).iterdir() if "dist-info" in path.name)
    requirements = list(PathDistribution(metadata).requires or ())
    while requirements:
        line = requirements.pop()
        name = re.split(r"[^\w.-]", line)[0].lower()
        if name in found or "extra ==" in line:
            continue
        with suppress(PackageNotFoundError):  # for another system; otherwise pip will report it
            found[name] = distribution(name)
            requirements += found[name].requires or ()
    return found


@pytest.fixture
def scratch_venv(wheel: Path, tmp_path: Path) -> Path:
    """A fresh virtual environment that contains the wheel's requirements, and nothing else.

    They are linked from this environment: unpacking the same versions, over a gigabyte, took 20 s.
    """
    folder = tmp_path / "venv"
    venv.create(
        folder
    )  # filled by this environment's pip: installing another one takes as long again
    (site,) = folder.glob("lib/python*/site-packages")
    for package in required_by(wheel).values():
        for top in {path.parts[0] for path in package.files or ()} - {"..", "__pycache__"}:
            if not (site / top).exists():  # some packages share a folder
                (site / top).symlink_to(str(package.locate_file(top)))
    return folder / "bin"


def test_wheel_contains_every_shared_file(wheel: Path) -> None:
    packed = set(zipfile.ZipFile(wheel).namelist())
    expected = {
        f"bt_dualarm/_share/{kind}/{path.relative_to(share_dir(kind)).as_posix()}"
        for kind in SHARED
        for path in share_dir(kind).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert expected <= packed
    assert "bt_dualarm/py.typed" in packed


def test_wheel_contains_nothing_else(wheel: Path) -> None:
    """No tests, no build artifacts, no other top-level package that could shadow another."""
    tops = {name.split("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"bt_dualarm"}


def test_installed_wheel_runs_a_shipped_tree_from_an_empty_folder(
    wheel: Path, scratch_venv: Path, tmp_path: Path
) -> None:
    """As in README: install with pip and without a checkout, then run by name.

    pip confirms that all requirements are installed in compatible versions.
    """
    empty = tmp_path / "elsewhere"
    empty.mkdir()
    into = ("--python", scratch_venv / "python")
    # Compile only what is imported, not all that is installed.
    options = ("--quiet", "--no-compile", "--no-index", "--constraint", ROOT / "constraints.txt")
    installed = run(sys.executable, "-m", "pip", *into, "install", *options, wheel, cwd=empty)
    assert installed.returncode == 0, installed.stderr
    checked = run(sys.executable, "-m", "pip", *into, "check", cwd=empty)
    assert checked.stdout == "No broken requirements found.\n", checked.stdout + checked.stderr

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


def test_source_distribution_contains_the_examples(tmp_path: Path) -> None:
    built = run(sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", tmp_path, cwd=ROOT)
    assert built.returncode == 0, built.stderr
    (file,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(file) as archive:
        inside = {Path(*Path(name).parts[1:]) for name in archive.getnames()}
    examples = [path.relative_to(ROOT) for path in (ROOT / "examples").iterdir() if path.is_file()]
    assert len(examples) > 12
    assert [str(path) for path in examples if path not in inside] == []
