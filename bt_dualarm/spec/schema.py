"""JSON Schema (draft 2020-12) of the whole format with the skills that are installed.

For editors: it completes and marks while one types. What it cannot say, the check alone says:
that names exist, keys are written before they are read, values fit each other (one orientation
to a pose, a size that fits its shape), quantities with units are in range, parameters are known.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Final

from pydantic import BaseModel

from bt_dualarm.spec.document import ArmSpec, ObjectSpec, WorldSpec
from bt_dualarm.spec.kind import Kind
from bt_dualarm.spec.language import LANGUAGE
from bt_dualarm.spec.library import FORMAT
from bt_dualarm.spec.name import NAME_PATTERN
from bt_dualarm.spec.params import ParamSpec
from bt_dualarm.spec.ports import KEY
from bt_dualarm.spec.source import Json

_REFERENCE: Final[Json] = {"$ref": "#/$defs/reference"}
_NODE: Final[Json] = {"$ref": "#/$defs/node"}
_KEY_PATTERN: Final = f"^{KEY.pattern}$"
# pydantic leaves its own names of bounds that follow a validator or are those of a union.
_BOUNDS: Final = {
    "ge": "minimum",
    "gt": "exclusiveMinimum",
    "le": "maximum",
    "lt": "exclusiveMaximum",
}
_TEXT: Final[Json] = {"type": "string"}


def json_schema(skills: Mapping[str, Kind]) -> Json:
    """The schema of a tree file, or of one to include.

    Args:
        skills: Skills by name.
    """
    definitions: Json = {
        "reference": {
            "description": 'A parameter, or a key of the blackboard: "{key}".',
            "type": "string",
            "pattern": r"^\{" + KEY.pattern + r"\}$",
        }
    }
    kinds = {**LANGUAGE, **skills}
    bodies = {name: _body(kind, definitions) for name, kind in sorted(kinds.items())}
    bare = [name for name, kind in sorted(kinds.items()) if _can_be_bare(kind)]
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
            "arms": {"type": "object", "minProperties": 1, **_named(arm, NAME_PATTERN)},
        },
        "required": ["bt_dualarm"],
        "anyOf": [{"required": ["arms"]}, {"required": ["subtrees"]}],
        "additionalProperties": False,
    }


def _named(item: Json, pattern: str) -> Json:
    return {"propertyNames": {"pattern": pattern}, "additionalProperties": item}


def _required(kind: Kind) -> list[str]:
    """What a node of this kind cannot do without."""
    ports = [name for name, field in kind.ports.model_fields.items() if field.is_required()]
    slots = [slot.name for slot in kind.slots if slot.required]
    return ports + slots + ["children"] * kind.many + ["cases"] * kind.cases


def _can_be_bare(kind: Kind) -> bool:
    """Whether its name alone is a node."""
    return not _required(kind) and not kind.ports.exactly_one_of


def _body(kind: Kind, definitions: Json) -> Json:
    mapping = _model(kind.ports, definitions)
    properties = mapping["properties"]
    properties["name"] = {"type": "string", "description": "Shown to people."}
    properties |= dict.fromkeys(kind.outputs.model_fields, _REFERENCE)
    properties |= {slot.name: _NODE for slot in kind.slots}
    children = {"type": "array", "items": _NODE, "minItems": 1}
    if kind.many:
        properties["children"] = children
    if kind.cases:
        properties["cases"] = {"type": "object", "additionalProperties": _NODE, "minProperties": 1}
    mapping["required"] = _required(kind)
    if kind.ports.exactly_one_of:
        mapping["oneOf"] = [{"required": [name]} for name in kind.ports.exactly_one_of]
    if kind.ports.goes_with:
        mapping["dependentRequired"] = {a: [b] for a, b in kind.ports.goes_with.items()}
    forms: list[Json] = [mapping]
    if kind.many:
        forms.append(children)
    if kind.shorthand:
        forms.append(properties[kind.shorthand])
    if _can_be_bare(kind):
        forms.append({"type": "null"})
    return {"description": kind.summary, "anyOf": forms}


def _model(model: type[BaseModel], definitions: Json) -> Json:
    """The schema of a model; those of the models in it go to the definitions."""
    plain = model.model_json_schema()
    for name, inner in plain.pop("$defs", {}).items():
        definitions.setdefault(name, _with_references(inner))
    schema = _with_references(plain)
    schema.setdefault("properties", {})
    schema.setdefault("additionalProperties", False)
    schema.pop("title", None)
    return schema


def _with_references(schema: Json) -> Json:
    """The same schema, where every value in a mapping or a list can be a reference, too."""
    changed = {_BOUNDS.get(key, key): value for key, value in schema.items() if key != "title"}
    if "description" in changed:
        changed["description"] = changed["description"].partition("\n\n")[0]
    if "oneOf" in changed:  # a reference may fit several
        changed["anyOf"] = changed.pop("oneOf")
    if "properties" in changed:
        properties = changed["properties"].items()
        changed["properties"] = {n: _or_reference(_with_references(p)) for n, p in properties}
    for place in ("items", "additionalProperties"):
        if isinstance(changed.get(place), dict):
            changed[place] = _or_reference(_with_references(changed[place]))
    if "prefixItems" in changed:
        items = changed["prefixItems"]
        changed["prefixItems"] = [_or_reference(_with_references(item)) for item in items]
    if "anyOf" in changed:
        changed["anyOf"] = [_with_references(item) for item in changed["anyOf"]]
    return changed


def _or_reference(schema: Json) -> Json:
    told: Json = {key: schema[key] for key in ("description", "default", "unit") if key in schema}
    plain: Json = {key: value for key, value in schema.items() if key not in told}
    forms = plain["anyOf"] if plain.keys() == {"anyOf"} else [plain]
    return {**told, "anyOf": [*forms, _REFERENCE]}


def schema_text(skills: Mapping[str, Kind]) -> str:
    """`json_schema` as it is written to a file, for editors."""
    return json.dumps(json_schema(skills), indent=1, ensure_ascii=False) + "\n"
