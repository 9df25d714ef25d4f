"""Parameters of files and subtrees, and the resolution of references ``"{name}"``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal, TypeAlias

from pydantic import Field, ValidationError, create_model, model_validator

from bt_dualarm.spec.explain import explain
from bt_dualarm.spec.ports import (
    KEY,
    REFERENCE,
    PortModel,
    as_text,
    in_words,
    port,
    reference_of,
    unknown,
    validated,
)
from bt_dualarm.spec.problems import Location, Problem, SpecError, suggestion
from bt_dualarm.spec.values import Angle, Color, Duration, Plane, PoseSpec, Value, Vector3
from bt_dualarm.spec.yaml_reader import Data, DataPath, Source, plain, read_text, with_tuples

TypeName: TypeAlias = Literal[
    "number", "integer", "text", "boolean", "duration", "angle", "vector", "pose", "color",
    "plane", "object", "arm", "key",
]  # fmt: skip

_TYPES: Final[Mapping[str, Any]] = {
    "number": float,
    "integer": int,
    "text": str,
    "boolean": bool,
    "duration": Duration,
    "angle": Angle,
    "vector": Vector3,
    "pose": PoseSpec,
    "color": Color,
    "plane": Plane,
    "object": str,
    "arm": str,
    "key": str,
}
_RANGED: Final = ("number", "integer", "duration", "angle")


class ParamSpec(Value):
    """One parameter."""

    type: TypeName = port(
        ...,
        "Type of its value; `key` is a blackboard key that the subtree may write",
    )
    default: Data = port(None, "Default value; a parameter without one must be given")
    range: tuple[float, float] | None = port(None, "Smallest and largest number")
    choices: tuple[str, ...] | None = port(None, "Allowed texts", min_length=1)
    description: str = port("", "One-line description")

    @model_validator(mode="after")
    def _fits_type(self) -> ParamSpec:
        if self.range and self.type not in _RANGED:
            raise ValueError(f"a {self.type} has no range; types with one: {', '.join(_RANGED)}")
        if self.range and self.range[0] > self.range[1]:
            raise ValueError(f"the range goes from {self.range[0]:g} down to {self.range[1]:g}")
        if self.range and self.type == "integer" and not all(x.is_integer() for x in self.range):
            raise ValueError("the range of an integer must have integer bounds")
        if self.choices and self.type != "text":
            raise ValueError("only a parameter of type text has choices")
        if self.type == "key" and self.default is not None:
            raise ValueError("a key has no default: it is given where the subtree is used")
        return self

    def complaints(self, name: str, value: Data) -> list[str]:
        """Returns every reason why ``value`` cannot be the parameter's value."""
        low, high = self.range or (None, None)
        annotation = Literal[self.choices] if self.choices else _TYPES[self.type]
        field: Any = (annotation, Field(ge=low, le=high))
        model = create_model("Parameter", __base__=PortModel, **{name: field})
        try:
            validated(model, {name: value})
        except ValidationError as error:
            found = explain(error, model, {name: value}, "parameter")
            return [f"{f.message} ({f.hint})" if f.hint else f.message for f in found]
        return []


class Misdeclared(ParamSpec):
    """Stand-in for a parameter with an invalid declaration; its uses are not checked."""

    @classmethod
    def of(cls, name: str) -> Misdeclared:
        """Returns the stand-in for a parameter of this name, whose value stays unknown."""
        return cls(type="number", default=unknown(name))


def declared(source: Source, path: DataPath, problems: list[Problem]) -> dict[str, ParamSpec]:
    """Returns the parameters declared in the mapping at ``path`` of a file."""
    data = source.get(path)
    if data is None:
        return {}
    if not isinstance(data, dict):
        problems.append(source.problem(path, f"expected a mapping, not {in_words(data)}"))
        return {}
    return {
        name: _declared_one(source, (*path, name), name, item, problems)
        for name, item in data.items()
    }


