"""Renew what ``skills.md`` and ``python.md`` list of classes and of the façade from docstrings."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import bt_dualarm
from bt_dualarm.arm.arm import Arm
from bt_dualarm.replay.data import ArmTrack, GripperTrack, ObjectTrack, RunData
from bt_dualarm.replay.timeline import RecordedFrame
from bt_dualarm.runtime.outcome import ArmResult, LeafResult, RunResult
from bt_dualarm.runtime.run import ArmHandle, Run, TreeHandle
from bt_dualarm.skill.skill import Skill, SkillContext
from bt_dualarm.sweeps.sweep import SweepResult

DOCS: Final = Path(__file__).parent

_MACHINERY: Final = frozenset(
    {
        "assembly",
        "declares",
        "enter",
        "leaf",
        "pending_fault",
        "shared",
        "spawn_all",
        "touched",
        "views",
        "write",
    }
)
"""What is there for others than authors of skills and users of the front door."""

_FRONT_DOOR: Final = (
    "bt_dualarm.runtime.",
    "bt_dualarm.learning.",
    "bt_dualarm.replay.",
    "bt_dualarm.spec.problems",
    "bt_dualarm.sweeps.",
)
"""Modules of the façade that are not for authors of skills."""

_ATTRIBUTE = re.compile(r"^ {4}(\w+): (.*(?:\n {8}.*)*)", re.MULTILINE)
_PLACE = re.compile(r"(?<=<!-- generated -->\n).*?(?=<!-- end of generated -->)", re.DOTALL)


def tables_of_skills() -> str:
    """All that is generated for authors of skills."""
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


def tables_of_python() -> str:
    """All that is generated for users of the front door."""
    parts = []
    for title, prefix, kinds in (
        ("`bt.open(…)` gives a `Run`", "run.", (Run,)),
        ("`run.arms[…]` and `run.trees[…]`", "", (ArmHandle, TreeHandle)),
        ("`bt.run(…)` and `run.result` give a `RunResult`", "result.", (RunResult,)),
        ("`result.arms[…]`", "arm.", (ArmResult,)),
        ("`arm.leaves[…]`", "leaf.", (LeafResult,)),
        ("`bt.load(…)` gives a `RunData`", "data.", (RunData,)),
        ("`data.arms[…]`", "arm.", (ArmTrack,)),
        ("`arm.gripper`", "gripper.", (GripperTrack,)),
        ("`data.objects[…]`", "object.", (ObjectTrack,)),
        ("`data.frames(…)`", "frame.", (RecordedFrame,)),
        ("`bt.sweep(…)` gives a `SweepResult`", "result.", (SweepResult,)),
    ):
        rows = []
        for kind in kinds:
            first = prefix or f"{kind.__name__.removesuffix('Handle').lower()}."
            rows += [_public(kind, first), _members(kind, first)]
        parts += [f"### {title}\n", *_table(*rows)]
    return "\n".join(parts) + "\n"


PAGES: Final[Mapping[str, Callable[[], str]]] = {
    "skills.md": tables_of_skills,
    "python.md": tables_of_python,
}
"""Pages with generated tables, and what makes these."""


def renewed(page: str) -> str:
    """The page with regenerated tables."""
    text = (DOCS / page).read_text(encoding="utf-8")
    return _PLACE.sub(lambda _: "\n" + PAGES[page](), text)


def _table(*rows: Iterator[tuple[str, str]]) -> Iterator[str]:
    yield "| | |\n|---|---|"
    for group in rows:
        for code, words in group:
            yield f"| `{code}` | {_cell(words)} |"
    yield ""


def attributes_of(kind: type[Any]) -> dict[str, str]:
    """What the docstring of a class says of each attribute, in one line each."""
    text = (inspect.getdoc(kind) or "").replace("``", "`")
    return {name: " ".join(words.split()) for name, words in _ATTRIBUTE.findall(text)}


def _attributes(kind: type[Any], prefix: str) -> Iterator[tuple[str, str]]:
    for name, words in attributes_of(kind).items():
        if name not in _MACHINERY:
            yield f"{prefix}{name}", words


def _public(kind: type[Any], prefix: str) -> Iterator[tuple[str, str]]:
    """What is under ``Attributes:``, where ``_attributes`` takes arguments for such, too."""
    section = (inspect.getdoc(kind) or "").partition("Attributes:\n")[2].partition("Raises:")[0]
    names = {name for name, _ in _ATTRIBUTE.findall(section)}
    for name, words in attributes_of(kind).items():
        if name in names:
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
        is_for_skills = not getattr(member, "__module__", "").startswith(_FRONT_DOOR)
        if is_for_skills and (inspect.isclass(member) or inspect.isfunction(member)):
            yield name, _first_line(member)


def _first_line(member: Any) -> str:
    return (inspect.getdoc(member) or "").partition("\n\n")[0].replace("\n", " ")


def _cell(words: str) -> str:
    return words.replace("``", "`").replace("|", r"\|")


def main() -> None:
    """Write the pages."""
    for page in PAGES:
        (DOCS / page).write_text(renewed(page), encoding="utf-8")


if __name__ == "__main__":
    main()
