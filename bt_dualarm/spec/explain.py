"""Explains the types of ports, and pydantic's errors, to authors of tree files."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import UnionType
from typing import Annotated, Any, Final, Literal, TypeAlias, Union, get_args, get_origin

from pydantic import BaseModel, Tag, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from bt_dualarm.spec.node_types import (
    QUANTITY,
    NodeSpec,
    PortModel,
    Template,
    Unit,
    WrittenKey,
    bare,
    containers_in,
    counted,
    fixed_length,
    in_words,
    is_unknown,
    key_name,
    list_of,
    mapping_of,
    models_in,
    number_in,
    reference_of,
    unit_of,
    validated,
)
from bt_dualarm.spec.problems import is_name, meant_by, nearest, suggestion
from bt_dualarm.spec.values import Refers
from bt_dualarm.spec.yaml_reader import Data, DataPath, Json

# Types and bounds of ports as text.

_TYPE_NAMES: Final[Mapping[object, str]] = {
    bool: "true or false",
    int: "whole number",
    float: "number",
    str: "text",
    Any: "any value",
    NodeSpec: "node",
}
_QUANTITIES: Final = {"s": "duration", "deg": "angle", "deg or m": "joint position"}
_BOUNDS: Final = {
    "gt": ("lower", ">"),
    "ge": ("lower", "≥"),
    "lt": ("upper", "<"),
    "le": ("upper", "≤"),
}


def notation_of(field: FieldInfo) -> str:
    """Returns the type of a field as text, such as ``number`` or ``list of 3 numbers``."""
    return _special(field.metadata) or _type_name(field.annotation)


def range_of(field: FieldInfo) -> str:
    """Returns the bounds of a field, such as ``> 0, ≤ 100`` or ``length ≥ 1``; empty if none."""
    found = list(_constraints([*field.metadata, field.annotation]))
    patterns = (getattr(item, "pattern", None) for item in found)
    pattern = next((f"matches {one}" for one in patterns if isinstance(one, str)), "")
    return ", ".join(part for part in (_numbers(found), _length(found), pattern) if part)


def model_name(model: type[BaseModel]) -> str:
    """Returns the name of a type of values in the reference: ``PoseSpec`` is a pose."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", model.__name__.removesuffix("Spec")).lower()


def names_of(model: type[BaseModel]) -> list[str]:
    """Returns the names that may be written instead of a model's fields."""
    forms: list[Json] = model.model_json_schema().get("anyOf", [])
    return [name for form in forms for name in form.get("enum", [])]


def _names_instead(annotation: object) -> list[str] | None:
    """Names that may be written for a value of a type, None if it may be any text."""
    if annotation in (str, Any):
        return None
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return names_of(annotation)
    if get_origin(annotation) is Literal:
        return [choice for choice in get_args(annotation) if isinstance(choice, str)]
    names: list[str] = []
    if get_origin(annotation) in (Annotated, Union, UnionType):
        for member in get_args(annotation):
            found = _names_instead(member)
            if found is None:
                return None
            names += found
    return names


def _may_be_a_number(model: type[BaseModel]) -> bool:
    """Whether a number may be written instead of a model's fields."""
    forms: list[Json] = model.model_json_schema().get("anyOf", [])
    return any(form.get("type") == "number" for form in forms)


def _type_name(annotation: object) -> str:
    origin = get_origin(annotation)
    arguments = get_args(annotation)
    if annotation in _TYPE_NAMES:
        return _TYPE_NAMES[annotation]
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return model_name(annotation)
    if origin is Annotated:
        return _special(arguments[1:]) or _type_name(arguments[0])
    if origin is Literal:
        return " or ".join(str(choice) for choice in arguments)
    if origin in (Union, UnionType):
        members = (_type_name(member) for member in arguments if member is not type(None))
        return " or ".join(dict.fromkeys(members))
    if origin is tuple:
        items = _plural(_type_name(arguments[0]))
        has_any_length = arguments[-1] is Ellipsis
        return f"list of {items}" if has_any_length else f"list of {len(arguments)} {items}"
    if origin is list:
        return f"list of {_plural(_type_name(arguments[0]))}"
    if origin is dict:
        return f"mapping from names to {_plural(_type_name(arguments[1]))}"
    return str(annotation)


