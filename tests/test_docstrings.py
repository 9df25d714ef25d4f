"""Laws of docstrings: packages name their first module, entries begin with a noun."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from tests.source import MODULES, PACKAGE, SKILLS, dotted_name, parsed

ENTRY = re.compile(r"^ {4,}(?P<names>\*{0,2}\w+(?:, \*{0,2}\w+)*): (?P<first>\w+)", re.MULTILINE)
SECTION = re.compile(r"^\s*(?:Args|Attributes):\n((?:(?:\s{4,}.*)?\n)*)", re.MULTILINE)

GENITIVES = {"Of", "From", "To", "In", "For", "By", "With", "At", "On"}
"""First words of genitive fragments, which lack their noun."""

DOCUMENTED = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
PACKAGES = [path for path in MODULES if path.name == "__init__.py" and path.parent != PACKAGE]


def docstrings(path: Path) -> Iterator[tuple[str, str]]:
    """Name and docstring of everything in a file that has one."""
    for node in ast.walk(parsed(path)):
        if isinstance(node, DOCUMENTED):
            text = ast.get_docstring(node)
            if text:
                yield getattr(node, "name", path.stem), text


def entries(text: str) -> Iterator[tuple[str, str]]:
    """Names and first words of the entries in sections of arguments and attributes."""
    for section in SECTION.findall(text + "\n"):
        yield from ((entry["names"], entry["first"]) for entry in ENTRY.finditer(section))


def test_entries_begin_with_a_noun() -> None:
    fragments = [
        f"{dotted_name(path)}: {owner}.{name}: {first} …"
        for path in (*MODULES, *SKILLS)
        for owner, text in docstrings(path)
        for name, first in entries(text)
        if first in GENITIVES
    ]
    assert fragments == []


def test_no_docstring_is_a_single_word() -> None:
    single = [
        f"{dotted_name(path)}: {owner}"
        for path in (*MODULES, *SKILLS)
        for owner, text in docstrings(path)
        if len(text.split()) < 2
    ]
    assert single == []


def test_packages_name_the_module_to_open_first() -> None:
    for path in PACKAGES:
        text = ast.get_docstring(parsed(path)) or ""
        named = re.search(r"^Open first: `(\w+)`", text, re.MULTILINE)
        assert named, f"{path}: name a module: Open first: `name`"
        assert (path.parent / f"{named[1]}.py").is_file(), path
