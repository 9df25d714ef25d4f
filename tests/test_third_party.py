"""A third-party skill: installed into a fresh environment, used from YAML, checked by the laws."""

from __future__ import annotations

import shutil
import subprocess
import sys
import sysconfig
import textwrap
import venv
from collections.abc import Iterator
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

PACKAGE = {
    "pyproject.toml": """
        [build-system]
        requires = ["hatchling"]
        build-backend = "hatchling.build"

        [project]
        name = "nodding"
        version = "1.0"

        [project.entry-points."bt_dualarm.skills"]
        nod = "nodding:Nod"
    """,
    "nodding.py": '''
        """Lower the tool and lift it again."""

        from bt_dualarm import Failure, PortModel, Pose, Skill, Speed, port


        class Nod(Skill):
            """Lower the tool and lift it again."""

            class Ports(PortModel):
                depth: float = port(0.05, "how far down", unit="m", gt=0, le=0.3)
                speed: Speed = port(0.5, "fraction of the arm's limits")

            failures = {"NOT_BACK": "the tool did not end where it began"}
            example = "nod: {depth: 0.05}"
            needs = ("scipy.spatial",)

            def run(self):
                yield from self.arm.come_to_rest()
                start = self.arm.commanded_tool_pose
                low = Pose.from_rotation(start.position - (0, 0, self.ports.depth), start.rotation)
                way = self.arm.line_on(low)
                for path in (way, way[::-1]):
                    yield from self.arm.follow(self.arm.time_path(path, self.ports.speed))
                away = self.arm.tool_pose.distance(start)
                if away > 0.001:
                    raise Failure("NOT_BACK", f"{1000 * away:.1f} mm off", away_m=away)
    ''',
    "test_nod.py": """
        import pytest
        from bt_dualarm.skill.registry import Registry
        from bt_dualarm.testing import LAWS, Candidate


        @pytest.mark.parametrize("law", LAWS)
        def test_nod_keeps_to(law):
            LAWS[law](Candidate("nod", Registry.load()))
    """,
}
TREE = """
    bt_dualarm: 1
    world: {scene: empty}
    arms:
      arm1:
        robot: ur5
        base: {xyz: [0, 0, 0.4]}
        tree: {nod: {depth: 0.08}}
"""
TRAP = "from pathlib import Path\nPath(__file__ + ' sprung').touch()\n"
"""Source of a module that creates a file when it is imported."""


def write(folder: Path, name: str, text: str) -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / name
    path.write_text(textwrap.dedent(text).lstrip(), encoding="utf-8")
    return path


def run(*command: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
        timeout=300,
    )


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A fresh environment with the package; everything else comes from this environment."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder / "venv")
    python = folder / "venv" / "bin" / "python"
    site = run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=folder)
    # `addsitedir` also processes the files of an editable install, unlike a plain path.
    here = sysconfig.get_path("purelib")
    link = f"import site; site.addsitedir({here!r})\n"
    (Path(site.stdout.strip()) / "parent.pth").write_text(link, encoding="utf-8")
    for name, text in PACKAGE.items():
        write(folder / "nodding", name, text)
    options = ("--no-deps", "--no-build-isolation", "--no-index", "--quiet")
    done = run(python, "-m", "pip", "install", *options, folder / "nodding", cwd=folder)
    assert done.returncode == 0, done.stdout
    yield python
    shutil.rmtree(folder)


def bt_run(python: Path | str, *arguments: str | Path, cwd: Path) -> tuple[int, str]:
    """Run like the script ``bt-run``: ``cwd`` is not on Python's path (-P)."""
    code = "from bt_dualarm.cli import run; raise SystemExit(run())"
    done = run(python, "-P", "-c", code, *arguments, "--display", "log", cwd=cwd)
    return done.returncode, done.stdout


def test_installed_skill_can_be_used_from_yaml(python: Path, tmp_path: Path) -> None:
    code, output = bt_run(python, write(tmp_path, "tree.yaml", TREE), cwd=tmp_path)
    assert code == 0, output
    assert "nod" in output


def test_installed_skill_passes_the_laws(python: Path, tmp_path: Path) -> None:
    test = write(tmp_path, "test_nod.py", PACKAGE["test_nod.py"])
    done = run(python, "-m", "pytest", "-q", "-p", "no:cacheprovider", test, cwd=tmp_path)
    assert done.returncode == 0, done.stdout


TRAPS = ("nod.py", "tree.py", "circle.py", "yaml.py", "conftest.py")


@pytest.fixture(scope="module")
def among_traps(python: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a tree that was run with all `TRAPS` beside it."""
    folder = tmp_path_factory.mktemp("traps")
    for name in TRAPS:
        write(folder, name, TRAP)
    code, output = bt_run(python, write(folder, "tree.yaml", TREE), cwd=folder)
    assert code == 0, output
    return folder


@pytest.mark.parametrize("name", TRAPS)
def test_nothing_beside_a_tree_is_executed(among_traps: Path, name: str) -> None:
    """Neither a file named like the tree, nor like a skill, nor like an imported module."""
    assert (among_traps / name).exists()
    assert not (among_traps / f"{name} sprung").exists()


def test_folder_is_imported_only_if_the_user_names_it(python: Path, tmp_path: Path) -> None:
    """This shows that the traps of the other test work."""
    tree = write(tmp_path, "tree.yaml", TREE)
    write(tmp_path, "trap.py", TRAP)
    code, output = bt_run(python, tree, "--skills", tmp_path, cwd=tmp_path)
    assert (code, "trap.py: has no subclass of Skill" in output) == (2, True), output
    assert (tmp_path / "trap.py sprung").exists()


def test_skill_is_unknown_without_the_package(tmp_path: Path) -> None:
    """So the other tests use the installed package, and not some file."""
    code, output = bt_run(sys.executable, write(tmp_path, "tree.yaml", TREE), cwd=tmp_path)
    assert code == 2
    assert "there is no node or skill 'nod'" in output