def _declared_one(
    source: Source, path: DataPath, name: str, data: Data, problems: list[Problem]
) -> ParamSpec:
    if not KEY.fullmatch(name):
        hint = "a parameter's name has letters, digits and _ and begins with a letter"
        problems.append(source.problem(path, f"'{name}' cannot be a name", hint, key=True))
        return Misdeclared.of(name)
    if not isinstance(data, dict):
        hint = "for example: {type: number, default: 0.5, range: [0.1, 1]}"
        problems.append(source.problem(path, f"expected a mapping, not {in_words(data)}", hint))
        return Misdeclared.of(name)
    try:
        spec = ParamSpec.model_validate(with_tuples(data))
    except ValidationError as error:
        for found in explain(error, ParamSpec, data, "field"):
            message = found.message if found.path else f"{name}: {found.message}"
            at = (*path, *found.path)
            problems.append(source.problem(at, message, found.hint, key=found.at_key))
        return Misdeclared.of(name)
    spec = spec.model_copy(update={"default": data.get("default")})
    complaints = [] if spec.default is None else spec.complaints(name, spec.default)
    at = (*path, "default")
    problems += [source.problem(at, f"default of {complaint}") for complaint in complaints]
    return spec.model_copy(update={"default": unknown(name)}) if complaints else spec


def chosen(
    specs: Mapping[str, ParamSpec], given: Mapping[str, object], file: str
) -> tuple[dict[str, Data], list[Problem]]:
    """Returns the values of a file's parameters, and the problems of the given ones.

    Args:
        specs: Parameters that the file declares, by name.
        given: Values by name, as YAML text from the command line or as Python data; the other
            parameters have their defaults.
        file: Name of the file in messages.
    """
    problems: list[Problem] = []
    values: dict[str, Data] = {name: spec.default for name, spec in specs.items()}
    for name, value in given.items():
        if name not in specs:
            hint = suggestion(name, specs, "parameter") if specs else "it declares none"
            problems.append(Problem(Location(file), f"it has no parameter '{name}'", hint))
        elif not isinstance(specs[name], Misdeclared):
            values[name], complaints = _given(name, specs[name], value)
            problems += [
                Problem(Location(file), f"parameter {complaint}") for complaint in complaints
            ]
    for name, value in values.items():
        if value is None:
            hint = f"{name}: {specs[name].description}" if specs[name].description else ""
            problems.append(Problem(Location(file), f"parameter '{name}' must be given", hint))
            values[name] = unknown(name)
    return values, problems


def _given(name: str, spec: ParamSpec, value: object) -> tuple[Data, list[str]]:
    """Returns a parameter's value, with complaints if it is invalid.

    An invalid value becomes an unknown one, so that it is reported once and not at every use.
    """
    if isinstance(value, str):
        data = value if spec.type in ("text", "object", "arm") else _parsed(value)
    else:
        try:
            data, _ = plain(value, "")
        except SpecError as error:
            return unknown(name), [f"{name}: {problem.message}" for problem in error.problems]
    complaints = spec.complaints(name, data)
    return (unknown(name) if complaints else data), complaints


def _parsed(text: str) -> Data:
    """Returns a value from the command line, read as YAML; text if it is not YAML."""
    try:
        return read_text(text).data
    except SpecError:
        return text


@dataclass(frozen=True)
class Scope:
    """Meaning of references in one tree, or in one use of a subtree.

    Each use of a subtree has its own keys: they have a prefix that no author can write.

    Attributes:
        values: Values of the parameters; one that was given as a key is ``"{outer key}"``.
        prefix: Prefix of every other key.
    """

    values: Mapping[str, Data] = field(default_factory=dict)
    prefix: str = ""

    def fill(self, value: Data) -> Data:
        """Returns data with parameters replaced and keys prefixed."""
        if isinstance(value, dict):
            return {key: self.fill(item) for key, item in value.items()}
        if isinstance(value, list):
            return [self.fill(item) for item in value]
        name = reference_of(value)
        if name is None or not KEY.fullmatch(name):
            return value
        return self.values.get(name, f"{{{self.prefix}{name}}}")

    def fill_text(self, text: str) -> str:
        """Returns text with the values of parameters inserted and keys prefixed."""
        return REFERENCE.sub(lambda match: as_text(self.fill(match[0])), text)

    def key(self, name: str) -> str:
        """Returns the key of the arm's blackboard that a node writes under ``name``."""
        return reference_of(self.values.get(name)) or f"{self.prefix}{name}"


def fill_parameters(value: Data, values: Mapping[str, Data]) -> Data:
    """Returns data from outside the trees, where references are parameters only, filled in."""
    if isinstance(value, dict):
        return {key: fill_parameters(item, values) for key, item in value.items()}
    if isinstance(value, list):
        return [fill_parameters(item, values) for item in value]
    name = reference_of(value)
    return value if name is None else values.get(name, value)