def _plural(name: str) -> str:
    """Returns the plural of a type's name: ``lists of 2 numbers``."""
    head, of, rest = name.partition(" of ")
    if name.endswith("value") or " or " in head:  # any of several may be several, too
        return name
    return f"{head}s{of}{rest}"


def _special(metadata: Iterable[object]) -> str:
    """Returns the name of a type that its metadata determines, empty if they determine none."""
    for item in metadata:
        if isinstance(item, Unit):
            return _QUANTITIES.get(item.yaml, "quantity")
        if isinstance(item, Refers):
            article = "an" if item.to[0][0] in "aeiou" else "a"
            return f"name of {article} {' or '.join(item.to)}"
        if isinstance(item, WrittenKey):
            return "name of a key"
        if isinstance(item, Template):
            return "text with {key}"
    return ""


def _constraints(items: Sequence[object]) -> Iterator[object]:
    """Yields the metadata of a field and of all members of its type."""
    for item in items:
        if isinstance(item, FieldInfo):
            yield from item.metadata
        elif isinstance(item, type) and issubclass(item, BaseModel):
            continue
        else:
            yield item
            yield from _constraints([*getattr(item, "__metadata__", ()), *get_args(item)])


def _numbers(found: list[object]) -> str:
    tightest: dict[str, tuple[float, str]] = {}
    for attribute, (end, sign) in _BOUNDS.items():
        for bound in _given(found, attribute):
            if end not in tightest or _tighter(end, (bound, sign), tightest[end]):
                tightest[end] = (bound, sign)
    bounds = (tightest[end] for end in ("lower", "upper") if end in tightest)
    return ", ".join(
        f"{sign} {bound}" if isinstance(bound, int) else f"{sign} {bound:.9g}"
        for bound, sign in bounds
    )


def _given(found: list[object], attribute: str) -> list[int | float]:
    """Returns the values of one bound in metadata of any class with such an attribute."""
    values = (getattr(item, attribute, None) for item in found)
    return [value for value in values if isinstance(value, (int, float))]


def _tighter(end: str, new: tuple[float, str], old: tuple[float, str]) -> bool:
    if new[0] == old[0]:
        return new[1] in "<>"
    return (new[0] > old[0]) == (end == "lower")


def _length(found: list[object]) -> str:
    least = max(_given(found, "min_length"), default=0)
    most = min(_given(found, "max_length"), default=0)
    if least and most:
        return f"length {least} to {most}"
    return f"length ≥ {least}" if least else f"length ≤ {most}" if most else ""


# Locations of pydantic's errors.

Location: TypeAlias = tuple[int | str, ...]
"""Keys and indices, with pydantic's names of union members between them."""


def type_at(model: type[BaseModel], location: Location) -> object:
    """Returns the annotation of the value at a location."""
    annotation: object = model
    for part in location:
        annotation = _step(annotation, part)
    return annotation


def field_at(model: type[BaseModel], location: Location) -> FieldInfo | None:
    """Returns the innermost declared field that a location passes through."""
    annotation: object = model
    field = None
    for part in location:
        for found in models_in(annotation):
            field = found.model_fields.get(str(part), field)
        annotation = _step(annotation, part)
    return field


def path_in(data: Data, location: Location) -> DataPath:
    """Returns the path in the data of a location, without the names of union members."""
    path: DataPath = ()
    for part in location:
        if isinstance(part, int):
            fits = isinstance(data, (list, tuple)) and part < len(data)
        else:
            fits = isinstance(data, dict) and part in data
        if fits:
            data = data[part]
            path = (*path, part)
    return path


