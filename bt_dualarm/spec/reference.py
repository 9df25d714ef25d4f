"""The reference and the JSON schema of the tree language, generated from the code."""

from __future__ import annotations

import inspect
import itertools
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, get_args

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from bt_dualarm.spec.cell import CellSignal, CellSpec, CellZone
from bt_dualarm.spec.document import (
    ArmSpec,
    CameraErrors,
    CameraSpec,
    DriveErrors,
    EncoderErrors,
    FrictionErrors,
    LimitShares,
    LinkErrors,
    NoiseSpec,
    ObjectSpec,
    PayloadErrors,
    RealitySpec,
    WorldSpec,
)
from bt_dualarm.spec.explain import model_name, names_of, notation_of, range_of
from bt_dualarm.spec.faults import KINDS
from bt_dualarm.spec.goals import SECTIONS, ConditionSpec
from bt_dualarm.spec.joints import PartJoint
from bt_dualarm.spec.many import ManySpec
from bt_dualarm.spec.node_types import (
    CONDITION_FIELDS,
    KEY,
    QUANTITY_PATTERN,
    LanguageNode,
    NodeType,
    Unit,
    unit_of,
)
from bt_dualarm.spec.parser import FORMAT, ParamSpec
from bt_dualarm.spec.path_keep import Facing, Keep
from bt_dualarm.spec.problems import NAME_PATTERN
from bt_dualarm.spec.relative_pose import RelativePose
from bt_dualarm.spec.shapes import PartSpec
from bt_dualarm.spec.texture import TextureSpec
from bt_dualarm.spec.values import (
    Angle,
    Color,
    Duration,
    HsvRange,
    JointPosition,
    Offset,
    Plane,
    PlaneOrFree,
    PoseSpec,
    Uncertainty,
)
from bt_dualarm.spec.yaml_reader import Json


@dataclass(frozen=True)
class PortDescription:
    """Text for one port or output.

    Attributes:
        name: Name in the file.
        type: Type such as ``number`` or ``list of 3 numbers``.
        unit: Unit of a bare number, empty if it has none.
        range: Bounds of its numbers, of its length or of its text, empty if there are none.
        default: Value in YAML notation, empty if there is none.
        description: One line.
        required: Whether it must be given.
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
    """Text for one node type, of the language or of a skill.

    Attributes:
        name: Name in the file.
        summary: One line.
        ports: Inputs in the order of their declaration.
        outputs: Values that it writes to the blackboard if the file names a key.
        children: Fields for children, each with a text that states what it takes.
        shorthand: Port that a bare value stands for, empty if there is none.
        bare_child: Whether the child may be written in its place.
        exactly_one_of: Ports of which exactly one must be given, if there are such.
        at_most_one_of: Ports of which one may be given, if there are such.
        needs_camera: Whether it works only with a camera that moves with the arm.
        needs_gripper: Whether it works only with an arm that has a gripper.
        failures: Failure codes with their meaning.
        example: A node in YAML.
        origin: Where it is defined.
    """

    name: str
    summary: str
    ports: tuple[PortDescription, ...]
    outputs: tuple[PortDescription, ...]
    children: Mapping[str, str]
    shorthand: str
    bare_child: bool
    exactly_one_of: tuple[str, ...]
    at_most_one_of: tuple[str, ...]
    needs_camera: bool
    needs_gripper: bool
    failures: Mapping[str, str]
    example: str
    origin: str


def describe(node_type: NodeType) -> Description:
    """Returns the description of a node type for authors of tree files."""
    return Description(
        node_type.name,
        node_type.summary,
        ports_of(node_type.ports),
        ports_of(node_type.outputs),
        _children_of(node_type),
        node_type.shorthand,
        node_type.bare_child,
        node_type.ports.exactly_one_of,
        node_type.ports.at_most_one_of,
        node_type.needs_camera,
        node_type.needs_gripper,
        dict(node_type.failures),
        node_type.example,
        node_type.origin,
    )


def ports_of(model: type[BaseModel]) -> tuple[PortDescription, ...]:
    """Returns a description of each field of a model."""
    return tuple(_port(name, field) for name, field in model.model_fields.items())


def summary_of(model: type[BaseModel]) -> str:
    """Returns the first line of a model's docstring."""
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
    """Returns a value in YAML notation."""
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


