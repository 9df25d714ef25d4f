"""Laws of the source that no linter checks; those of layers are contracts in pyproject.toml."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from tests.source import MODULES, PACKAGE, SKILLS, parsed


def calls_and_raises(path: Path) -> Iterator[tuple[int, str]]:
    """Line and source text of everything that a file calls or raises."""
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Call):
            yield node.lineno, ast.unparse(node.func)
        elif isinstance(node, ast.Raise) and node.exc is not None:
            yield node.lineno, ast.unparse(node.exc)


def test_only_the_command_line_reads_input_and_exits() -> None:
    """Ruff's rules on printing and exiting do not cover these built-in names."""
    found = [
        f"{path}:{line}: {name}"
        for path in (*MODULES, *SKILLS)
        if not path.is_relative_to(PACKAGE / "cli")
        for line, name in calls_and_raises(path)
        if name == "input" or name.startswith("SystemExit")
    ]
    assert found == []
