"""Renew what ``skills.md`` lists of the base class, the arm and the façade from docstrings."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import bt_dualarm
from bt_dualarm.arm import Arm
from bt_dualarm.skill import Skill, SkillContext
from bt_dualarm.spec.docstring import attributes_of

PAGE: Final = Path(__file__).with_suffix(".md")
_MACHINERY: Final = frozenset({"for_leaf", "planning", "seed", "trouble", "write"})
"""What is there for others than authors of skills."""

_PLACE = re.compile(r"(?<=<!-- generated -->\n).*?(?=<!-- end of generated -->)", re.DOTALL)


def tables() -> str:
    """All that is generated."""
    parts = [
        "### `self`\n",
        *_table(_attributes(Skill, "self."), _members(Skill, "self.")),
        "### `self.arm`\n",
        *_table(*(_attributes(base, "arm.") for base in Arm.__mro__), _members(Arm, "arm.")),
        "### `self.context`\n",
        *_table(_attributes(SkillContext, "self.context.")),
        "### `from bt_dualarm import …`\n",
        *_table(_facade()),
    ]
    return "\n".join(parts) + "\n"


def renewed(text: str) -> str:
    """A page with the tables as they ought to be."""
    return _PLACE.sub(lambda _: "\n" + tables(), text)


def _table(*rows: Iterator[tuple[str, str]]) -> Iterator[str]:
    yield "| | |\n|---|---|"
    for group in rows:
        for code, words in group:
            yield f"| `{code}` | {_cell(words)} |"
    yield ""


def _attributes(kind: type[Any], prefix: str) -> Iterator[tuple[str, str]]:
    for name, words in attributes_of(kind).items():
        if name not in _MACHINERY:
            yield f"{prefix}{name}", words


def _members(kind: type[Any], prefix: str) -> Iterator[tuple[str, str]]:
    for name, member in inspect.getmembers(kind):
        if name.startswith("_") or name in _MACHINERY:
            continue
        if isinstance(member, property):
            yield f"{prefix}{name}", _first_line(member)
        elif inspect.isfunction(member):
            yield f"{prefix}{name}({', '.join(_arguments(member))})", _first_line(member)


def _arguments(function: Any) -> Iterator[str]:
    """Names and defaults, without types: the docstring has those."""
    for parameter in inspect.signature(function).parameters.values():
        if parameter.name == "self":
            continue
        default = parameter.default
        if default is inspect.Parameter.empty:
            yield parameter.name
        else:
            yield f"{parameter.name}={'{}' if default == frozenset() else repr(default)}"


def _facade() -> Iterator[tuple[str, str]]:
    for name in sorted(bt_dualarm.__all__, key=str.lower):
        member = getattr(bt_dualarm, name)
        if inspect.isclass(member) or inspect.isfunction(member):
            yield name, _first_line(member)


def _first_line(member: Any) -> str:
    return (inspect.getdoc(member) or "").partition("\n\n")[0].replace("\n", " ")


def _cell(words: str) -> str:
    return words.replace("``", "`").replace("|", r"\|")


def main() -> None:
    """Write the page."""
    PAGE.write_text(renewed(PAGE.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