def _children_of(node_type: NodeType) -> dict[str, str]:
    children = {
        slot.name: "a node" if slot.required else "a node, or none" for slot in node_type.slots
    }
    if node_type.many:
        children = {"children": "a list of nodes", **children}
    if node_type.cases:
        children = {"cases": "a mapping from values to nodes", **children}
    return children


# Parts of a file besides its trees: world, objects, arms.


_NESTED: Final[tuple[type[BaseModel], ...]] = (
    CellSignal,
    CellZone,
    NoiseSpec,
    ManySpec,
    PartSpec,
    TextureSpec,
    PartJoint,
    LimitShares,
    CameraSpec,
    RealitySpec,
    LinkErrors,
    PayloadErrors,
    FrictionErrors,
    EncoderErrors,
    DriveErrors,
    CameraErrors,
)
_FILE_MODELS: Final[tuple[type[BaseModel], ...]] = (
    ParamSpec,
    WorldSpec,
    ObjectSpec,
    CellSpec,
    ArmSpec,
    ConditionSpec,
    *KINDS.values(),
    *_NESTED,
)
FILE_NAMES: Final = tuple(map(model_name, _FILE_MODELS))
"""Names of the parts of a file in the reference."""

NESTED_NAMES: Final = tuple(map(model_name, _NESTED))
"""Names of the parts that are types of a field of another part."""

OUTLINE: Final = """\
bt_dualarm: 1                      # version of the format
name: carry                        # by default the file's name
description: one-line description
params:                            # set them with bt-run FILE --param speed=0.2
  speed: {type: number, default: 0.5, range: [0.1, 1], description: speed of the arm}
include: []                        # files below this one's folder whose subtrees are used here
subtrees:                          # trees with their own parameters, for `subtree` nodes
  pause: {params: {time: {type: duration, default: 1}}, tree: {wait: "{time}"}}
world: {scene: empty}
objects:
  cube: {shape: box, size: [0.05, 0.05, 0.05], mass: 0.1, pose: {xyz: [0.5, 0, 0.5]}, fixed: true}
arms:
  arm1:
    robot: ur5
    tree: {sequence: [{subtree: {use: pause}}, {go_home: {speed: "{speed}"}}]}
goal:                              # conditions on the true world at the end; also: always, never
  in_place: {object: cube, at: {xyz: [0.5, 0, 0.5]}, within: 0.01}
"""
"""Example of a file with every part."""


def file_sections() -> Iterator[tuple[str, str, tuple[PortDescription, ...]]]:
    """Returns title, summary and fields of each part."""
    for model in _FILE_MODELS:
        yield model_name(model), summary_of(model), ports_of(model)


# Types of values with their own notation.


_VALUE_MODELS: Final[tuple[type[BaseModel], ...]] = (
    PoseSpec,
    RelativePose,
    Keep,
    Facing,
    Offset,
    Plane,
    PlaneOrFree,
    Color,
    HsvRange,
    Uncertainty,
)
_QUANTITIES: Final = {
    "duration": ("Simulated time", Duration, "500 ms"),
    "angle": ("A turn", Angle, "90 deg"),
    "joint position": ("Position of a joint", JointPosition, "20 cm"),
}
VALUE_NAMES: Final = (*_QUANTITIES, *map(model_name, _VALUE_MODELS))
"""Names of these types in the reference."""


def value_sections() -> Iterator[str]:
    """Returns a Markdown section for each type."""
    for name, (title, annotation, example) in _QUANTITIES.items():
        unit = next(item for item in get_args(annotation) if isinstance(item, Unit))
        others = ", ".join(f"`{other}`" for other in unit.others)
        yield f"### {name}\n"
        yield f"{title}: a number in {unit.yaml}, or text with a unit ({others}): `{example}`.\n"
    for model in _VALUE_MODELS:
        yield from _section(model)


def _section(model: type[BaseModel]) -> Iterator[str]:
    yield f"### {model_name(model)}\n"
    yield f"{summary_of(model)}\n"
    names = names_of(model)
    if names:
        yield f"Names: {', '.join(f'`{name}`' for name in names)}.\n"
    yield "| field | type | unit | range | |\n|---|---|---|---|---|"
    for name, field in model.model_fields.items():
        description = field.description or ""
        cells = (f"`{name}`", notation_of(field), unit_of(field), range_of(field), description)
        yield f"| {' | '.join(cells)} |"
    yield ""


