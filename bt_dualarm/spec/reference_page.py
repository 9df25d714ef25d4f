"""The reference of all nodes as a page of Markdown, generated from what is declared in code."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final

from bt_dualarm.spec.describe import Description, PortDescription, describe
from bt_dualarm.spec.file_sections import FILE_NAMES, NESTED_NAMES, OUTLINE, file_sections
from bt_dualarm.spec.kind import Kind
from bt_dualarm.spec.language import LANGUAGE
from bt_dualarm.spec.value_sections import VALUE_NAMES, value_sections

_HEAD: Final = """\
# Reference

What stands in a tree file, every word of the tree language and every shipped skill: what may be
written for it, between which bounds, and how it fails. Generated from the code; `make docs` renews
it.

In a file a node is its name with its ports: `circle: {radius: 0.1}`. Any port may be given as
`"{key}"`: a parameter, or a key of the blackboard; `name:` beside the ports is what people are
shown. [How trees are ticked and halted](ticking.md) has a page of its own, and so have the
[robots and scenes](robots.md): joints, postures, camera mounts, reach, where the table stands.
"""
_PORTS: Final = "| {} | type | unit | range | default | |\n|---|---|---|---|---|---|"


def reference_page(skills: Mapping[str, Kind], standard_failures: Mapping[str, str]) -> str:
    """The whole page.

    Args:
        skills: Skills by name.
        standard_failures: Codes that any skill may fail with, with their meaning.
    """
    inner = [kind for kind in LANGUAGE.values() if not kind.is_leaf]
    leaves = [kind for kind in LANGUAGE.values() if kind.is_leaf]
    groups: dict[str, Sequence[Kind]] = {
        "Nodes with children": inner,
        "Leaves of the language": leaves,
        "Skills": [skills[name] for name in sorted(skills)],
    }
    parts = [_HEAD, *_index(groups), "## The file\n", f"```yaml\n{OUTLINE}```\n"]
    for part, summary, fields in file_sections():
        parts += [f"### {part}\n", f"{summary}\n", _table("field", fields)]
    for title, kinds in groups.items():
        parts.append(f"## {title}\n")
        if title == "Skills":
            parts.append(_failures("any skill may fail with", standard_failures))
        parts += [part for kind in kinds for part in _node(describe(kind))]
    parts.append("## Values\n")
    parts += value_sections()
    return "\n".join(parts).rstrip() + "\n"


def _index(groups: Mapping[str, Iterable[Kind]]) -> Iterator[str]:
    yield f"- [The file](#the-file): {_links(FILE_NAMES)}"
    for title, kinds in groups.items():
        links = ", ".join(f"[`{kind.name}`](#{kind.name})" for kind in kinds)
        yield f"- [{title}](#{_anchor(title)}): {links}"
    yield f"- [Values](#values): {_links(VALUE_NAMES)}\n"


def _links(names: Iterable[str]) -> str:
    return ", ".join(f"[{name}](#{_anchor(name)})" for name in names)


def _node(told: Description) -> Iterator[str]:
    yield f"### `{told.name}`\n"
    yield f"{told.summary.rstrip('.')}.\n"
    yield f"```yaml\n{told.example}\n```\n"
    if told.children:
        places = (f"`{place}` {words}" for place, words in told.children.items())
        yield f"Children: {'; '.join(places)}.\n"
    if told.shorthand:
        yield f"A bare value is its `{told.shorthand}`.\n"
    if told.exactly_one_of:
        names = ", ".join(f"`{name}`" for name in told.exactly_one_of)
        yield f"Exactly one of {names} is given.\n"
    if told.needs_camera:
        yield "The arm needs a camera that moves with it.\n"
    if told.needs_gripper:
        yield "The arm needs a gripper.\n"
    if told.ports:
        yield _table("port", told.ports)
    if told.outputs:
        yield _table("output", told.outputs)
    if told.failures:
        yield _failures("fails with", told.failures)


def _table(title: str, ports: Iterable[PortDescription]) -> str:
    rows = (
        f"| `{port.name}` | {_linked(port.type)} | {port.unit} | {_cell(port.range)} "
        f"| {_default(port)} | {_cell(port.description)} |"
        for port in ports
    )
    return "\n".join([_PORTS.format(title), *rows, ""])


def _default(port: PortDescription) -> str:
    if port.required:
        return "required"
    return f"`{port.default}`" if port.default else ""


def _failures(title: str, codes: Mapping[str, str]) -> str:
    rows = (f"| `{code}` | {_cell(meaning)} |" for code, meaning in codes.items())
    return "\n".join([f"| {title} | |\n|---|---|", *rows, ""])


def _cell(text: str) -> str:
    """Text that can neither end a cell nor be taken for markup."""
    text = re.sub(r"matches (\S+)", r"matches `\1`", text)
    return text.replace("|", r"\|")


def _linked(words: str) -> str:
    """The words for a type, each kind of value linked to where it is explained."""
    explained = (*VALUE_NAMES, *NESTED_NAMES)
    names = "|".join(sorted(map(re.escape, explained), key=len, reverse=True))
    return re.sub(
        rf"\b({names})(s?)\b", lambda m: f"[{m[1]}{m[2]}](#{_anchor(m[1])})", _cell(words)
    )


def _anchor(title: str) -> str:
    return title.lower().replace(" ", "-")