def _step(annotation: object, part: int | str) -> object:
    """Returns the type of a part of a value; the type itself if the part is a union's member."""
    for model in models_in(annotation):
        if part in model.model_fields:
            return model.model_fields[str(part)].annotation
    for member in containers_in(annotation):
        if isinstance(part, int) and get_origin(member) in (tuple, list):
            items = get_args(member)
            return items[min(part, len(items) - 1)] if items[-1] is not ... else items[0]
        if get_origin(member) is dict and part not in ("[key]",):
            return get_args(member)[1]
    return _tagged(annotation, part) or annotation


def _tagged(annotation: object, tag: int | str) -> object | None:
    """Returns the member of a union that has a tag, None if there is none."""
    if get_origin(annotation) is Annotated:
        inner, *metadata = get_args(annotation)
        if any(isinstance(item, Tag) and item.tag == tag for item in metadata):
            return annotation
        return _tagged(inner, tag)
    if get_origin(annotation) in (Union, UnionType):
        found = (_tagged(member, tag) for member in get_args(annotation))
        return next((member for member in found if member is not None), None)
    return None


# Numbers with a unit.


def in_base_units(data: Data, validate: Callable[[Data], object], model: type[BaseModel]) -> Data:
    """Returns data in which numbers stand for texts with a unit: 0.06 for ``6 cm``.

    Only where a number with a unit of the same quantity is expected: text remains text.

    Args:
        data: Data with the types of YAML.
        validate: Validates the data against the model; raises ValidationError.
        model: Model of the data.
    """
    if not _has_quantity(data):
        return data
    try:
        validate(data)
    except ValidationError as error:
        for details in error.errors(include_url=False):
            given = details["input"]
            unit = _unit_at(model, details["loc"])
            # A number stands for the model of an uncertainty, so that text is no number there.
            is_wanted = details["type"] in ("float_type", "model_type")
            if is_wanted and isinstance(given, str) and unit:
                number = number_in(given, unit)
                if number is not None:
                    data = _with(data, path_in(data, details["loc"]), number)
    return data


def _unit_at(model: type[BaseModel], location: Location) -> str:
    """Unit of the number at a location: of an uncertainty, that of the field that has it."""
    unit = ""
    for end in range(1, len(location) + 1):
        field = field_at(model, location[:end])
        unit = (unit_of(field) if field else "") or unit
    return unit


def valid_in_units(model: type[PortModel], ports: Mapping[str, Data]) -> PortModel:
    """Returns the validated ports of a node, which may have texts with a unit: as `validated`."""
    numbers = in_base_units(dict(ports), lambda data: validated(model, data), model)
    return validated(model, numbers)


def _has_quantity(data: Data) -> bool:
    if isinstance(data, str):
        return QUANTITY.fullmatch(data) is not None
    if isinstance(data, (dict, list, tuple)):
        return any(map(_has_quantity, data.values() if isinstance(data, dict) else data))
    return False


def _with(data: Data, path: DataPath, value: Data) -> Data:
    """Returns data with another value at a path; the given data stay unchanged."""
    if not path:
        return value
    first, *rest = path
    if isinstance(data, dict):
        return {**data, first: _with(data[first], tuple(rest), value)}
    items = list(data)
    items[int(first)] = _with(items[int(first)], tuple(rest), value)
    return type(data)(items)


# Messages for pydantic's errors.