# The reference in Markdown.


_HEAD: Final = """\
# Reference

The parts of a tree file, every node type of the tree language and every shipped skill, with ports,
bounds and failure codes. Generated from the code; `make docs` updates it.

In a file a node is its type with its ports: `circle: {radius: 0.1}`. Any port, or a
part of it, may be `"{key}"`, a parameter or a blackboard key, or an [expression](expressions.md) of
them, `"2 * {key}"`. `name:` next to the ports sets the displayed name; `skip_if`, `only_if` and
`until` next to them take a [condition](ticking.md#preconditions-and-postconditions).
See also [how trees are ticked and halted](ticking.md), and the [robots and scenes](robots.md):
joints, postures, camera mounts, reach, position of the table.
"""
_PORTS: Final = "| {} | type | unit | range | default | |\n|---|---|---|---|---|---|"


def reference_page(
    language: Mapping[str, LanguageNode],
    skills: Mapping[str, NodeType],
    standard_failures: Mapping[str, str],
) -> str:
    """Returns the reference in Markdown.

    Args:
        language: Node types of the language by name.
        skills: Node types of the skills by name.
        standard_failures: Codes that any skill may fail with, with their meaning.
    """
    groups: dict[str, Sequence[NodeType]] = {
        "Nodes with children": [each for each in language.values() if not each.is_leaf],
        "Leaves of the language": [each for each in language.values() if each.is_leaf],
        "Skills": [skills[name] for name in sorted(skills)],
    }
    parts = [_HEAD, *_index(groups), "## The file\n", f"```yaml\n{OUTLINE}```\n"]
    for part, summary, fields in file_sections():
        parts += [f"### {part}\n", f"{summary}\n", _table("field", fields)]
    for title, node_types in groups.items():
        parts.append(f"## {title}\n")
        if title == "Skills":
            parts.append(_failures("any skill may fail with", standard_failures))
        parts += [part for node_type in node_types for part in _node(describe(node_type))]
    parts.append("## Values\n")
    parts += value_sections()
    return "\n".join(parts).rstrip() + "\n"


def _index(groups: Mapping[str, Iterable[NodeType]]) -> Iterator[str]:
    yield f"- [The file](#the-file): {_links(FILE_NAMES)}"
    for title, node_types in groups.items():
        links = ", ".join(f"[`{node_type.name}`](#{node_type.name})" for node_type in node_types)
        yield f"- [{title}](#{_anchor(title)}): {links}"
    yield f"- [Values](#values): {_links(VALUE_NAMES)}\n"


def _links(names: Iterable[str]) -> str:
    return ", ".join(f"[{name}](#{_anchor(name)})" for name in names)


def _node(node: Description) -> Iterator[str]:
    yield f"### `{node.name}`\n"
    yield f"{node.summary.rstrip('.')}.\n"
    yield f"```yaml\n{node.example}\n```\n"
    if node.children:
        fields = (f"`{field}` {takes}" for field, takes in node.children.items())
        yield f"Children: {'; '.join(fields)}.\n"
    if node.shorthand:
        yield f"A bare value is its `{node.shorthand}`.\n"
    if node.bare_child:
        yield "The child may also be written in its place.\n"
    for rule, choice in (("Exactly", node.exactly_one_of), ("At most", node.at_most_one_of)):
        if choice:
            yield f"{rule} one of {', '.join(f'`{name}`' for name in choice)} is given.\n"
    if node.needs_camera:
        yield "The arm needs a camera that moves with it.\n"
    if node.needs_gripper:
        yield "The arm needs a gripper.\n"
    if node.ports:
        yield _table("port", node.ports)
    if node.outputs:
        yield _table("output", node.outputs)
    if node.failures:
        yield _failures("fails with", node.failures)


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
    """Escapes text that would end a cell or be taken for markup."""
    text = re.sub(r"matches (\S+)", r"matches `\1`", text)
    return text.replace("|", r"\|")


