"""Machine code of kernels: what it means, where it is kept, and who compiles it."""

from __future__ import annotations

import ast
import os
import re
import shutil
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from bt_dualarm.core.share import digest_of_code, digest_of_kernels
from bt_dualarm.runtime.kernels import GROUPS
from tests.core.doubling import reported, started
from tests.source import MODULES, ROOT, dotted_name, imports_of

KERNEL_FILES = [path for path in MODULES if "kernel" in path.name]
CALLED = [path for path in KERNEL_FILES if path.name.endswith("_kernels.py")]


def test_code_is_compiled_once_and_found_from_anywhere(tmp_path: Path, scripts: Path) -> None:
    """By the next process, from another place of installation too, one that cannot be written."""
    cache = tmp_path / "cache"
    result, hits, said, place = reported(started(cache, scripts))
    assert (result, hits) == (6.0, 0)
    assert len(said) == 1
    assert "once on this machine" in said[0]
    assert place == cache / "bt_dualarm" / "kernels"

    elsewhere = tmp_path / "elsewhere"
    shutil.copytree(scripts, elsewhere, ignore=shutil.ignore_patterns("__pycache__"))
    elsewhere.chmod(stat.S_IRUSR | stat.S_IXUSR)
    assert reported(started(cache, elsewhere)) == (6.0, 1, [], place)
    elsewhere.chmod(stat.S_IRWXU)


def test_python_without_docstrings_finds_the_same_code(tmp_path: Path, scripts: Path) -> None:
    """Its byte code is another one; the sources are the same."""
    text = (scripts / "double_kernels.py").read_text()
    documented = text.replace("(x):\n", '(x):\n    """Twice as much."""\n')
    assert documented != text
    (scripts / "double_kernels.py").write_text(documented)
    reported(started(tmp_path / "cache", scripts))
    assert reported(started(tmp_path / "cache", scripts, "-OO"))[:3] == (6.0, 1, [])


def test_two_processes_may_compile_at_once(tmp_path: Path, scripts: Path) -> None:
    both = [started(tmp_path / "cache", scripts) for _ in range(2)]
    assert [reported(process)[0] for process in both] == [6.0, 6.0]
    assert reported(started(tmp_path / "cache", scripts))[:3] == (6.0, 1, [])


def test_kernels_can_be_told_apart_by_the_names_of_their_files() -> None:
    """Numba takes the last part of a module's name, a function's, and its line."""
    names = [path.name for path in CALLED]
    assert sorted(set(names)) == sorted(names)


def test_a_change_of_a_module_compiles_it_and_its_callers_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Kernels that call the changed ones contain their code, directly or not; others stay."""
    before = {path.stem: digest_of_code(path) for path in CALLED}
    whole = digest_of_kernels()
    read = Path.read_bytes

    def changed(path: Path) -> bytes:
        return read(path) + (b"# changed" if path.stem == "swept_kernels" else b"")

    monkeypatch.setattr(Path, "read_bytes", changed)
    digest_of_code.cache_clear()
    digest_of_kernels.cache_clear()
    after = {path.stem: digest_of_code(path) for path in CALLED}
    assert {name for name in after if after[name] != before[name]} == {
        "swept_kernels",
        "rrt_kernels",
    }
    assert digest_of_kernels() != whole
    monkeypatch.undo()
    digest_of_code.cache_clear()
    digest_of_kernels.cache_clear()


@pytest.mark.parametrize("path", CALLED, ids=dotted_name)
def test_the_digest_of_a_module_is_that_of_all_that_it_imports(path: Path) -> None:
    """However it is written: an import that the digest overlooks would leave old code in use."""
    found = [name for _, name in imports_of(path) if name.startswith("bt_dualarm.")]
    kernels = {name for name in found if "kernel" in name.rpartition(".")[2]}
    listed = set(re.findall(r"^from (bt_dualarm\S+) import", path.read_text(), re.MULTILINE))
    assert kernels <= listed


def test_every_kernel_that_python_calls_is_in_a_group() -> None:
    """What warms kernels up is named nowhere else: a group that is left out compiles in a run."""
    defined = {
        f"{dotted_name(path)}:{name}"
        for path in MODULES
        for name in re.findall(r"^def (warm_up_\w+)", path.read_text(), re.MULTILINE)
    }
    assert sorted(path for group in GROUPS.values() for path in group) == sorted(defined)


def test_code_of_other_sources_is_removed_after_a_week(tmp_path: Path, scripts: Path) -> None:
    place = tmp_path / "cache" / "bt_dualarm" / "kernels"
    old = place / "double_kernels-0123456789abcdef"
    new = place / "double_kernels-fedcba9876543210"
    for folder in (old, new):
        folder.mkdir(parents=True)
        (folder / "doubled.nbc").write_bytes(b"code")
    long_ago = time.time() - 8 * 86_400
    os.utime(old, (long_ago, long_ago))
    reported(started(tmp_path / "cache", scripts))
    assert not old.exists()
    assert new.exists()


@pytest.mark.parametrize("path", CALLED, ids=dotted_name)
def test_what_is_compiled_in_is_in_files_of_kernels(path: Path) -> None:
    """Else a change of it would not be noticed, and old code taken from the cache."""
    allowed = {"bt_dualarm.core.pose"}  # its types: they are not compiled in
    inside = [name for _, name in imports_of(path) if name.startswith("bt_dualarm.")]
    assert [n for n in inside if "kernel" not in n.rpartition(".")[2] and n not in allowed] == []


def test_kernels_are_imported_where_they_are_called() -> None:
    """Importing numba takes 0.3 s, which those who draw nothing are not to wait for."""
    early = [
        f"{dotted_name(path)}:{line} {name}"
        for path in set(MODULES) - set(KERNEL_FILES)
        for line, name in _at_import(path)
        if name.endswith("_kernels") or name.split(".")[0] == "numba"
    ]
    assert early == []


def _at_import(path: Path) -> Iterator[tuple[int, str]]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in tree.body:
        if isinstance(node, ast.ImportFrom):
            yield node.lineno, str(node.module)
        elif isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)


COMMANDS = {
    "import": "import bt_dualarm",
    "bt-check": "import bt_dualarm.cli as c; c.check(['trees/pick_and_track.yaml'])",
    "bt-skills": "import bt_dualarm.cli as c; c.skills([])",
}


@pytest.fixture(scope="module")
def with_numba() -> dict[str, bool]:
    """Whether numba is there after each of these, in one process, one after the other."""
    lines = ["import sys"]
    for name, command in COMMANDS.items():
        lines += [command, f"print('NUMBA after', {name!r}, 'numba' in sys.modules)"]
    done = subprocess.run(
        [sys.executable, "-c", "\n".join(lines)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    said = re.findall(r"^NUMBA after (.*) (True|False)$", done.stdout, re.MULTILINE)
    return {name: answer == "True" for name, answer in said}


@pytest.mark.parametrize("command", COMMANDS)
def test_what_computes_nothing_leaves_numba_alone(
    command: str, with_numba: dict[str, bool]
) -> None:
    assert not with_numba[command]
