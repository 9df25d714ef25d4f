"""A skill file whose import does not return ends a command, as a tick that hangs ends a run."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from bt_dualarm import cli
from bt_dualarm.cli import entry
from bt_dualarm.skill.registry import Registry

HUNG = {
    "a loop": "number = 1\nwhile True:\n    number = -number\n",
    "a sleep": "import time\n\ntime.sleep(1e6)\n",
    "a lock": "import threading\n\nthreading.Event().wait()\n",
    "a function": "def load():\n    while True:\n        pass\n\n\nload()\n",
}
LINES = {"a loop": (2, 3), "a sleep": (3,), "a lock": (3,), "a function": (2, 3)}
SECONDS = 0.4
"""Time limit of an import in these tests, s; the shipped skills, once imported, need 0.005 s."""

COMMANDS = {
    "bt-run": (cli.run, ("circle", "--display", "quiet", "--watchdog", str(SECONDS))),
    "bt-check": (cli.check, ("circle",)),
    "bt-skills": (cli.skills, ("circle",)),
    "bt-tune-color": (cli.tune_color, ("pick_and_track",)),
}
CASES = [*((name, "a loop") for name in COMMANDS), *(("bt-check", kind) for kind in HUNG)]


@pytest.mark.parametrize(("name", "kind"), dict.fromkeys(CASES))
def test_import_that_does_not_return_is_an_overrun(
    name: str,
    kind: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The message has file and line, and the exit code is that of a skill that does not return."""
    Registry.load()  # imports the shipped ones, which takes time once per process
    monkeypatch.setattr(entry, "IMPORT_S", SECONDS)
    (tmp_path / "hung.py").write_text(HUNG[kind], encoding="utf-8")
    main, given = COMMANDS[name]
    assert main([*given, "--skills", str(tmp_path)]) == 154
    err = capsys.readouterr().err
    places = [f"{name}: error: the import of skills at hung.py:{line}, in" for line in LINES[kind]]
    assert err.startswith(tuple(places)), err
    assert err.count("\n") == 1


@pytest.mark.slow
def test_import_that_cannot_be_interrupted_ends_the_process(tmp_path: Path) -> None:
    """The import catches all exceptions."""
    (tmp_path / "hung.py").write_text(
        "while True:\n    try:\n        while True:\n            pass\n"
        "    except BaseException:\n        pass\n"
    )
    code = (
        "import sys; import bt_dualarm.cli as cli; from bt_dualarm.cli import entry; "
        "from bt_dualarm.skill.registry import Registry; Registry.load(); "
        "from bt_dualarm.runtime import interruption; interruption._RETRY_S = 0.2; "
        f"entry.IMPORT_S = {SECONDS}; sys.exit(cli.check())"
    )
    command = [sys.executable, "-c", code, "circle", "--skills", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 154
    assert done.stderr.startswith("bt-check: error: the import of skills at hung.py:")
    assert done.stderr.endswith("s, and cannot be interrupted\n")


def test_import_within_its_time_is_not_interrupted(tmp_path: Path) -> None:
    (tmp_path / "rest.py").write_text(
        "from bt_dualarm import Skill\n"
        "class Rest(Skill):\n"
        '    """Does nothing for a tick."""\n'
        "    example = 'rest'\n"
        "    def run(self):\n"
        "        yield\n"
    )
    found = entry.imported_skills("bt-check", (tmp_path,)).skills
    assert found.keys() == {*Registry.load().skills, "rest"}


def test_monitor_is_not_started_without_files_to_import(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(entry, "_started_monitor", lambda: pytest.fail("a process was started"))
    assert entry.imported_skills("bt-check", ()).skills == Registry.load().skills


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("import os; os._exit(0)", "SystemExit: os._exit(0)"),
        ("import sys; sys.exit(0)", "SystemExit: 0"),
        ("raise KeyboardInterrupt", "KeyboardInterrupt"),
        ("raise GeneratorExit", "GeneratorExit"),
        ("raise BaseException('all')", "BaseException: all"),
        ("import bt_dualarm.core.errors as e; raise e.Interruption", "Interruption"),
    ],
)
def test_skill_file_that_would_end_the_program_is_an_import_error(
    line: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Otherwise exit code 0 would mean success."""
    file = tmp_path / "ending.py"
    file.write_text(line + "\n", encoding="utf-8")
    assert cli.check(["circle", "--skills", str(tmp_path)]) == 2
    err = capsys.readouterr().err
    assert err == f"bt-check: error: {file}:1: cannot be imported: {message}\n"
