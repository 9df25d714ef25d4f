"""Machine code of kernels: its cache, its digests, and when it is compiled."""

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
    """The next process finds it, also from another, read-only installation folder."""
    cache = tmp_path / "cache"
    result, hits, log, folder = reported(started(cache, scripts))
    assert (result, hits) == (6.0, 0)
    assert len(log) == 1
    assert "once on this machine" in log[0]
    assert folder == cache / "bt_dualarm" / "kernels"

    elsewhere = tmp_path / "elsewhere"
    shutil.copytree(scripts, elsewhere, ignore=shutil.ignore_patterns("__pycache__"))
    elsewhere.chmod(stat.S_IRUSR | stat.S_IXUSR)
    assert reported(started(cache, elsewhere)) == (6.0, 1, [], folder)
    elsewhere.chmod(stat.S_IRWXU)


def test_python_without_docstrings_finds_the_same_code(tmp_path: Path, scripts: Path) -> None:
    """The byte code differs, but the sources are the same."""
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


def test_file_names_of_kernels_are_unique() -> None:
    """Numba identifies code by the last part of the module's name, the function and its line."""
    names = [path.name for path in CALLED]
    assert sorted(set(names)) == sorted(names)


def test_change_of_a_module_changes_its_digest_and_that_of_its_callers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Kernels that call changed ones, even indirectly, contain their code; others do not."""
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
def test_digest_of_a_module_includes_all_kernels_that_it_imports(path: Path) -> None:
    """All imports have the form that the digest finds; otherwise old code would stay in use."""
    found = [name for _, name in imports_of(path) if name.startswith("bt_dualarm.")]
    kernels = {name for name in found if "kernel" in name.rpartition(".")[2]}
    listed = set(re.findall(r"^from (bt_dualarm\S+) import", path.read_text(), re.MULTILINE))
    assert kernels <= listed


def test_every_warm_up_function_is_in_a_group() -> None:
    """Kernels of a function that is in no group would be compiled during a run."""
    defined = {
        f"{dotted_name(path)}:{name}"
        for path in MODULES
        for name in re.findall(r"^def (warm_up_\w+)", path.read_text(), re.MULTILINE)
    }
    assert sorted(path for group in GROUPS.values() for path in group) == sorted(defined)


def test_code_of_other_sources_is_removed_after_a_week(tmp_path: Path, scripts: Path) -> None:
    cache = tmp_path / "cache" / "bt_dualarm" / "kernels"
    old = cache / "double_kernels-0123456789abcdef"
    new = cache / "double_kernels-fedcba9876543210"
    for folder in (old, new):
        folder.mkdir(parents=True)
        (folder / "doubled.nbc").write_bytes(b"code")
    long_ago = time.time() - 8 * 86_400
    os.utime(old, (long_ago, long_ago))
    reported(started(tmp_path / "cache", scripts))
    assert not old.exists()
    assert new.exists()


@pytest.mark.parametrize("path", CALLED, ids=dotted_name)
def test_kernels_import_only_kernel_files(path: Path) -> None:
    """A change of any other compiled code would go unnoticed, and the cache would be outdated."""
    allowed = {"bt_dualarm.core.pose"}  # its types: they are not compiled in
    inside = [name for _, name in imports_of(path) if name.startswith("bt_dualarm.")]
    assert [n for n in inside if "kernel" not in n.rpartition(".")[2] and n not in allowed] == []


def test_kernels_are_imported_where_they_are_called() -> None:
    """Importing numba takes 0.3 s, which users who do not need it should not wait for."""
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
    """Whether numba is imported after each command, all run in one process."""
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
    answers = re.findall(r"^NUMBA after (.*) (True|False)$", done.stdout, re.MULTILINE)
    return {name: answer == "True" for name, answer in answers}


@pytest.mark.parametrize("command", COMMANDS)
def test_command_that_computes_nothing_does_not_import_numba(
    command: str, with_numba: dict[str, bool]
) -> None:
    assert not with_numba[command]
