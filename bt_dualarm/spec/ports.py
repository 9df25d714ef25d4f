"""Typed ports of a node: declared once, used for the check, the schema and the docs.

Every port may be given as ``"{key}"``, a value of the arm's blackboard. The blackboard holds
values in YAML's own notation, so a reference means what its value written there would mean.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, Final, Self

from pydantic import BaseModel, ConfigDict, Field, create_model, model_validator
from pydantic.fields import FieldInfo

from bt_dualarm.spec.annotations import metadata_of
from bt_dualarm.spec.source import Data
from bt_dualarm.spec.unit import Unit

REFERENCE: Final = re.compile(r"\{([^{}]*)\}")
"""A whole text that stands for a value of the blackboard, or for a parameter."""

KEY: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,47}")
"""What an author may call a key or a parameter."""

STRICT: Final = ConfigDict(
    frozen=True, extra="forbid", strict=True, allow_inf_nan=False, defer_build=True
)
"""Of all models of what a file says; built when they are asked for: a run asks few of them."""

UNKNOWN: Final = "?"
"""Before the name of a parameter in a reference: its value is not known, or told elsewhere."""


@dataclass(frozen=True)
class Template:
    """Metadata of a text port: ``{key}`` within the text is replaced by the key's value."""


@dataclass(frozen=True)
class WrittenKey:
    """Metadata of a text port: it names a key of the blackboard that the node writes.

    Attributes:
        port: Port whose value is written there.
    """

    port: str


class PortModel(BaseModel):
    """Base of a node's ports: immutable, complete, and strict about types.

    Attributes:
        exactly_one_of: Names of ports, None by default, of which a node is given exactly one.
        goes_with: Ports, None by default, that are given only together with another one.
    """

    model_config = ConfigDict(**STRICT, validate_default=True)
    exactly_one_of: ClassVar[tuple[str, ...]] = ()
    goes_with: ClassVar[Mapping[str, str]] = {}

    @model_validator(mode="after")
    def _one_is_given(self) -> Self:
        complaint = miscounted(type(self), self.__dict__)
        if complaint:
            raise ValueError(complaint)
        return self


def miscounted(model: type[PortModel], ports: Mapping[str, object]) -> str:
    """Why ports that exclude, or need, each other are not given so; empty if they are.

    A reference to the blackboard counts as given.
    """
    given = [name for name in model.exactly_one_of if ports.get(name) is not None]
    if not model.exactly_one_of or len(given) == 1:
        alone = [
            (one, other)
            for one, other in model.goes_with.items()
            if ports.get(one) is not None and ports.get(other) is None
        ]
        return "".join(f"'{one}' goes with '{other}', which is missing" for one, other in alone[:1])
    here = f"here are {' and '.join(given)}" if given else "here is none"
    return f"give exactly one of: {', '.join(model.exactly_one_of)}; {here}"


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
    """Declare one port of a `PortModel`, or a field of the file.

    Args:
        default: Value in YAML's notation; ``...`` for a port that must be given.
        description: One line, for people.
        unit: Unit of a bare number, such as ``"m"``; value types bring their own.
        gt: Bound that the number must be greater than.
        ge: Smallest number.
        lt: Bound that the number must be less than.
        le: Largest number.
        min_length: Least length of text or of a list.
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
    """A value that nobody complains of: that of a parameter whose value is not known."""
    return f"{{{UNKNOWN}{name}}}"


def is_unknown(value: Data) -> bool:
    """Whether it stands for the value of a parameter that is not known."""
    return (reference_of(value) or "").startswith(UNKNOWN)


def reference_of(value: Data) -> str | None:
    """The key that a port's value refers to, if it is a reference."""
    match = REFERENCE.fullmatch(value) if isinstance(value, str) else None
    return match[1] if match else None


def shown(text: str) -> str:
    """Text as its author wrote it: without the prefixes of a subtree's keys."""
    return REFERENCE.sub(lambda match: f"{{{key_name(match[1])}}}", text)


def key_name(key: str) -> str:
    """A key as its author wrote it: without the prefix of the subtree that it belongs to."""
    return key.rpartition("/")[2]


def as_text(value: Data) -> str:
    """A value as it is written out in a text for people: as YAML, to five digits, without nulls."""
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


def references_in(model: type[PortModel], ports: Mapping[str, Data]) -> dict[str, str]:
    """The key behind each port of ``model`` that is given as a reference."""
    keys = {name: reference_of(value) for name, value in ports.items()}
    if all(key is None for key in keys.values()):
        return {}
    fields, texts = model.model_fields, templates_of(model)
    return {
        name: key
        for name, key in keys.items()
        if key is not None and name in fields and name not in texts
    }


@lru_cache(maxsize=512)
def templates_of(model: type[PortModel]) -> frozenset[str]:
    """The ports in whose text keys are written out."""
    fields = model.model_fields.items()
    return frozenset(name for name, field in fields if Template() in field.metadata)


@lru_cache(maxsize=512)
def written_keys(model: type[PortModel]) -> Mapping[str, str]:
    """The ports that name a key to write, each with the port whose value is written there."""
    items = ((name, metadata_of(field, WrittenKey)) for name, field in model.model_fields.items())
    return {name: found.port for name, found in items if found is not None}


def validated(model: type[PortModel], ports: Mapping[str, Data]) -> PortModel:
    """The ports as the skill gets them.

    Raises:
        pydantic.ValidationError: With one entry for each thing that is wrong.
    """
    # As JSON because strict JSON has YAML's types: lists become tuples, but "1" is no number.
    return model.model_validate_json(json.dumps(ports))


def validate_literals(model: type[PortModel], ports: Mapping[str, Data]) -> None:
    """Check all that can be known before the blackboard has its values.

    Raises:
        pydantic.ValidationError: As `validated`.
    """
    references = references_in(model, ports)
    if references:
        model = without(model, frozenset(references))
        ports = {name: value for name, value in ports.items() if name not in references}
    validated(model, ports)


@lru_cache(maxsize=512)
def without(model: type[PortModel], names: frozenset[str]) -> type[PortModel]:
    """A model of the other ports alone. Rules over several ports wait until all are known."""
    return _model_of(model, (name for name in model.model_fields if name not in names))


@lru_cache(maxsize=512)
def only(model: type[PortModel], name: str) -> type[PortModel]:
    """A model of one port, to check a value that is to be put there."""
    return _model_of(model, (name,))


def _model_of(model: type[PortModel], names: Iterable[str]) -> type[PortModel]:
    fields: dict[str, Any] = {
        name: (model.model_fields[name].annotation, model.model_fields[name]) for name in names
    }
    return create_model(model.__name__, __base__=PortModel, **fields)


def unit_of(field: FieldInfo) -> str:
    """The unit in which YAML gives this port, empty if it has none."""
    unit = metadata_of(field, Unit)
    extra = field.json_schema_extra
    given = extra.get("unit", "") if isinstance(extra, dict) else ""
    return unit.yaml if unit else str(given)
