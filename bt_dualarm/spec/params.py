"""Parameters of a file or a subtree: declared with type, default, range; given by the user."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, Literal, TypeAlias

from pydantic import Field, ValidationError, create_model, model_validator

from bt_dualarm.spec.color import Color
from bt_dualarm.spec.explain import explain
from bt_dualarm.spec.mapping import plain
from bt_dualarm.spec.plane import Plane
from bt_dualarm.spec.ports import KEY, PortModel, port, unknown, validated
from bt_dualarm.spec.problems import Place, Problem, SpecError, suggestion
from bt_dualarm.spec.reader import read_text
from bt_dualarm.spec.source import Data, Path, Source, with_tuples
from bt_dualarm.spec.values import Angle, Duration, PoseSpec, Value, Vector3
from bt_dualarm.spec.wording import in_words

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
        "Type of its value; `key` stands for a key of the blackboard that the subtree may write",
    )
    default: Data = port(None, "Value in YAML's notation; a parameter without one must be given")
    range: tuple[float, float] | None = port(None, "Smallest and largest number")
    choices: tuple[str, ...] | None = port(None, "Allowed texts", min_length=1)
    description: str = port("", "One line for people")

    @model_validator(mode="after")
    def _fits_type(self) -> ParamSpec:
        if self.range and self.type not in _RANGED:
            raise ValueError(f"a {self.type} has no range; types with one: {', '.join(_RANGED)}")
        if self.range and self.range[0] > self.range[1]:
            raise ValueError(f"the range goes from {self.range[0]:g} down to {self.range[1]:g}")
        if self.range and self.type == "integer" and not all(x.is_integer() for x in self.range):
            raise ValueError("the range of an integer is one of whole numbers")
        if self.choices and self.type != "text":
            raise ValueError("only a text has choices")
        if self.type == "key" and self.default is not None:
            raise ValueError("a key has no default: whoever uses the subtree names it")
        return self

    def complaints(self, name: str, value: Data) -> list[str]:
        """Everything that keeps ``value`` from being this parameter's value."""
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
    """Stands for a parameter whose declaration is refused: nobody complains of its uses."""

    @classmethod
    def of(cls, name: str) -> Misdeclared:
        """That of this name; whatever it is given, its value is not known."""
        return cls(type="number", default=unknown(name))


def declared(source: Source, path: Path, problems: list[Problem]) -> dict[str, ParamSpec]:
    """The parameters declared in the mapping at ``path`` of a file."""
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
    source: Source, path: Path, name: str, data: Data, problems: list[Problem]
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
            place = (*path, *found.path)
            problems.append(source.problem(place, message, found.hint, key=found.at_key))
        return Misdeclared.of(name)
    spec = spec.model_copy(update={"default": data.get("default")})
    complaints = [] if spec.default is None else spec.complaints(name, spec.default)
    place = (*path, "default")
    problems += [source.problem(place, f"default of {complaint}") for complaint in complaints]
    return spec.model_copy(update={"default": unknown(name)}) if complaints else spec


def chosen(
    specs: Mapping[str, ParamSpec], given: Mapping[str, object], file: str
) -> tuple[dict[str, Data], list[Problem]]:
    """Values of a file's parameters, by default those that it declares, and what is wrong.

    Args:
        specs: Parameters that the file declares, by name.
        given: Values by name: text in YAML's notation, as the command line has it, or Python data.
        file: Name of the file in messages.
    """
    problems: list[Problem] = []
    values: dict[str, Data] = {name: spec.default for name, spec in specs.items()}
    for name, value in given.items():
        if name not in specs:
            hint = suggestion(name, specs, "parameter") if specs else "it declares none"
            problems.append(Problem(Place(file), f"it has no parameter '{name}'", hint))
        elif not isinstance(specs[name], Misdeclared):
            values[name], complaints = _given(name, specs[name], value)
            problems += [Problem(Place(file), f"parameter {complaint}") for complaint in complaints]
    for name, value in values.items():
        if value is None:
            hint = f"{name}: {specs[name].description}" if specs[name].description else ""
            problems.append(Problem(Place(file), f"parameter '{name}' must be given", hint))
            values[name] = unknown(name)
    return values, problems


def _given(name: str, spec: ParamSpec, value: object) -> tuple[Data, list[str]]:
    """A parameter's value; not known where there are complaints: said once, not at every use."""
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
    """A value from the command line, in YAML's notation; what is no YAML is text."""
    try:
        return read_text(text).data
    except SpecError:
        return text
