"""Node types as the check sees them: typed ports, children, outcomes; and the nodes of a file.

Ports are declared once for the check, the schema and the reference. Every port may be given as
``"{key}"``, a value of the arm's blackboard. The blackboard holds values in YAML notation, so a
reference has the same meaning as its value written in its place.

The node types of the language are the classes in `bt_dualarm.behaviors`, each with its `NodeType`;
those of skills come from the registry. Parser and checks get them passed in.
"""

from __future__ import annotations

import json
import math
import re
import unicodedata
from collections import ChainMap
from collections.abc import Callable, Iterable, Iterator, Mapping, MutableMapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from types import UnionType
from typing import (
    Annotated,
    Any,
    ClassVar,
    Final,
    Literal,
    Self,
    TypeAlias,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
)

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    create_model,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema

from bt_dualarm.spec.dimensions import ValueType
from bt_dualarm.spec.problems import Location, Problem, suggestion
from bt_dualarm.spec.yaml_reader import Data, DataPath, Json, Source

# Units of numbers.

_DIGITS: Final = r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?"

QUANTITY: Final = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([a-zA-Z°%/²]+)\s*")
"""Text with a unit; groups: number, unit."""

SECONDS: Final[Mapping[str, float]] = {"ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0}
DEGREES: Final[Mapping[str, float]] = {"deg": 1.0, "°": 1.0, "rad": math.degrees(1.0)}
METERS: Final[Mapping[str, float]] = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
_KILOGRAMS: Final[Mapping[str, float]] = {"g": 1e-3, "kg": 1.0}
_HERTZ: Final[Mapping[str, float]] = {"Hz": 1.0, "kHz": 1e3, "fps": 1.0}
_NEWTONS: Final[Mapping[str, float]] = {"N": 1.0, "kN": 1e3}
_KNOWN: Final[Mapping[str, tuple[str, Mapping[str, float]]]] = {
    "m": ("meters", METERS),
    "s": ("seconds", SECONDS),
    "deg": ("degrees", DEGREES),
    "kg": ("kilograms", _KILOGRAMS),
    "Hz": ("Hz", _HERTZ),
    "N": ("newtons", _NEWTONS),
    "m/s": ("m/s", {"m/s": 1.0}),
    "m/s²": ("m/s²", {"m/s²": 1.0}),
    "px": ("pixels", {"px": 1.0}),
    "": ("as a share", {"%": 0.01}),
}


_NAMES: Final = "|".join(name for unit, (_, units) in _KNOWN.items() if unit for name in units)

QUANTITY_PATTERN: Final = rf"^\s*{_DIGITS}\s*({_NAMES})\s*$"
"""Regular expression of a number with one of the known units, for editors."""


def number_in(text: str, unit: str) -> float | None:
    """Converts text with a unit, ``6 cm``, to the number in another one.

    Args:
        text: Text as the author wrote it.
        unit: Unit of the number, such as ``"m"``; empty for a share or a count.

    Returns:
        The number, None if the text has no unit of this quantity.
    """
    _, others = _KNOWN.get(unit, ("", {}))
    match = QUANTITY.fullmatch(text)
    if match is None or match[2] not in others:
        return None
    return scaled(float(match[1]), others[match[2]])


def scaled(number: float, factor: float) -> float:
    """A number of a unit in another one: 35 cm is 0.35 m, and 35 times 0.01 is more than that.

    Args:
        number: The number.
        factor: Size of its unit in the other one.
    """
    parts = round(1.0 / factor)
    return number / parts if factor < 1.0 and 1.0 / parts == factor else number * factor


def bare(text: str, unit: str) -> str:
    """Returns a hint for text in the place of a number: ``in meters: 0.06``.

    For text without a unit of this quantity the hint names the units. It is empty for a share or a
    count. Arguments as `number_in`.
    """
    name, others = _KNOWN.get(unit, ("", {}))
    match = QUANTITY.fullmatch(text)
    # Upper and lower case are distinct in units, but their confusion is a frequent mistake.
    factors = {other.lower(): factor for other, factor in others.items()}
    if match is None or match[2].lower() not in factors:
        if len(others) > 1:
            return f"in {name}, or with a unit: {', '.join(others)}"
        return f"in {name}" if unit else ""
    number = scaled(float(match[1]), factors[match[2].lower()])
    words = f"in {name}" if unit else name
    return f"{words}: {number:.6g}"


@dataclass(frozen=True, eq=False)
class Unit:
    """Metadata of a number: its units in YAML.

    Attributes:
        yaml: Unit of a bare number.
        others: Units that text may give, as multiples of that unit.
    """

    yaml: str
    others: Mapping[str, float]

    def __get_pydantic_json_schema__(
        self, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> Json:
        """Returns the schema of a number, or text with one of the units."""
        pattern = rf"^\s*{_DIGITS}\s*({'|'.join(self.others)})\s*$"
        return {"anyOf": [handler(core_schema), {"type": "string", "pattern": pattern}]}


# Inspection of type annotations.

_T = TypeVar("_T")


def models_in(annotation: object) -> Iterator[type[BaseModel]]:
    """Yields the models that a value of this type may be."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    elif get_origin(annotation) in (Annotated, Union, UnionType):
        for member in get_args(annotation):
            yield from models_in(member)


def containers_in(annotation: object) -> Iterator[object]:
    """Yields the tuples, lists and dicts that a value of this type may be."""
    if get_origin(annotation) in (tuple, list, dict):
        yield annotation
    elif get_origin(annotation) in (Annotated, Union, UnionType):
        for member in get_args(annotation):
            yield from containers_in(member)


def item_models(annotation: object) -> Iterator[type[BaseModel]]:
    """Yields the models that a value of this type, or an item of it, may be."""
    yield from models_in(annotation)
    for container in containers_in(annotation):
        for member in get_args(container):
            yield from item_models(member)


def fixed_length(annotation: object) -> int:
    """Returns the number of items of a list of this type, 0 if that is not fixed."""
    for container in containers_in(annotation):
        items = get_args(container)
        if get_origin(container) is tuple and items[-1] is not ...:
            return len(items)
    return 0


def metadata_of(field: FieldInfo, wanted: type[_T]) -> _T | None:
    """Returns the first metadata of this type on a field, or on a member of its type."""
    return _metadata_in([*field.metadata, field.annotation], wanted)


def _metadata_in(items: Sequence[object], wanted: type[_T]) -> _T | None:
    for item in items:
        if isinstance(item, wanted):
            return item
        found = _metadata_in([*getattr(item, "__metadata__", ()), *get_args(item)], wanted)
        if found is not None:
            return found
    return None


# Models of ports, and references to the blackboard.

REFERENCE: Final = re.compile(r"\{([^{}]*)\}")
"""Reference to a blackboard key, or to a parameter."""

KEY: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,47}")
"""Name of a key or a parameter, as an author may write it."""

STRICT: Final = ConfigDict(
    frozen=True, extra="forbid", strict=True, allow_inf_nan=False, defer_build=True
)
"""Configuration of all models of a file; built on first use, as a run needs few of them."""

UNKNOWN: Final = "?"
"""Prefix of a parameter's name in a reference whose value is unknown, or whose error is reported
already."""


@dataclass(frozen=True)
class Template:
    """Metadata of a text port: ``{key}`` within the text is replaced by the key's value."""


@dataclass(frozen=True)
class WrittenKey:
    """Metadata of a text port: it names a blackboard key that the node writes.

    Attributes:
        port: Port whose value is written there.
        what: Its ``value``, or one after the other the ``items`` of that list, or their
            ``indices``.
    """

    port: str
    what: Literal["value", "items", "indices"] = "value"


class PortModel(BaseModel):
    """Base of a node's ports: immutable, complete, and strict about types.

    Attributes:
        exactly_one_of: Names of ports, None by default, of which a node is given exactly one.
        at_most_one_of: Names of ports, None by default, of which a node is given one or none.
        goes_with: Ports, None by default, that are given only together with another one.
    """

    model_config = ConfigDict(**STRICT, validate_default=True)
    exactly_one_of: ClassVar[tuple[str, ...]] = ()
    at_most_one_of: ClassVar[tuple[str, ...]] = ()
    goes_with: ClassVar[Mapping[str, str]] = {}

    @model_validator(mode="after")
    def _one_is_given(self) -> Self:
        complaint = miscounted(type(self), self.__dict__)
        if complaint:
            raise ValueError(complaint)
        return self


def miscounted(model: type[PortModel], ports: Mapping[str, object]) -> str:
    """Returns the first violation of the rules on which ports are given, empty if there is none.

    A reference to the blackboard counts as given.
    """
    for rule, names in (("exactly", model.exactly_one_of), ("at most", model.at_most_one_of)):
        given = [name for name in names if ports.get(name) is not None]
        if len(given) > 1 or (names and not given and rule == "exactly"):
            here = f"given: {' and '.join(given)}" if given else "none is given"
            return f"give {rule} one of: {', '.join(names)}; {here}"
    for one, other in model.goes_with.items():
        if ports.get(one) is not None and ports.get(other) is None:
            return f"'{one}' goes with '{other}', which is missing"
    return ""


def port(
    default: object,
    description: str,
    *,
    unit: str = "",
    gt: float | None = None,
    ge: float | None = None,
    lt: float | None = None,
    le: float | None = None,
    min_length: int | None = None,
    max_length: int | None = None,
    pattern: str | None = None,
) -> Any:  # Any: it stands where a value of the port's own type is declared
    """Declares a port of a `PortModel`, or a field of the file.

    Args:
        default: Value in YAML notation; ``...`` for a port that must be given.
        description: One-line description.
        unit: Unit of a bare number, such as ``"m"``; value types bring their own.
        gt: Bound that the number must be greater than.
        ge: Smallest number.
        lt: Bound that the number must be less than.
        le: Largest number.
        min_length: Minimum length of text or of a list.
        max_length: Greatest length of text or of a list.
        pattern: Regular expression that text must match.
    """
    return Field(
        default,
        description=description,
        json_schema_extra={"unit": unit} if unit else None,
        gt=gt,
        ge=ge,
        lt=lt,
        le=le,
        min_length=min_length,
        max_length=max_length,
        pattern=pattern,
    )


def unknown(name: str) -> str:
    """Returns a stand-in for the value of a parameter that is unknown; no check reports it."""
    return f"{{{UNKNOWN}{name}}}"


def is_unknown(value: Data) -> bool:
    """Returns whether a value stands for that of an unknown parameter."""
    return (reference_of(value) or "").startswith(UNKNOWN)


def reference_of(value: Data) -> str | None:
    """Returns the key that a port's value refers to, None if it is not a reference."""
    match = REFERENCE.fullmatch(value) if isinstance(value, str) else None
    return match[1] if match else None


def is_expression(value: Data) -> bool:
    """Returns whether a value is a text with a reference to a key within it."""
    if not isinstance(value, str) or reference_of(value) is not None:
        return False
    return any(KEY.match(match[1].strip()) for match in REFERENCE.finditer(value))


def is_dynamic(value: Data) -> bool:
    """Returns whether a value, or a part of it, is a reference or an expression."""
    if isinstance(value, str):
        return reference_of(value) is not None or is_expression(value)
    if isinstance(value, (dict, list, tuple)):
        items = value.values() if isinstance(value, dict) else value
        return any(map(is_dynamic, items))
    return False


def shown(text: str) -> str:
    """Returns text as its author wrote it: without the prefixes of a subtree's keys."""
    return REFERENCE.sub(lambda match: f"{{{key_name(match[1])}}}", text)


def key_name(key: str) -> str:
    """Returns a key as its author wrote it: without the prefix of its subtree."""
    return key.rpartition("/")[2]


def as_text(value: Data) -> str:
    """Returns a value as text in a message: as YAML, to five digits, without nulls."""
    return value if isinstance(value, str) else _in_flow(value)


def _in_flow(value: Data) -> str:
    if isinstance(value, dict):
        given = (f"{key}: {_in_flow(item)}" for key, item in value.items() if item is not None)
        return f"{{{', '.join(given)}}}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_in_flow, value))}]"
    if isinstance(value, float) and abs(value) < 1e4:
        value = float(f"{value:.5g}")
    return json.dumps(value, ensure_ascii=False)


def dynamic_ports(model: type[PortModel], ports: Mapping[str, Data]) -> frozenset[str]:
    """Returns the ports of ``model`` that depend on references, except texts that contain keys."""
    fields = model.model_fields
    dynamic = [name for name, value in ports.items() if name in fields and is_dynamic(value)]
    return frozenset(dynamic) - templates_of(model) if dynamic else frozenset()


@lru_cache(maxsize=512)
def templates_of(model: type[PortModel]) -> frozenset[str]:
    """Returns the ports whose text may contain keys."""
    fields = model.model_fields.items()
    return frozenset(name for name, field in fields if Template() in field.metadata)


@lru_cache(maxsize=512)
def written_keys(model: type[PortModel]) -> Mapping[str, WrittenKey]:
    """Returns the ports that name a key to write, each with what is written there."""
    items = ((name, metadata_of(field, WrittenKey)) for name, field in model.model_fields.items())
    return {name: found for name, found in items if found is not None}


def validated(model: type[PortModel], ports: Mapping[str, Data]) -> PortModel:
    """Returns the validated ports of a node.

    Raises:
        pydantic.ValidationError: Ports are invalid; has an entry for each error.
    """
    # Strict JSON has the types of YAML: lists become tuples, but "1" is not a number.
    return model.model_validate_json(json.dumps(ports))


def validate_literals(model: type[PortModel], ports: Mapping[str, Data]) -> None:
    """Validates the ports that are neither references nor expressions.

    Raises:
        pydantic.ValidationError: As `validated`; where a part of a port is dynamic, errors of that
            part have an unknown value as their input.
    """
    dynamic = dynamic_ports(model, ports)
    if dynamic:
        whole = frozenset(name for name in dynamic if isinstance(ports[name], str))
        if whole:
            model = without(model, whole)
        ports = {name: _literals(value) for name, value in ports.items() if name not in whole}
    validated(model, ports)


def _literals(value: Data) -> Data:
    """Returns a value with an unknown one in the place of each dynamic part."""
    if isinstance(value, dict):
        return {name: _literals(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_literals(item) for item in value]
    return unknown("part") if is_dynamic(value) else value


@lru_cache(maxsize=512)
def without(model: type[PortModel], names: frozenset[str]) -> type[PortModel]:
    """Returns a model of the other ports, without the rules over several ports."""
    return _model_of(model, (name for name in model.model_fields if name not in names))


@lru_cache(maxsize=512)
def only(model: type[PortModel], name: str) -> type[PortModel]:
    """Returns a model of one port, to check a value by itself."""
    return _model_of(model, (name,))


def _model_of(model: type[PortModel], names: Iterable[str]) -> type[PortModel]:
    fields: dict[str, Any] = {
        name: (model.model_fields[name].annotation, model.model_fields[name]) for name in names
    }
    return create_model(model.__name__, __base__=PortModel, **fields)


def unit_of(field: FieldInfo) -> str:
    """Returns the unit of a bare number in YAML, empty if the port has none."""
    unit = metadata_of(field, Unit)
    extra = field.json_schema_extra
    given = extra.get("unit", "") if isinstance(extra, dict) else ""
    return unit.yaml if unit else str(given)


# Texts for messages.

_ACTED_ON: Final = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})
"""Unicode categories of characters with which a terminal moves, colors, hides or reverses text."""


def in_words(value: Data) -> str:
    """Returns a short description of a value for a message."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        value = one_line(shown(value))
        return f"text '{value if len(value) <= 40 else value[:37] + '...'}'"
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, (list, tuple)):
        return f"a list of {len(value)}"
    return f"{value:g}" if isinstance(value, float) else str(value)[:40]


def one_line(text: str) -> str:
    """Returns text on one line, with U+FFFD for each character that is not printable."""
    return "".join(
        letter if letter.isprintable() else "\ufffd" for letter in " ".join(text.split())
    )


def counted(number: int, noun: str) -> str:
    """Returns a number with its noun: ``1 item``, ``3 items``."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def escaped(text: str, keep: str = "\n\t") -> str:
    r"""Escapes untrusted text for a terminal or a table.

    Control characters, direction marks and lone surrogates become ``\u001b`` and the like, as in
    JSON; so escaped JSON has the same meaning.

    Args:
        text: Untrusted text.
        keep: Characters that are not escaped.
    """
    if text.isprintable():
        return text
    return "".join(
        letter if letter in keep or unicodedata.category(letter) not in _ACTED_ON else _code(letter)
        for letter in text
    )


def _code(letter: str) -> str:
    number = ord(letter)
    if number > 0xFFFF:
        number -= 0x10000
        return f"\\u{0xD800 + (number >> 10):04x}\\u{0xDC00 + (number & 0x3FF):04x}"
    return f"\\u{number:04x}"


# Hints for values in another notation.

_NUMBERS: Final = re.compile(r"\s*(-?[\d.]+(?:\s*[x,; ]\s*-?[\d.]+)+)\s*")
_BETWEEN: Final = re.compile(r"\s*[x,; ]\s*")


def list_of(text: str) -> str:
    """Returns a hint with the list that text such as ``320x240`` stands for, otherwise nothing."""
    match = _NUMBERS.fullmatch(text)
    return f"as a list: [{', '.join(_BETWEEN.split(match[1]))}]" if match else ""


def mapping_of(given: Data, model: type[BaseModel]) -> str:
    """Returns a hint with the mapping that a bare list of numbers stands for.

    ``[0.4, 0, 0.5]`` is the value of the first field, ``[0.4, 0, 0.5, 180, 0, 0]`` those of two
    fields. Empty if the list is not one of numbers, or has another length.
    """
    if not isinstance(given, (list, tuple)) or not all(_is_number(item) for item in given):
        return ""
    lengths = {name: fixed_length(info.annotation) for name, info in model.model_fields.items()}
    name = next((name for name, length in lengths.items() if length), "")
    first, rest = given[: lengths.get(name, 0)], given[lengths.get(name, 0) :]
    second = next((one for one in lengths if one != name and lengths[one] == len(rest)), "")
    if len(first) != lengths.get(name, -1) or (rest and not second):
        return ""
    parts = [(name, first), (second, rest)] if rest else [(name, first)]
    fields = (f"{one}: [{', '.join(f'{item:g}' for item in items)}]" for one, items in parts)
    order = ", with quat in the order w, x, y, z" if second == "quat" else ""  # others begin with x
    return f"{{{', '.join(fields)}}}{order}"


def _is_number(item: Data) -> bool:
    return isinstance(item, (int, float)) and not isinstance(item, bool)


class NoPorts(PortModel):
    """Nothing to set."""


@dataclass(frozen=True)
class Slot:
    """A named child of a node.

    Attributes:
        name: Name in the file.
        required: Whether the child must be given.
        after: Result of the child in the first slot that leads to this one, success (True) or
            failure (False); None if that does not matter.
    """

    name: str
    required: bool = True
    after: bool | None = None


@dataclass(frozen=True)
class Counterpart:
    """Skill of another arm, or of several, with which a skill acts together.

    Attributes:
        kind: Name of that skill in YAML.
        partner: Port of this skill that names the other arm, or lists all others.
        its_partner: Port of that skill that names this arm, or lists this one and the others.
        same: Ports that have the same value in both.
        by_one: Ports of which at least one is given, in this skill or in that of a partner.
    """

    kind: str
    partner: str
    its_partner: str
    same: tuple[str, ...] = ("object",)
    by_one: tuple[str, ...] = ()

    def partners(self, ports: Mapping[str, Data]) -> tuple[str, ...]:
        """Names of the other arms by the ports of a node; none if the port is missing."""
        return names_in(ports.get(self.partner))


def names_in(value: Data) -> tuple[str, ...]:
    """Returns the names that a port has: one, or a list of them."""
    if isinstance(value, (list, tuple)):
        return tuple(str(one) for one in value)
    return () if value is None else (str(value),)


def _unknown_shift(_: PortModel) -> None:
    return None


@dataclass(frozen=True)
class NodeType:
    """Declaration of a node type, of the language or of a skill.

    Attributes:
        name: Name in the file.
        summary: One-line description.
        ports: Model of its inputs.
        outputs: Model of its outputs, written to the blackboard if the file names a key.
        slots: Named children.
        many: Whether it takes a list of children.
        cases: Whether it takes a mapping of children, ``cases``.
        fixed: Ports that need a literal value and cannot come from the blackboard.
        shorthand: Port that a bare value stands for: ``wait: 2``.
        bare_child: Whether its child may be written in its place: ``not: holding``.
        uses: Port that names a subtree, whose tree becomes the node's child; empty if none does.
        brings_in: Ports that name what the node spawns.
        takes_out: Ports that name what it removes.
        needs_camera: Whether it works only with a camera that moves with the arm.
        needs_gripper: Whether it works only with an arm that has a gripper.
        needs_held: Whether it works only while the arm holds an object.
        takes_hold: Whether the arm may hold an object after it that it did not hold before.
        lets_go: Whether the gripper holds nothing after it has succeeded.
        counterpart: Skill of another arm with which it acts together, if there is one.
        failures: Failure codes with their meaning.
        example: A node in YAML.
        origin: Where it is defined: a file for skills.
        shift: Distance in m, by its validated ports, by which a run moves the tool from where it
            was, and how to avoid that; None if it depends on more than the ports.
    """

    name: str
    summary: str
    ports: type[PortModel] = NoPorts
    outputs: type[PortModel] = NoPorts
    slots: tuple[Slot, ...] = ()
    many: bool = False
    cases: bool = False
    fixed: frozenset[str] = frozenset()
    shorthand: str = ""
    bare_child: bool = False
    uses: str = ""
    brings_in: frozenset[str] = frozenset()
    takes_out: frozenset[str] = frozenset()
    needs_camera: bool = False
    needs_gripper: bool = False
    needs_held: bool = False
    takes_hold: bool = False
    lets_go: bool = False
    counterpart: Counterpart | None = None
    failures: Mapping[str, str] = field(default_factory=dict)
    example: str = ""
    origin: str = "the language"
    shift: Callable[[Any], tuple[float, str] | None] = _unknown_shift

    @property
    def is_leaf(self) -> bool:
        """Whether no children are written for it."""
        return not (self.slots or self.many or self.cases)

    def is_alternative(self, slot: str) -> bool:
        """Returns whether only one of the children in such slots is ever ticked."""
        return self.cases or any(one.name == slot and one.after is not None for one in self.slots)

    @cached_property
    def fields_besides_ports(self) -> frozenset[str]:
        """Fields of a node that are not ports: its name, outputs and children."""
        return self.no_data_fields | self.outputs.model_fields.keys()

    @cached_property
    def no_data_fields(self) -> frozenset[str]:
        """Fields of a node that are neither ports nor outputs: its name and children."""
        lists = ["children"] * self.many + ["cases"] * self.cases
        return frozenset({"name", *lists, *(slot.name for slot in self.slots)})


def all_of(*kinds: Mapping[str, NodeType]) -> Mapping[str, NodeType]:
    """Node types of several mappings, whose values are not read: skills are imported on demand."""
    return ChainMap(*(cast("MutableMapping[str, NodeType]", some) for some in kinds))


@dataclass(frozen=True, eq=False)
class NodeSpec:
    """A node of a tree file with its descendants, parsed but not checked.

    Attributes:
        kind: Name of its node type: ``sequence``, or a skill's name.
        name: Name given by the author, otherwise the kind.
        ports: Everything else that the node was given, as YAML data; parameters are filled in.
        children: Children in the order of the file.
        slots: Role of each child: ``children``, ``child``, ``condition``, a case, …
        source: File that contains it.
        path: Path in that file.
        whole: Whether all of it could be parsed.
        user: Location where the subtree that it is part of is used, if it is part of one.
        parameters: Names of the parameters that it may refer to.
        types: Types of their values in expressions, by name.
    """

    kind: str
    name: str
    ports: Mapping[str, Data]
    children: tuple[NodeSpec, ...] = ()
    slots: tuple[str, ...] = ()
    source: Source = field(default_factory=lambda: Source("<none>", ()), repr=False)
    path: DataPath = field(default=(), repr=False)
    whole: bool = field(default=True, repr=False)
    user: Location | None = field(default=None, repr=False)
    parameters: frozenset[str] = field(default=frozenset(), repr=False)
    types: Mapping[str, ValueType] = field(default_factory=dict, repr=False)

    @property
    def location(self) -> Location:
        """Location of the node's kind in the file."""
        return self.source.key_location((*self.path, self.kind))

    def problem(self, message: str, hint: str = "") -> Problem:
        """Error of the node as a whole."""
        return Problem(self.location, message, hint)

    def port_problem(
        self, path: DataPath, message: str, hint: str = "", *, key: bool = False
    ) -> Problem:
        """Error of one port, or of a part of its value."""
        return self.source.problem((*self.path, self.kind, *path), message, hint, key=key)

    def walk(self) -> Iterator[NodeSpec]:
        """Yields the node, then its descendants, in the order of the file."""
        waiting = [self]
        while waiting:
            node = waiting.pop()
            yield node
            waiting += reversed(node.children)


@dataclass(frozen=True)
class Outcomes:
    """Possible results of a node; a node with neither never ends."""

    succeeds: bool = True
    fails: bool = True

    @property
    def never(self) -> bool:
        """Whether the node runs until it is halted."""
        return not (self.succeeds or self.fails)


EITHER: Final = Outcomes()
SUCCESS: Final = Outcomes(fails=False)
FAILURE: Final = Outcomes(succeeds=False)

ChildOutcomes: TypeAlias = Sequence[Outcomes]
"""Outcomes of each child of a node, in the order of the file."""

OutcomeRule: TypeAlias = Callable[[NodeSpec, ChildOutcomes], Outcomes]
"""Outcomes of a node, given those of its children."""

ProblemRule: TypeAlias = Callable[[NodeSpec], Iterator[Problem]]
"""Problems of a node that the types of its ports cannot express."""

NoEffectRule: TypeAlias = Callable[[NodeSpec, ChildOutcomes], str]
"""Why a node has no effect, given the outcomes of its children; empty if it has one."""


def either(_: NodeSpec, _children: ChildOutcomes) -> Outcomes:
    """`OutcomeRule` of a node that can succeed and can fail."""
    return EITHER


def success(_: NodeSpec, _children: ChildOutcomes) -> Outcomes:
    """`OutcomeRule` of a node that cannot fail."""
    return SUCCESS


def failure(_: NodeSpec, _children: ChildOutcomes) -> Outcomes:
    """`OutcomeRule` of a node that cannot succeed."""
    return FAILURE


def as_child(_: NodeSpec, children: ChildOutcomes) -> Outcomes:
    """`OutcomeRule` of a node that ends as its first child does."""
    return children[0]


def always(_: NodeSpec) -> bool:
    """Rule that holds for every node of a type."""
    return True


def _never(_: NodeSpec) -> bool:
    return False


def _no_problems(_: NodeSpec) -> Iterator[Problem]:
    yield from ()


def _has_effect(_: NodeSpec, _children: ChildOutcomes) -> str:
    return ""


@dataclass(frozen=True, kw_only=True)
class LanguageNode(NodeType):
    """Declaration of a node type of the language, with the rules for its nodes.

    Attributes:
        outcomes: Outcomes of a node.
        advances_on: Whether a child that succeeds (True) or one that fails (False) is followed by
            the next; None if children do not follow each other.
        revisits: Whether a node may tick a child after one that comes later in the file.
        runs_all: Whether every run of a node that goes as planned runs all children once, in order.
        repeats: Whether a node may run its children again after they have succeeded.
        problems: Problems of a node beyond the types of its ports.
        no_effect: Why a node has no effect.
        synonyms: Names in other behavior tree libraries, each with what to write here besides
            the name, ``memory: false``, or nothing.
    """

    outcomes: OutcomeRule = either
    advances_on: bool | None = None
    revisits: Callable[[NodeSpec], bool] = _never
    runs_all: Callable[[NodeSpec], bool] = _never
    repeats: Callable[[NodeSpec], bool] = _never
    problems: ProblemRule = _no_problems
    no_effect: NoEffectRule = _has_effect
    synonyms: Mapping[str, str] = field(default_factory=dict)


TEST: Final = "test"
"""Node type of which a text with references is a short form: ``condition: "{n} < 3"``."""

ONLY_IF: Final = "only_if"
SKIP_IF: Final = "skip_if"
UNTIL: Final = "until"
CONDITION_FIELDS: Final = (SKIP_IF, ONLY_IF, UNTIL)
"""Fields that any node may have, with a condition each: short for nodes of these types around it,
the first one outermost."""

RESERVED_NAMES: Final = frozenset(
    {
        "sequence", "selector", "reactive_sequence", "reactive_fallback", "parallel", "switch",
        "if", "if_then_else", "while", "guard", "only_if", "skip_if", "until",
        "retry", "repeat", "for_each", "timeout", "delay", "rate", "inverter", "force_success",
        "force_failure", "run_once", "on_halt", "subtree",
        "wait", "set", "compare", "test", "log", "fail", "succeed",
        "signal", "await", "meet", "claim", "in_step", "all", "any", "not",
        "arm_at", "arm_near", "in_zone", "object_at", "sees", "moving", "force_above", "elapsed",
        "touching", "joint_at",
    }
)  # fmt: skip
"""Names of the language's node types. No skill may have one of them: the registry of skills, which
is below `bt_dualarm.behaviors`, checks that."""

_OWN_SKILLS: Final = "(load your own skills with --skills DIR)"


def synonyms_in(node_types: Iterable[NodeType]) -> dict[str, str]:
    """Names in other behavior tree libraries, each with what to write here instead."""
    return {
        synonym: f"{node_type.name}, with {besides}" if besides else node_type.name
        for node_type in node_types
        if isinstance(node_type, LanguageNode)
        for synonym, besides in node_type.synonyms.items()
    }


def kind_hint(given: str, node_types: Mapping[str, NodeType]) -> str:
    """Hint for an unknown node type: our name for it, the nearest name, or all names."""
    name, colon, rest = given.partition(":")
    if colon and rest:
        return f"write a space after the colon: '{name}: {rest}'"
    if re.search("[<>=!+*/]", given):
        return "an expression contains at least one {key}"
    known = {_letters(kind): kind for kind in node_types}
    synonyms = synonyms_in(node_types.values())
    ours = {_letters(name): meant for name, meant in synonyms.items()} | known
    meant = ours.get(_letters(given), "")
    if meant:
        name, comma, how = meant.partition(",")
        return f"here it is '{name}'{comma}{how}"
    return f"{suggestion(given, known.values(), 'kind of node')} {_OWN_SKILLS}"


@lru_cache(maxsize=1024)
def _letters(name: str) -> str:
    """Returns a name for comparison: without case and underscores."""
    return re.sub("[^a-z0-9]", "", name.lower())
