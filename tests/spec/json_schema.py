"""A validator for that part of JSON Schema (2020-12) which ours is written in.

Refuses a schema with any other keyword, so that it cannot pass over what it does not know.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

TYPES: Mapping[str, tuple[type, ...]] = {
    "object": (dict,),
    "array": (list,),
    "string": (str,),
    "number": (int, float),
    "integer": (int,),
    "boolean": (bool,),
    "null": (type(None),),
}
SAYS_NOTHING = {"description", "default", "title", "$schema", "$defs", "unit"}


def is_valid(data: Any, schema: Mapping[str, Any], root: Mapping[str, Any] | None = None) -> bool:
    root = root if root is not None else schema
    unknown = schema.keys() - KEYWORDS.keys() - SAYS_NOTHING
    assert not unknown, unknown
    return all(KEYWORDS[key](data, schema, root) for key in schema if key in KEYWORDS)


def _type(data: Any, schema: Any, _: Any) -> bool:
    if isinstance(data, bool):
        return bool(schema["type"] == "boolean")
    return isinstance(data, TYPES[schema["type"]])


def _reference(data: Any, schema: Any, root: Any) -> bool:
    return is_valid(data, root["$defs"][schema["$ref"].removeprefix("#/$defs/")], root)


def _properties(data: Any, schema: Any, root: Any) -> bool:
    if not isinstance(data, dict):
        return True
    known = schema.get("properties", {})
    others = schema.get("additionalProperties", True)
    for name, item in data.items():
        if name in known:
            fits = is_valid(item, known[name], root)
        else:
            fits = others if isinstance(others, bool) else is_valid(item, others, root)
        if not fits:
            return False
    return True


def _items(data: Any, schema: Any, root: Any) -> bool:
    if not isinstance(data, list):
        return True
    first = schema.get("prefixItems", [])
    if not all(is_valid(i, s, root) for i, s in zip(data, first, strict=False)):
        return False
    rest = schema.get("items", {})
    return all(is_valid(item, rest, root) for item in data[len(first) :])


def _sized(key: str, kind: type[Any], fits: Callable[[int, int], bool]) -> Callable[..., bool]:
    def check(data: Any, schema: Any, _: Any) -> bool:
        return not isinstance(data, kind) or fits(len(data), schema[key])

    return check


def _compared(key: str, fits: Callable[[float, float], bool]) -> Callable[..., bool]:
    def check(data: Any, schema: Any, _: Any) -> bool:
        number = isinstance(data, (int, float)) and not isinstance(data, bool)
        return not number or fits(data, schema[key])

    return check


KEYWORDS: Mapping[str, Callable[[Any, Any, Any], bool]] = {
    "type": _type,
    "$ref": _reference,
    "properties": _properties,
    "additionalProperties": _properties,
    "items": _items,
    "prefixItems": _items,
    "anyOf": lambda data, schema, root: any(is_valid(data, s, root) for s in schema["anyOf"]),
    "const": lambda data, schema, _: data == schema["const"] and type(data) is not bool,
    "enum": lambda data, schema, _: data in schema["enum"],
    "required": lambda data, schema, _: (
        not isinstance(data, dict) or set(schema["required"]) <= data.keys()
    ),
    "propertyNames": lambda data, schema, root: (
        not isinstance(data, dict) or all(is_valid(n, schema["propertyNames"], root) for n in data)
    ),
    "pattern": lambda data, schema, _: (
        not isinstance(data, str) or re.search(schema["pattern"], data) is not None
    ),
    "minProperties": _sized("minProperties", dict, lambda n, m: n >= m),
    "maxProperties": _sized("maxProperties", dict, lambda n, m: n <= m),
    "minItems": _sized("minItems", list, lambda n, m: n >= m),
    "maxItems": _sized("maxItems", list, lambda n, m: n <= m),
    "minLength": _sized("minLength", str, lambda n, m: n >= m),
    "maxLength": _sized("maxLength", str, lambda n, m: n <= m),
    "minimum": _compared("minimum", lambda n, m: n >= m),
    "maximum": _compared("maximum", lambda n, m: n <= m),
    "exclusiveMinimum": _compared("exclusiveMinimum", lambda n, m: n > m),
    "exclusiveMaximum": _compared("exclusiveMaximum", lambda n, m: n < m),
}
