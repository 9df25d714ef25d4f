"""What may be written for a node, as plain data: for the reference, and for ``bt-skills``."""

from __future__ import annotations

import inspect
import json
from collections.abc import Mapping
from dataclasses import dataclass

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from bt_dualarm.spec.kind import Kind
from bt_dualarm.spec.notation import notation_of, range_of
from bt_dualarm.spec.ports import unit_of


@dataclass(frozen=True)
class PortDescription:
    """One port or output, every part of it in words.

    Attributes:
        name: Name in the file.
        type: Words for what is written there, such as ``number`` or ``list of 3 numbers``.
        unit: Unit of a bare number, empty if it has none.
        range: Bounds of its numbers, of its length or of its text, empty if there are none.
        default: Value in YAML's notation, empty if there is none.
        description: One line.
        required: Whether a node cannot do without.
    """

    name: str
    type: str
    unit: str
    range: str
    default: str
    description: str
    required: bool


@dataclass(frozen=True)
class Description:
    """One word of the language, or one skill.

    Attributes:
        name: Name in the file.
        summary: One line.
        ports: Inputs in the order of their declaration.
        outputs: Values that it writes to the blackboard where the file names a key.
        children: Places for children, each with the words that say what stands there.
        shorthand: The port that a bare value stands for, if there is one.
        exactly_one_of: Ports of which a node is given exactly one, if there are such.
        needs_camera: Whether it works only with a camera that moves with the arm.
        needs_gripper: Whether it works only with an arm that has a gripper.
        failures: Codes of its failures with their meaning.
        example: YAML of one node.
        origin: Place it comes from.
    """

    name: str
    summary: str
    ports: tuple[PortDescription, ...]
    outputs: tuple[PortDescription, ...]
    children: Mapping[str, str]
    shorthand: str
    exactly_one_of: tuple[str, ...]
    needs_camera: bool
    needs_gripper: bool
    failures: Mapping[str, str]
    example: str
    origin: str


def describe(kind: Kind) -> Description:
    """Everything that an author of tree files can know of a node."""
    return Description(
        kind.name,
        kind.summary,
        ports_of(kind.ports),
        ports_of(kind.outputs),
        _children_of(kind),
        kind.shorthand,
        kind.ports.exactly_one_of,
        kind.needs_camera,
        kind.needs_gripper,
        dict(kind.failures),
        kind.example,
        kind.origin,
    )


def ports_of(model: type[BaseModel]) -> tuple[PortDescription, ...]:
    """The fields of a model, each in words."""
    return tuple(_port(name, field) for name, field in model.model_fields.items())


def summary_of(model: type[BaseModel]) -> str:
    """The first line of a model's docstring."""
    text = inspect.getdoc(model) or ""
    return text.partition("\n")[0].replace("``", "`")


def _port(name: str, field: FieldInfo) -> PortDescription:
    return PortDescription(
        name,
        notation_of(field),
        unit_of(field),
        range_of(field),
        _default_of(field),
        field.description or "",
        field.is_required(),
    )


def _default_of(field: FieldInfo) -> str:
    if field.is_required() or field.default is None:
        return ""
    return _written(field.default)


def _written(value: object) -> str:
    """A value as a file would have it."""
    if isinstance(value, str):
        return value
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_written, value))}]"
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, BaseModel):
        given = value.model_dump(exclude_unset=True).items()
        return f"{{{', '.join(f'{name}: {_written(item)}' for name, item in given)}}}"
    return json.dumps(value, ensure_ascii=False)


def _children_of(kind: Kind) -> dict[str, str]:
    children = {slot.name: "a node" if slot.required else "a node, or none" for slot in kind.slots}
    if kind.many:
        children = {"children": "a list of nodes", **children}
    if kind.cases:
        children = {"cases": "a mapping from values to nodes", **children}
    return children