_WANTED: Final = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "string_type": "text",
    "tuple_type": "a list",
    "list_type": "a list",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "finite_number": "a finite number",
}
_COMPARED: Final = {
    "greater_than": ("gt", "greater than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}
_OTHER_UNIT: Final = 5
"""Least number beyond a bound that seems to be one of millimeters or parts of 255."""

_PERCENT: Final = 10
"""Least number beyond a share of 1 that seems to be one of percent."""

_COUNTED: Final = {
    "too_long": ("most", "max_length", "item"),
    "too_short": ("least", "min_length", "item"),
    "string_too_long": ("most", "max_length", "character"),
    "string_too_short": ("least", "min_length", "character"),
}
_COMPONENTS: Final = {"xyz": ("x", "y", "z"), "rpy": ("roll", "pitch", "yaw")}
"""Names of the components of vectors in other formats, by the name of the vector."""

_NAME_RULE: Final = "a name begins with a letter and has at most 48 letters, digits, _ and -"


@dataclass(frozen=True)
class Finding:
    """An error in data, without its location in a file.

    Attributes:
        path: Path in the data that was validated; a missing field has that of its parent.
        message: Sentence that states the error.
        hint: What was expected; may be empty.
        at_key: Whether the key is wrong rather than the value.
    """

    path: DataPath
    message: str
    hint: str = ""
    at_key: bool = False


def explain(
    error: ValidationError,
    model: type[BaseModel],
    data: Data,
    noun: str,
    also: frozenset[str] = frozenset(),
) -> Iterator[Finding]:
    """Yields a finding for each value that is invalid.

    Args:
        error: Error that validating ``data`` against ``model`` raised.
        model: Model of the whole data.
        data: Data that was validated.
        noun: Name for the fields of the top model: ``"port"`` or ``"field"``.
        also: Names that are allowed in addition to the top model's fields.
    """
    explainer = _Explainer(model, data, noun, also)
    # The members of a union each complain about the same value.
    by_path: dict[DataPath, list[ErrorDetails]] = {}
    for details in error.errors(include_url=False):
        by_path.setdefault(path_in(data, details["loc"]), []).append(details)
    # A required name that is misspelled is not reported as missing as well.
    unknown = [
        (path[:-1], details["loc"])
        for path, found in by_path.items()
        for details in found
        if details["type"] == "extra_forbidden"
    ]
    misspelled = {(parent, explainer.meant(location)) for parent, location in unknown}
    misplaced = {parent for parent, location in unknown if explainer.is_outside(location)}
    for path, found in by_path.items():
        deeper = any(other != path and other[: len(path)] == path for other in by_path)
        there = [
            details
            for details in found
            if details["type"] != "missing"
            or (path not in misplaced and (path, details["loc"][-1]) not in misspelled)
        ]
        yield from explainer.at(path, there, deeper=deeper)


@dataclass(frozen=True)
class _Explainer:
    """Explains pydantic's errors in one piece of data; arguments as `explain`."""

    model: type[BaseModel]
    data: Data
    noun: str
    also: frozenset[str]

    def at(
        self, path: DataPath, found: Sequence[ErrorDetails], *, deeper: bool
    ) -> Iterator[Finding]:
        """Yields the errors of the value at one path.

        Args:
            path: Path in the data.
            found: Errors that pydantic has found in this value.
            deeper: Whether a part of the value has errors, too.
        """
        values = []
        for details in found:
            if details["type"] == "missing":
                yield self._missing(path, details["loc"])
            elif details["type"] == "extra_forbidden":
                yield from self._unknown(path, details["loc"])
            elif details["loc"] and details["loc"][-1] == "[key]":
                yield Finding(path, f"'{path[-1]}' cannot be a name", _NAME_RULE, at_key=True)
            elif not is_unknown(details["input"]):
                values.append(details)
        # Errors in its parts show which member of the union was meant; the others are omitted.
        if values and not deeper and len(values) == len(found):
            yield self._value(path, values)

    def meant(self, location: Location) -> str | None:
        """Returns the valid name that an unknown one probably stands for, if there is one."""
        name, valid = str(location[-1]), self._valid(location)
        return meant_by(name, valid) or nearest(name, valid)

    def is_outside(self, location: Location) -> bool:
        """Whether an unknown name within a port is that of another port."""
        is_port = self.noun == "port" and location[-1] in self.model.model_fields
        return is_port and len(location) > 1

    def _valid(self, location: Location) -> frozenset[str]:
        """Returns the names that are valid instead of an unknown one."""
        models = models_in(type_at(self.model, location[:-1]))
        names = frozenset(name for model in models for name in model.model_fields)
        return names | self.also if len(location) == 1 else names

    def _unknown(self, path: DataPath, location: Location) -> Iterator[Finding]:
        top = len(location) == 1
        noun = self.noun if top else "field"
        name = str(location[-1])
        valid = self._valid(location)
        beside = self._at(path[:-1])
        for vector, parts in _COMPONENTS.items():
            given = [part for part in beside if part in parts]
            if name in given and vector in valid and vector not in beside:
                if name == given[0]:  # one mistake, one error
                    numbers = [beside.get(part, 0) for part in parts]
                    is_known = all(isinstance(one, (int, float)) for one in numbers)
                    values = ", ".join(f"{one:g}" if is_known else "…" for one in numbers)
                    names = ", ".join(f"'{part}'" for part in given)
                    message = f"unknown {noun}{'s' * (len(given) > 1)} {names}"
                    yield Finding(path, message, f"{vector}: [{values}]", at_key=True)
                return
        within = self._within(name) if top and not meant_by(name, valid) else ""
        hint = within or self._outside(name, location) or self._chosen(name, location, valid)
        hint = hint or suggestion(name, valid, noun)
        value = self._at(path)
        has_four = isinstance(value, (list, tuple, dict)) and len(value) == 4
        if has_four and "quat" in valid and meant_by(name, valid):  # other systems begin with x
            hint = "here it is 'quat': [w, x, y, z]"
        yield Finding(path, f"unknown {noun} '{name}'", hint, at_key=True)

    def _chosen(self, name: str, location: Location, valid: frozenset[str]) -> str:
        """Returns a hint for a value that was written as the name of a field."""
        if meant_by(name, valid) or nearest(name, valid):
            return ""
        for model in models_in(type_at(self.model, location[:-1])):
            for field, declared in model.model_fields.items():
                if name in (_names_instead(declared.annotation) or ()):
                    return f"write {field}: {name}"
        return ""

    def _outside(self, name: str, location: Location) -> str:
        """Returns a hint for a port that was written within another one."""
        if not self.is_outside(location):
            return ""
        return f"'{name}' is a port of its own, not within '{location[0]}'"

    def _within(self, name: str) -> str:
        """Returns a hint with the field to whose value a misplaced name belongs."""
        given = self.data if isinstance(self.data, dict) else {}
        for owner, field in self.model.model_fields.items():
            if owner in given:
                continue
            if any(name in model.model_fields for model in models_in(field.annotation)):
                return f"write it within '{owner}': {{{owner}: {{{name}: …}}}}"
        return ""

    def _missing(self, path: DataPath, location: Location) -> Finding:
        name = location[-1]
        if isinstance(name, int):
            return Finding(path, _owned(path, self._too_few(location[:-1])))
        field = field_at(self.model, location)
        description = field.description if field and field.description else ""
        unit = f" [{unit_of(field)}]" if field and unit_of(field) else ""
        noun = "field" if path else self.noun
        hint = f"{name}: {description}{unit}" if description else ""
        return Finding(path, f"{noun} '{name}' is missing", hint, at_key=bool(path))

    def _too_few(self, location: Location) -> str:
        given = self._at(path_in(self.data, location))
        return f"expected {fixed_length(type_at(self.model, location))} items, not {len(given)}"

    def _value(self, path: DataPath, found: Sequence[ErrorDetails]) -> Finding:
        given = found[0]["input"]
        if len(found) == 1:
            message, hint = self._one_value(found[0])
        else:
            wanted = [self._expectation(details) for details in found]
            message = f"expected {' or '.join(dict.fromkeys(wanted))}, not {in_words(given)}"
            hint = self._nearest_choice(found)
        hint = self._bare(path, found) or hint or (_reference_hint(given) if path else "")
        hint = hint or self._bare_number(found) or self._forms(path, found)
        return Finding(path, _owned(path, message), hint)

    def _type_of(self, path: DataPath, location: Location) -> object:
        """Returns the type of the value at a path that a location passes through."""
        ends = (
            end for end in range(len(location) + 1) if path_in(self.data, location[:end]) == path
        )
        return type_at(self.model, location[: next(ends, len(location))])

    def _bare(self, path: DataPath, found: Sequence[ErrorDetails]) -> str:
        """Returns a hint with the name that is the only item of a list where none is expected."""
        given = found[0]["input"]
        if path and path[-1] == 0 and isinstance(given, str):  # the list may be one of others
            path = path[:-1]
            given = [given] * len(self._at(path))
        if not isinstance(given, (list, tuple)) or len(given) != 1:
            return ""
        for details in found:
            names = _names_instead(self._type_of(path, details["loc"]))
            name = given[0]
            if isinstance(name, str) and (is_name(name) if names is None else name in names):
                return f"without brackets: {name}"
        return ""

    def _at(self, path: DataPath) -> Data:
        given = self.data
        for part in path:
            given = given[part]
        return given

    def _bare_number(self, found: Sequence[ErrorDetails]) -> str:
        """Returns a hint with the number or list that a text stands for."""
        for details in found:
            field = field_at(self.model, details["loc"])
            given = details["input"]
            if details["type"] in ("list_type", "tuple_type"):
                lists = containers_in(type_at(self.model, details["loc"]))
                is_of_texts = any(_names_instead(get_args(one)[0]) is None for one in lists)
                if isinstance(given, str) and is_name(given) and is_of_texts:
                    return f"as a list: [{given}]"
                if isinstance(given, (int, float)) and not isinstance(given, bool):
                    return _example(field) or f"as a list: [{given:g}]"
                return (isinstance(given, str) and list_of(given)) or _example(field)
            if isinstance(given, str) and details["type"] in ("float_type", "int_type") and field:
                return _braced(given) or bare(given, unit_of(field))
        return ""

    def _forms(self, path: DataPath, found: Sequence[ErrorDetails]) -> str:
        """Returns a hint with the notations allowed instead of a mapping."""
        for details in found:
            if details["type"] == "model_type":
                models = list(models_in(type_at(self.model, details["loc"])))
                for model in models:
                    if meant := mapping_of(details["input"], model):
                        return meant
                named = _names_instead(self._type_of(path, details["loc"]))
                names = ["a name"] if named is None else [f"'{name}'" for name in named]
                names += ["a number"] * any(map(_may_be_a_number, models))
                fields = [f"a mapping of {', '.join(model.model_fields)}" for model in models]
                if models:
                    return " or ".join([*names, *fields])
        return ""

    def _one_value(self, details: ErrorDetails) -> tuple[str, str]:
        kind = details["type"]
        given = details["input"]
        context = details.get("ctx", {})
        if kind in _COMPARED:
            return f"must be {self._bound(details)}, not {in_words(given)}", self._scaled(details)
        if kind == "value_error":
            return str(context["error"]), ""
        if kind == "string_pattern_mismatch":
            return f"{in_words(given)} is not allowed here", f"it must match {context['pattern']}"
        if kind in _COUNTED:
            return f"expected {self._count(details)}, not {len(given)}", ""
        if kind in _WANTED or kind == "literal_error":
            message = f"expected {self._expectation(details)}, not {in_words(given)}"
            if kind == "dict_type" and isinstance(given, (list, tuple)):
                return message, "write a name in place of each dash: 'NAME: …'"
            return message, self._nearest_choice([details])
        return f"{details['msg'][:1].lower()}{details['msg'][1:]}", ""

    def _expectation(self, details: ErrorDetails) -> str:
        """Returns what the value should be, as text after "expected"."""
        kind = details["type"]
        if kind == "literal_error":
            choices = _choices(details)
            return choices[0] if len(choices) == 1 else f"one of {', '.join(choices)}"
        if kind in _COMPARED:
            return f"a number {self._bound(details)}"
        return _WANTED[kind] if kind in _WANTED else self._one_value(details)[0]

    def _count(self, details: ErrorDetails) -> str:
        """Returns how many items or characters there should be."""
        limit, bound, noun = _COUNTED[details["type"]]
        exactly = fixed_length(type_at(self.model, details["loc"]))
        if exactly:
            return counted(exactly, noun)
        return f"at {limit} {counted(details['ctx'][bound], noun)}"

    def _bound(self, details: ErrorDetails) -> str:
        bound, relation = _COMPARED[details["type"]]
        field = field_at(self.model, details["loc"])
        unit = f" {unit_of(field)}" if field and unit_of(field) else ""
        return f"{relation} {details['ctx'][bound]:g}{unit}"

    def _scaled(self, details: ErrorDetails) -> str:
        """Returns a hint with the number in our unit, if that given seems to be in another one."""
        given = details["input"]
        field = field_at(self.model, details["loc"])
        if not isinstance(given, (int, float)) or field is None or given < _OTHER_UNIT:
            return ""
        bound = details.get("ctx", {}).get("le", details.get("ctx", {}).get("lt"))
        if unit_of(field) == "m" and bound is not None and given <= 1000 * bound:
            return f"in meters: {given / 1000:g}, if {given:g} mm are meant"
        if bound != 1 or unit_of(field):
            return ""
        if "color" in details["loc"]:
            return f"from 0 to 1: {given / 255:.3g}, if {given:g} of 255 is meant"
        is_percent = _PERCENT <= given <= 100
        return f"as a share: {given / 100:g}, if {given:g} % is meant" if is_percent else ""

    def _nearest_choice(self, found: Sequence[ErrorDetails]) -> str:
        choices = [choice for details in found for choice in _choices(details)]
        meant = meant_by(str(found[0]["input"]), choices)
        if meant:
            return f"here it is '{meant}'"
        close = nearest(str(found[0]["input"]), choices)
        return f"did you mean '{close}'?" if close else ""


_PRODUCT: Final = re.compile(r"\s*[\w.]+(?:\s*[-+*/%]\s*[\w.]+)+\s*")


def _braced(text: str) -> str:
    """Returns a hint for an expression whose keys have no braces, or a reference without an end."""
    if text.count("{") != text.count("}"):
        return "a key or a parameter begins and ends with a brace: {key}"
    if _PRODUCT.fullmatch(text) and re.search(r"[a-zA-Z_]", text):
        inner = re.sub(r"[A-Za-z_]\w*", lambda word: f"{{{word[0]}}}", text.strip())
        return f'as an expression: "{inner}"'
    return ""


def _example(field: FieldInfo | None) -> str:
    """Returns a hint with the default of a field that is a list, otherwise nothing."""
    default = None if field is None else field.default
    if not isinstance(default, (list, tuple)) or not default:
        return ""
    items = (f"{item:g}" if isinstance(item, float) else str(item) for item in default)
    return f"for example: [{', '.join(items)}]"


def _choices(details: ErrorDetails) -> list[str]:
    if details["type"] != "literal_error":
        return []
    expected = str(details["ctx"]["expected"])
    return re.findall(r"'([^']*)'", expected) or [expected]


def _owned(path: DataPath, message: str) -> str:
    """Returns the message with the name of the innermost field or port in front."""
    owner = next((part for part in reversed(path) if isinstance(part, str)), "")
    return f"{owner}: {message}" if owner else message


def _reference_hint(given: Data) -> str:
    if isinstance(given, dict) and len(given) == 1 and None in given.values():
        return f'if the key or parameter is meant, quote it: "{{{next(iter(given))}}}"'
    key = reference_of(given)
    if key is None:
        return ""
    return f"there is no parameter '{key_name(key)}'"