def _linked(text: str) -> str:
    """Links each type of value in a text to its section."""
    explained = (*VALUE_NAMES, *NESTED_NAMES)
    names = "|".join(sorted(map(re.escape, explained), key=len, reverse=True))
    return re.sub(rf"\b({names})(s?)\b", lambda m: f"[{m[1]}{m[2]}](#{_anchor(m[1])})", _cell(text))


def _anchor(title: str) -> str:
    return title.lower().replace(" ", "-")


# JSON Schema (draft 2020-12) of the format with the installed skills, for completion in editors.
# It cannot express, and leaves to the check: that names exist, that keys are written before they
# are read, that values fit each other (one orientation per pose, a size that fits its shape), that
# quantities with units are in range, that parameters are known.


_REFERENCE: Final[Json] = {"$ref": "#/$defs/reference"}
_DYNAMIC: Final[Json] = {"$ref": "#/$defs/dynamic"}
_NODE: Final[Json] = {"$ref": "#/$defs/node"}
_KEY_PATTERN: Final = f"^{KEY.pattern}$"
# pydantic keeps its own names for bounds that follow a validator or belong to a union.
_BOUNDS: Final = {
    "ge": "minimum",
    "gt": "exclusiveMinimum",
    "le": "maximum",
    "lt": "exclusiveMaximum",
}
_TEXT: Final[Json] = {"type": "string"}


def json_schema(node_types: Mapping[str, NodeType]) -> Json:
    """Returns the schema of a tree file, or of one to include.

    Args:
        node_types: Node types by name, of the language and of the skills.
    """
    definitions: Json = {
        "reference": {
            "description": 'A parameter, or a blackboard key: "{key}".',
            "type": "string",
            "pattern": r"^\{" + KEY.pattern + r"\}$",
        },
        "dynamic": {
            "description": 'A parameter or a blackboard key, "{key}", an expression of them: '
            '"2 * {key}", or a number with a unit: "6 cm".',
            "type": "string",
            "pattern": r"\{" + KEY.pattern + rf"\}}|{QUANTITY_PATTERN}",
        },
    }
    bodies = {name: _body(node_type, definitions) for name, node_type in sorted(node_types.items())}
    bare = [name for name, node_type in sorted(node_types.items()) if _can_be_bare(node_type)]
    definitions["node"] = {
        "description": "One node: its kind and its ports.",
        "anyOf": [
            {"enum": bare},
            {
                "type": "object",
                "properties": bodies,
                "additionalProperties": False,
                "minProperties": 1,
                "maxProperties": 1,
            },
            {"$ref": "#/$defs/dynamic", "description": "A condition: short for `test`."},
        ],
    }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "A tree file of bt_dualarm",
        **_file(definitions),
        "$defs": definitions,
    }


def _file(definitions: Json) -> Json:
    arm = _model(ArmSpec, definitions)
    arm["properties"]["tree"] = _NODE
    params = {"type": "object", **_named(_model(ParamSpec, definitions), _KEY_PATTERN)}
    subtree = {
        "type": "object",
        "properties": {"description": _TEXT, "params": params, "tree": _NODE},
        "required": ["tree"],
        "additionalProperties": False,
    }
    return {
        "type": "object",
        "properties": {
            "bt_dualarm": {"const": FORMAT, "description": "Version of the format."},
            "name": _or_reference(_TEXT),
            "description": _or_reference(_TEXT),
            "params": params,
            "include": {"type": "array", "items": _TEXT},
            "subtrees": {"type": "object", **_named(subtree, _KEY_PATTERN)},
            "world": _model(WorldSpec, definitions),
            "objects": {"type": "object", **_named(_model(ObjectSpec, definitions), NAME_PATTERN)},
            "cell": _model(CellSpec, definitions),
            "arms": {"type": "object", "minProperties": 1, **_named(arm, NAME_PATTERN)},
            **{
                section: {
                    "type": "object",
                    **_named(_model(ConditionSpec, definitions), NAME_PATTERN),
                }
                for section in SECTIONS
            },
            "faults": {
                "type": "object",
                **_named(
                    {"anyOf": [_model(kind, definitions) for kind in KINDS.values()]}, NAME_PATTERN
                ),
            },
        },
        "required": ["bt_dualarm"],
        "anyOf": [{"required": ["arms"]}, {"required": ["subtrees"]}],
        "additionalProperties": False,
    }


