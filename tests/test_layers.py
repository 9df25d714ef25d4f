"""Laws of the source that no linter states; those of its layers are contracts in pyproject.toml."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from tests.source import MODULES, PACKAGE, SKILLS, parsed


def calls_and_raises(path: Path) -> Iterator[tuple[int, str]]:
    """Line and name of everything that a file calls or raises, as it is written."""
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Call):
            yield node.lineno, ast.unparse(node.func)
        elif isinstance(node, ast.Raise) and node.exc is not None:
            yield node.lineno, ast.unparse(node.exc)


def test_only_the_command_line_asks_and_raises_the_end_of_the_process() -> None:
    """Ruff's rules on printing and exiting do not know these built-in names."""
    found = [
        f"{path}:{line}: {name}"
        for path in (*MODULES, *SKILLS)
        if not path.is_relative_to(PACKAGE / "cli")
        for line, name in calls_and_raises(path)
        if name == "input" or name.startswith("SystemExit")
    ]
    assert found == []
