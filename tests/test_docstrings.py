"""Laws of the docstrings: rooms have a map, entries begin with a noun, and each says something."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.source import MODULES, SKILLS, dotted_name, parsed

ENTRY = re.compile(r"^ {4,}(?P<names>\*{0,2}\w+(?:, \*{0,2}\w+)*): (?P<first>\w+)", re.MULTILINE)
SECTION = re.compile(r"^\s*(?:Args|Attributes):\n((?:(?:\s{4,}.*)?\n)*)", re.MULTILINE)

GENITIVES = {"Of", "From", "To", "In", "For", "By", "With", "At", "On"}
"""A word that leans on a noun that is not there."""

DOCUMENTED = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
ROOMS = [path for path in MODULES if path.name == "__init__.py"]


def docstrings(path: Path) -> Iterator[tuple[str, str]]:
    """Name and docstring of everything in a file that has one."""
    for node in ast.walk(parsed(path)):
        if isinstance(node, DOCUMENTED):
            text = ast.get_docstring(node)
            if text:
                yield getattr(node, "name", path.stem), text


def entries(text: str) -> Iterator[tuple[str, str]]:
    """What is described in the sections of arguments and attributes, and its first word."""
    for section in SECTION.findall(text + "\n"):
        yield from ((entry["names"], entry["first"]) for entry in ENTRY.finditer(section))


@pytest.mark.parametrize("path", [*MODULES, *SKILLS], ids=dotted_name)
def test_entries_begin_with_a_noun(path: Path) -> None:
    leaning = [
        f"{owner}.{name}: {first} …"
        for owner, text in docstrings(path)
        for name, first in entries(text)
        if first in GENITIVES
    ]
    assert leaning == []


@pytest.mark.parametrize("path", [*MODULES, *SKILLS], ids=dotted_name)
def test_no_docstring_is_a_word(path: Path) -> None:
    assert [owner for owner, text in docstrings(path) if len(text.split()) < 2] == []


@pytest.mark.parametrize("path", ROOMS, ids=dotted_name)
def test_rooms_have_a_map(path: Path) -> None:
    """What comes in, what goes out, which file to open first, and that file is there."""
    text = ast.get_docstring(parsed(path)) or ""
    if path.parent.name == "bt_dualarm":
        return
    assert {"In:", "Out:", "Open first:"} <= set(re.findall(r"^\w[\w ]*:", text, re.MULTILINE))
    named = re.search(r"^Open first: `(\w+(?:/\w+)?)`", text, re.MULTILINE)
    assert named, "say which file: Open first: `name`"
    assert (path.parent / f"{named[1]}.py").is_file()