def _named(item: Json, pattern: str) -> Json:
    return {"propertyNames": {"pattern": pattern}, "additionalProperties": item}


def _required(node_type: NodeType) -> list[str]:
    """Returns the fields that a node of this type must have."""
    ports = [name for name, field in node_type.ports.model_fields.items() if field.is_required()]
    slots = [slot.name for slot in node_type.slots if slot.required]
    return ports + slots + ["children"] * node_type.many + ["cases"] * node_type.cases


def _can_be_bare(node_type: NodeType) -> bool:
    """Returns whether its name alone is a node."""
    return not _required(node_type) and not node_type.ports.exactly_one_of


def _body(node_type: NodeType, definitions: Json) -> Json:
    mapping = _model(node_type.ports, definitions)
    properties = mapping["properties"]
    properties["name"] = {"type": "string", "description": "Displayed name."}
    properties |= dict.fromkeys(node_type.outputs.model_fields, _REFERENCE)
    properties |= {slot.name: _NODE for slot in node_type.slots}
    properties |= dict.fromkeys(CONDITION_FIELDS, _NODE)
    children = {"type": "array", "items": _NODE, "minItems": 1}
    if node_type.many:
        properties["children"] = children
    if node_type.cases:
        properties["cases"] = {"type": "object", "additionalProperties": _NODE, "minProperties": 1}
    mapping["required"] = _required(node_type)
    if node_type.ports.exactly_one_of:
        mapping["oneOf"] = [{"required": [name]} for name in node_type.ports.exactly_one_of]
    if node_type.ports.at_most_one_of:
        pairs = itertools.combinations(node_type.ports.at_most_one_of, 2)
        mapping["allOf"] = [
            {"anyOf": [{"properties": {name: False}} for name in pair]} for pair in pairs
        ]
    if node_type.ports.goes_with:
        mapping["dependentRequired"] = {a: [b] for a, b in node_type.ports.goes_with.items()}
    forms: list[Json] = [mapping]
    if node_type.many:
        forms.append(children)
    if node_type.shorthand:
        forms.append(properties[node_type.shorthand])
    if node_type.bare_child:
        forms.append(_NODE)
    if _can_be_bare(node_type):
        forms.append({"type": "null"})
    return {"description": node_type.summary, "anyOf": forms}


def _model(model: type[BaseModel], definitions: Json) -> Json:
    """Returns the schema of a model; adds those of nested models to the definitions."""
    plain = model.model_json_schema()
    for name, inner in plain.pop("$defs", {}).items():
        definitions.setdefault(name, _with_references(inner))
    schema = _with_references(plain)
    schema.setdefault("properties", {})
    schema.setdefault("additionalProperties", False)
    schema.pop("title", None)
    return schema


def _with_references(schema: Json) -> Json:
    """Returns the schema with a reference allowed for every value in a mapping or a list."""
    changed = {_BOUNDS.get(key, key): value for key, value in schema.items() if key != "title"}
    if "description" in changed:
        changed["description"] = changed["description"].partition("\n\n")[0]
    if "oneOf" in changed:  # a reference may fit several
        changed["anyOf"] = changed.pop("oneOf")
    if "properties" in changed:
        properties = changed["properties"].items()
        changed["properties"] = {n: _or_reference(_with_references(p)) for n, p in properties}
    for key in ("items", "additionalProperties"):
        if isinstance(changed.get(key), dict):
            changed[key] = _or_reference(_with_references(changed[key]))
    if "prefixItems" in changed:
        items = changed["prefixItems"]
        changed["prefixItems"] = [_or_reference(_with_references(item)) for item in items]
    if "anyOf" in changed:
        changed["anyOf"] = [_with_references(item) for item in changed["anyOf"]]
    return changed


def _or_reference(schema: Json) -> Json:
    about: Json = {key: schema[key] for key in ("description", "default", "unit") if key in schema}
    plain: Json = {key: value for key, value in schema.items() if key not in about}
    forms = plain["anyOf"] if plain.keys() == {"anyOf"} else [plain]
    return {**about, "anyOf": [*forms, _DYNAMIC]}


def schema_text(node_types: Mapping[str, NodeType]) -> str:
    """Returns `json_schema` as the text of a file."""
    return json.dumps(json_schema(node_types), indent=1, ensure_ascii=False) + "\n"
