"""Parses YAML data into nodes, with subtrees, included files and parameters.

Parameters of files and subtrees are filled in where a reference ``"{name}"`` names them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path as FilePath
from typing import Any, Final, Literal, TypeAlias

from pydantic import ValidationError, create_model, model_validator

from bt_dualarm.spec.dimensions import ANYTHING, ValueType, dimension_of, misfit
from bt_dualarm.spec.explain import explain, in_base_units
from bt_dualarm.spec.expressions import (
    Expression,
    ExpressionError,
    parse,
    substituted,
    type_of,
    value_of,
)
from bt_dualarm.spec.node_types import (
    CONDITION_FIELDS,
    KEY,
    REFERENCE,
    RESERVED_NAMES,
    TEST,
    LanguageNode,
    NodeSpec,
    NodeType,
    PortModel,
    Template,
    WrittenKey,
    as_text,
    in_words,
    is_dynamic,
    is_expression,
    is_unknown,
    number_in,
    only,
    port,
    reference_of,
    unknown,
    validated,
)
from bt_dualarm.spec.problems import (
    Location,
    Problem,
    SpecError,
    meant_by,
    nearest,
    suggestion,
)
from bt_dualarm.spec.relative_pose import WorldPose
from bt_dualarm.spec.values import Angle, Color, Duration, Plane, Value, Vector3
from bt_dualarm.spec.yaml_reader import (
    Data,
    DataPath,
    Source,
    plain,
    read_file,
    read_text,
    with_tuples,
)

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
    "pose": WorldPose,
    "color": Color,
    "plane": Plane,
    "object": str,
    "arm": str,
    "key": str,
}
_Model: TypeAlias = type[PortModel]
_UNITS: Final = {"duration": "s", "angle": "deg"}
_RANGED: Final = ("number", "integer", "duration", "angle")
_WITH_UNIT: Final = ("number", "integer", "vector")

UnitName: TypeAlias = Literal["m", "s", "deg", "kg", "N", "Hz", "m/s", "m/s²"]


class ParamSpec(Value):
    """One parameter."""

    type: TypeName = port(
        ...,
        "Type of its value; `key` is a blackboard key that the subtree may write",
    )
    default: Data = port(None, "Default value; a parameter without one must be given")
    range: tuple[float, float] | None = port(None, "Smallest and largest number")
    choices: tuple[str, ...] | None = port(None, "Allowed texts", min_length=1)
    unit: UnitName | None = port(
        None, "Unit of a number or of a vector's components; expressions check it"
    )
    description: str = port("", "One-line description")

    @model_validator(mode="before")
    @classmethod
    def _range_in_unit(cls, data: Data) -> Data:
        """Converts texts with a unit in the range."""
        given = data.get("range") if isinstance(data, dict) else None
        if not isinstance(given, (list, tuple)):
            return data
        unit = data.get("unit") or _UNITS.get(str(data.get("type")), "")
        if not isinstance(unit, str):
            return data  # the check of the field reports it
        ends = []
        for end in given:
            number = number_in(end, unit) if isinstance(end, str) else None
            ends.append(end if number is None else number)
        return {**data, "range": tuple(ends)}

    @model_validator(mode="after")
    def _fits_type(self) -> ParamSpec:
        if self.range and self.type not in _RANGED:
            raise ValueError(f"a {self.type} has no range; types with one: {', '.join(_RANGED)}")
        if self.range and self.range[0] > self.range[1]:
            raise ValueError(f"the range goes from {self.range[0]:g} down to {self.range[1]:g}")
        if self.range and self.type == "integer" and not all(x.is_integer() for x in self.range):
            raise ValueError("the range of an integer must have integer bounds")
        if self.unit and self.type not in _WITH_UNIT:
            raise ValueError(f"a {self.type} has no unit; types with one: {', '.join(_WITH_UNIT)}")
        if self.choices and self.type != "text":
            raise ValueError("only a parameter of type text has choices")
        if self.type == "key" and self.default is not None:
            raise ValueError("a key has no default: it is given where the subtree is used")
        return self

    @property
    def value_type(self) -> ValueType:
        """Type of its values in expressions."""
        if self.type in ("duration", "angle"):
            return ValueType("number", dimension_of("s" if self.type == "duration" else "deg"))
        if self.type == "vector":
            return ValueType("array", dimension_of(self.unit or ""))
        if self.type in ("number", "integer"):
            return ValueType("number", dimension_of(self.unit or ""))
        kinds = {"boolean": "boolean", "pose": "object", "text": "string", "object": "string"}
        return ValueType(kinds.get(self.type, ""))

    @property
    def base_unit(self) -> str:
        """Unit of its number; empty if it has none."""
        return self.unit or _UNITS.get(self.type, "")

    def in_unit(self, value: Data) -> Data:
        """Returns a value with numbers in the place of texts with a unit, ``5 cm``.

        Only for poses and parameters with a ``unit``: durations and angles are converted where they
        are used.
        """
        if self.type == "pose":
            model = self._model("pose")
            pose = in_base_units({"pose": value}, lambda data: validated(model, data), model)
            return pose["pose"]
        if self.unit is None:
            return value
        if isinstance(value, list):
            return [self.in_unit(item) for item in value]
        number = number_in(value, self.unit) if isinstance(value, str) else None
        return value if number is None else number

    def complaints(self, name: str, value: Data) -> list[str]:
        """Returns every reason why ``value`` cannot be the parameter's value."""
        model = self._model(name)
        try:
            validated(model, {name: value})
        except ValidationError as error:
            complaints = []
            for found in explain(error, model, {name: value}, "parameter"):
                is_within = not found.message.startswith(f"{name}: ")  # a field of the value
                message = f"{name}: {found.message}" if is_within else found.message
                complaints.append(f"{message} ({found.hint})" if found.hint else message)
            return complaints
        return []

    def _model(self, name: str) -> _Model:
        """Returns the model of a value under a name."""
        low, high = self.range or (None, None)
        annotation = Literal[self.choices] if self.choices else _TYPES[self.type]
        field: Any = (annotation, port(..., "", unit=self.unit or "", ge=low, le=high))
        return create_model("Parameter", __base__=PortModel, **{name: field})


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
        message = f"params: expected a mapping, not {in_words(data)}"
        problems.append(source.problem(path, message, "NAME: {type: number, default: 0.5}"))
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
    spec = spec.model_copy(update={"default": spec.in_unit(data.get("default"))})
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
    data = spec.in_unit(data)
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
        types: Types of the parameters' values, as far as their declarations state them.
    """

    values: Mapping[str, Data] = field(default_factory=dict)
    prefix: str = ""
    types: Mapping[str, ValueType] = field(default_factory=dict)

    def fill(self, reference: str) -> Data:
        """Returns the value of a parameter; the reference to any other key with its prefix."""
        name = reference_of(reference)
        if name is None or not KEY.fullmatch(name):
            return reference
        return self.values.get(name, f"{{{self.prefix}{name}}}")

    def value_of(self, expression: Expression) -> Data:
        """Returns the value of an expression of parameters; with keys, an expression of those.

        Raises:
            ExpressionError: Its units do not fit together, or it has no value.
        """
        type_of(expression, self.types)
        given = [self.values.get(key) for key in expression.keys]
        for value in given:
            if is_unknown(value):
                return value
        if not any(
            key not in self.values or is_dynamic(self.values[key]) for key in expression.keys
        ):
            return value_of(expression, self.values.__getitem__)
        text = substituted(expression, lambda key: self.fill(f"{{{key}}}"))
        parse(text)  # it may have become too long
        return text

    def fill_text(self, text: str) -> str:
        """Returns text with the values of parameters inserted and keys prefixed."""
        return REFERENCE.sub(lambda match: as_text(self.fill(match[0])), text)

    def key(self, name: str) -> str:
        """Returns the key of the arm's blackboard that a node writes under ``name``."""
        return reference_of(self.values.get(name)) or f"{self.prefix}{name}"


def value_types(specs: Mapping[str, ParamSpec]) -> dict[str, ValueType]:
    """Returns the types of parameters in expressions, by name."""
    return {name: spec.value_type for name, spec in specs.items()}


_SENTENCES: Final = frozenset({"description", "name", "reason"})
"""Fields outside of trees whose texts people read: no expressions are looked for in them."""


def fill_parameters(
    source: Source, path: DataPath, value: Data, scope: Scope, problems: list[Problem]
) -> Data:
    """Returns data from outside the trees, where references are parameters only, filled in.

    Args:
        source: Source of the file.
        path: Path of the data in it.
        value: The data.
        scope: Values of the parameters.
        problems: Receives the errors of expressions.
    """
    if path[:1] == ("arms",) and path[2:] == ("tree",):
        return value  # its parser fills it in
    if isinstance(value, dict):
        return {
            key: fill_parameters(source, (*path, key), item, scope, problems)
            for key, item in value.items()
        }
    if isinstance(value, list):
        return [
            fill_parameters(source, (*path, index), item, scope, problems)
            for index, item in enumerate(value)
        ]
    name = reference_of(value)
    if name is not None:
        return scope.values.get(name, value)
    if not is_expression(value) or (path and path[-1] in _SENTENCES):
        return value
    try:
        expression = parse(value)
        for key in expression.keys:
            if key not in scope.values:
                hint = suggestion(key, scope.values, "parameter")
                start = value.index(f"{{{key}}}")
                message = f"there is no parameter '{key}'"
                raise ExpressionError(message, start, start + len(key) + 2, hint)
        return scope.value_of(expression)
    except ExpressionError as error:
        location = source.part_location(path, error.start, error.end)
        problems.append(Problem(location, str(error), error.hint))
        return unknown("expression")


FORMAT: Final = 1
"""Version of the format, the value of ``bt_dualarm:`` in a file."""

MAX_FILES: Final = 50
"""Files that one file may include, directly and through its includes."""

MAX_EXPANDED: Final = 5_000
"""Nodes of all trees of a file with every use of a subtree expanded."""

_MAX_DEPTH: Final = 64
_LONGEST_NAME: Final = 60
_FIELDS: Final = frozenset({"bt_dualarm", "description", "include", "subtrees"})
_SUBTREE_FIELDS: Final = frozenset({"description", "params", "tree"})
_KEY_RULE: Final = "a key has letters, digits and _ and begins with a letter"


@dataclass(frozen=True, eq=False)
class SubtreeSpec:
    """Declaration of a subtree.

    Attributes:
        name: Name in the file that declares it.
        source: File that declares it.
        path: Path of its tree in that file.
        params: Parameters that a use may set.
        library: Subtrees that its own nodes may use.
    """

    name: str
    source: Source
    path: DataPath
    params: Mapping[str, ParamSpec]
    library: Mapping[str, SubtreeSpec]


@dataclass(frozen=True)
class ParseContext:
    """A position in a file, with the names that are visible there.

    Attributes:
        source: The file.
        path: Path in the file.
        scope: Meaning of references.
        library: Subtrees by name.
        uses: Subtrees that are being expanded here, outermost first.
        depth: Number of ancestor nodes, across files.
        user: Location where the innermost of these subtrees is used.
    """

    source: Source
    path: DataPath
    scope: Scope = field(default_factory=Scope)
    library: Mapping[str, SubtreeSpec] = field(default_factory=dict)
    uses: tuple[SubtreeSpec, ...] = ()
    depth: int = 0
    user: Location | None = None

    def into(self, *parts: str | int) -> ParseContext:
        """Returns the context at these keys and indices below the path."""
        return self._at((*self.path, *parts), self.depth)

    def deeper(self) -> ParseContext:
        """Returns the context at the same path, below one more node."""
        return self._at(self.path, self.depth + 1)

    def _at(self, path: DataPath, depth: int) -> ParseContext:
        # One is made for every value of a file: `dataclasses.replace` would be too slow.
        return ParseContext(
            self.source, path, self.scope, self.library, self.uses, depth, self.user
        )

    @property
    def data(self) -> Data:
        """Data at the path."""
        return self.source.get(self.path)

    def problem(self, message: str, hint: str = "", *, key: bool = False) -> Problem:
        """Returns an error at the path."""
        return self.source.problem(self.path, message, hint, key=key)


@dataclass
class SubtreeUse:
    """A node that uses a subtree.

    Args:
        here: Context of that node.
        ports: Its ports, with references resolved in its own scope.
        number: Number of the use, unique in a file.

    Attributes:
        problems: Problems found so far.
    """

    here: ParseContext
    ports: Mapping[str, Data]
    number: int
    problems: list[Problem] = field(default_factory=list)

    def root_context(self) -> ParseContext | None:
        """Returns the context of the subtree's root, or None with the reason in the problems."""
        name = self.ports.get("use")
        if not isinstance(name, str) or is_unknown(name):
            return None  # the check of the ports reports it
        subtree = self.here.library.get(name)
        if subtree is None:
            hint = suggestion(name, self.here.library, "subtree")
            self._add(("use",), f"there is no subtree '{name}'", hint)
            return None
        if subtree in self.here.uses:
            circle = [*self.here.uses[self.here.uses.index(subtree) :], subtree]
            names = " → ".join(item.name for item in circle)
            self._add(("use",), f"subtrees use each other in a cycle: {names}")
            return None
        prefix = f"{self.here.scope.prefix}{name}#{self.number}/"
        return ParseContext(
            subtree.source,
            subtree.path,
            Scope(self._values(subtree), prefix, value_types(subtree.params)),
            subtree.library,
            (*self.here.uses, subtree),
            self.here.depth,
            self.here.source.key_location(self.here.path),
        )

    def _values(self, subtree: SubtreeSpec) -> dict[str, Data]:
        given = self.ports.get("params", {})
        if not isinstance(given, dict):  # the check of the ports reports it
            return {name: unknown(name) for name in subtree.params}
        for name in given:
            if name not in subtree.params:
                hint = suggestion(name, subtree.params, "parameter")
                message = f"subtree '{subtree.name}' has no parameter '{name}'"
                self._add(("params", name), message, hint, key=True)
        return {
            name: self._value(subtree, name, spec, given) for name, spec in subtree.params.items()
        }

    def _value(
        self, subtree: SubtreeSpec, name: str, spec: ParamSpec, given: Mapping[str, Data]
    ) -> Data:
        if name not in given:
            if spec.default is not None:
                return spec.default
            if name in self.ports:  # beside `params`: the check of the ports reports it
                return unknown(name)
            message = f"subtree '{subtree.name}' needs its parameter '{name}'"
            self._add((), message, f"{name}: {spec.description or spec.type}", key=True)
            return unknown(name)
        if isinstance(spec, Misdeclared):
            return spec.default
        value = spec.in_unit(given[name])
        if reference_of(value) is None and spec.type == "key":
            message = f"{name}: expected a blackboard key"
            self._add(("params", name), message, f'for example "{{{name}}}"')
        elif not is_dynamic(value) and not is_unknown(value):
            complaints = spec.complaints(name, value)
            for complaint in complaints:
                self._add(("params", name), complaint)
            if complaints:  # reported here, and not again where the subtree uses it
                return unknown(name)
        written = self.here.into("params", name).data
        if is_dynamic(written) and isinstance(written, str):
            try:
                found = type_of(parse(written), self.here.scope.types)
            except ExpressionError:  # the parser has reported it
                found = ANYTHING
            complaint = misfit(found, spec.value_type.dimension)
            if complaint:
                self._add(("params", name), f"{name}: {complaint}")
        return value

    def _add(
        self, path: tuple[str, ...], message: str, hint: str = "", *, key: bool = False
    ) -> None:
        self.problems.append(self.here.into(*path).problem(message, hint, key=key))


@dataclass
class Libraries:
    """Reads the subtrees of a file and of its includes, each file once.

    Args:
        root: Folder outside which no file is read, wherever a symlink leads.
        texts: Texts of files by path, used instead of those on the disk.

    Attributes:
        problems: Problems found so far.
        included: Files that were included, in the order in which they were read.
    """

    root: FilePath
    texts: Mapping[str, str] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)
    included: list[Source] = field(default_factory=list)
    _known: dict[FilePath, dict[str, SubtreeSpec]] = field(default_factory=dict)

    def of(self, source: Source, stack: tuple[FilePath, ...] = ()) -> dict[str, SubtreeSpec]:
        """Returns the subtrees that the trees of ``source`` may use, by name."""
        here = FilePath(source.file).resolve()
        library: dict[str, SubtreeSpec] = {}
        self._known[here] = library
        library.update(self._declared(source, library))
        for index, path in self._included(source):
            entry: DataPath = ("include", index)
            for name, subtree in self._file(source, entry, path, (*stack, here)).items():
                if library.setdefault(name, subtree) is not subtree:
                    other = library[name].source.file
                    message = f"subtree '{name}' is already declared in {other}"
                    self.problems.append(source.problem(entry, message, "rename one of the two"))
        return library

    def _declared(
        self, source: Source, library: dict[str, SubtreeSpec]
    ) -> Iterator[tuple[str, SubtreeSpec]]:
        subtrees = source.data.get("subtrees")
        if subtrees is not None and not isinstance(subtrees, dict):
            message = f"subtrees: expected a mapping, not {in_words(subtrees)}"
            self.problems.append(source.problem(("subtrees",), message))
            return
        for name, body in (subtrees or {}).items():
            path: DataPath = ("subtrees", name)
            if not KEY.fullmatch(name):
                hint = "a subtree's name has letters, digits and _ and begins with a letter"
                message = f"'{name}' cannot be a name"
                self.problems.append(source.problem(path, message, hint, key=True))
            elif not isinstance(body, dict) or "tree" not in body:
                message = f"subtree '{name}' has no tree"
                hint = "name: {params: {…}, tree: node}"
                self.problems.append(source.problem(path, message, hint, key=True))
            else:
                self._refuse_others(source, path, frozenset(body), _SUBTREE_FIELDS)
                params = declared(source, (*path, "params"), self.problems)
                yield name, SubtreeSpec(name, source, (*path, "tree"), params, library)

    def _refuse_others(
        self, source: Source, path: DataPath, given: frozenset[str], allowed: frozenset[str]
    ) -> None:
        self.problems += [
            source.problem(
                (*path, name),
                f"unknown field '{name}'",
                suggestion(name, allowed, "field"),
                key=True,
            )
            for name in sorted(given - allowed)
        ]

    def _included(self, source: Source) -> Iterator[tuple[int, str]]:
        include = source.data.get("include")
        if include is not None and not isinstance(include, list):
            message = f"include: expected a list of files, not {in_words(include)}"
            self.problems.append(source.problem(("include",), message))
            return
        for index, path in enumerate(include or ()):
            if isinstance(path, str):
                yield index, path
            else:
                message = f"include: expected a file, not {in_words(path)}"
                self.problems.append(source.problem(("include", index), message))

    def _file(
        self, source: Source, entry: DataPath, path: str, stack: tuple[FilePath, ...]
    ) -> dict[str, SubtreeSpec]:
        """Returns the library of an included file; empty if it cannot be used."""
        shown = FilePath(source.file).parent / path
        try:
            resolved = shown.resolve()
            if resolved.is_symlink():  # from Python 3.13 on, resolve() lets a loop pass
                raise RuntimeError("a loop of symlinks")
        except (OSError, RuntimeError, ValueError) as error:  # a name too long, a loop
            return self._refuse(source, entry, f"'{path}' cannot be resolved: {error}")
        if FilePath(path).is_absolute() or not resolved.is_relative_to(self.root.resolve()):
            return self._refuse(source, entry, f"'{path}' is outside the folder {self.root}")
        if resolved in stack:
            names = " → ".join(file.name for file in (*stack[stack.index(resolved) :], resolved))
            return self._refuse(source, entry, f"files include each other in a cycle: {names}")
        if resolved in self._known:
            return self._known[resolved]
        if len(self._known) > MAX_FILES:
            return self._refuse(source, entry, f"more than {MAX_FILES} files are included")
        try:
            text = self.texts.get(str(shown))
            included = read_file(shown) if text is None else read_text(text, str(shown))
        except SpecError as error:
            self.problems += error.problems
            return self._refuse(source, entry, f"'{shown}' cannot be used")
        if not isinstance(included.data, dict) or included.data.get("bt_dualarm") != FORMAT:
            return self._refuse(
                source, entry, f"'{shown}' does not begin with 'bt_dualarm: {FORMAT}'"
            )
        self._refuse_others(included, (), frozenset(included.data), _FIELDS)
        self.included.append(included)
        return self.of(included, stack)

    def _refuse(self, source: Source, entry: DataPath, message: str) -> dict[str, SubtreeSpec]:
        self.problems.append(source.problem(entry, f"include: {message}"))
        return {}


_Child: TypeAlias = tuple[str, Data, ParseContext]
"""Role of a child, its data, its context."""


@dataclass
class Parser:
    """Parses the trees of one file, expanding the subtrees that they use.

    A node whose type is none of the language's is taken for that of a skill with any ports.

    Args:
        language: Node types of the language by name.

    Attributes:
        problems: Problems found so far.
        used: Subtrees that the trees use, directly or through others.
    """

    language: Mapping[str, LanguageNode]
    problems: list[Problem] = field(default_factory=list)
    used: set[SubtreeSpec] = field(default_factory=set)
    _count: int = 0
    _uses: int = 0

    def tree(self, context: ParseContext) -> NodeSpec | None:
        """Returns the tree at a position, or None with the reason in the problems."""
        return self._node(context.data, context)

    def _node(self, data: Data, context: ParseContext) -> NodeSpec | None:
        self._count += 1
        if self._count > MAX_EXPANDED:
            if self._count == MAX_EXPANDED + 1:
                self._add(context, f"the trees have more than {MAX_EXPANDED} nodes")
            return None
        if context.depth >= _MAX_DEPTH:
            self._add(context, f"nodes are nested deeper than {_MAX_DEPTH} levels")
            return None
        if isinstance(data, str):
            data = {TEST: data} if is_dynamic(data) else {data: None}
        if not isinstance(data, dict) or len(data) != 1:
            self._add(context, *_not_a_node(data))
            return None
        name, body = next(iter(data.items()))
        node_type = self.language.get(name) or NodeType(name, "")
        given = [one for one in CONDITION_FIELDS if isinstance(body, dict) and one in body]
        if not given:
            return self._node_of_type(node_type, body, context.deeper())
        bare = {key: item for key, item in body.items() if key not in given}
        node: NodeSpec | None = self._node_of_type(node_type, bare, context.deeper())
        for condition in reversed(given):
            here = context.into(name, condition)
            node = self._with_condition(condition, body[condition], here, node)
        return node

    def _with_condition(
        self, name: str, data: Data, context: ParseContext, child: NodeSpec | None
    ) -> NodeSpec | None:
        """Returns a node with a condition around it."""
        condition = self._node(data, context.deeper())
        self._count += 1
        if condition is None or child is None:
            return child
        return NodeSpec(
            name,
            name,
            {},
            (condition, child),
            tuple(slot.name for slot in self.language[name].slots),
            context.source,
            context.path[:-1],
            user=context.user,
            parameters=frozenset(context.scope.values),
            types=context.scope.types,
        )

    def _node_of_type(self, node_type: NodeType, body: Data, context: ParseContext) -> NodeSpec:
        here = context.into(node_type.name)
        fields = _fields(node_type, body)
        if fields is None:
            # A skill may have a shorthand, which only the check knows: it reports such a body.
            if isinstance(node_type, LanguageNode):
                self._add(here, *not_a_body(node_type, body))
            node = NodeSpec(node_type.name, node_type.name, {}, whole=False)
            return replace(node, source=context.source, path=context.path, user=context.user)
        children = list(self._children(node_type, fields, here))
        ports = {
            port: self._port(node_type, port, value, here.into(port))
            for port, value in fields.items()
            if port not in node_type.no_data_fields
        }
        if node_type.uses:
            children += self._use(ports, here)
        return NodeSpec(
            node_type.name,
            self._name(node_type, fields.get("name"), ports, here),
            ports,
            tuple(child for _, child in children),
            tuple(slot for slot, _ in children),
            context.source,
            context.path,
            user=context.user,
            parameters=frozenset(context.scope.values),
            types=context.scope.types,
        )

    def _name(
        self, node_type: NodeType, given: Data, ports: Mapping[str, Data], here: ParseContext
    ) -> str:
        if given is None:  # a subtree's name may have come from a parameter
            used = ports.get(node_type.uses)
            return used if isinstance(used, str) and KEY.fullmatch(used) else node_type.name
        if (
            isinstance(given, str)
            and 0 < len(given) <= _LONGEST_NAME
            and given.isprintable()
            and not set(given) & set("/#{}")
        ):
            return given
        hint = f"at most {_LONGEST_NAME} characters, without / # {{ }}"
        self._add(here.into("name"), f"name: {in_words(given)} cannot be a node's name", hint)
        return node_type.name

    def _children(
        self, node_type: NodeType, fields: Mapping[str, Data], here: ParseContext
    ) -> Iterator[tuple[str, NodeSpec]]:
        for slot, data, context in self._child_fields(node_type, fields, here):
            child = self._node(data, context)
            if child is not None:
                yield slot, child

    def _child_fields(
        self, node_type: NodeType, fields: Mapping[str, Data], here: ParseContext
    ) -> Iterator[_Child]:
        misspelt = _misspelt(node_type, fields)
        if node_type.many and "children" not in misspelt:
            children = fields.get("children")
            # A list may also be the whole body of the node.
            at = here.into("children") if isinstance(here.data, dict) else here
            if isinstance(children, list) and children:
                for index, child in enumerate(children):
                    yield "children", child, at.into(index)
            else:
                hint = f"{node_type.name}: [node, node, …], or a mapping with 'children'"
                self._add(at, f"{node_type.name}: has no children", hint, key=True)
        if node_type.cases and "cases" not in misspelt:
            cases = fields.get("cases")
            at = here.into("cases")
            if isinstance(cases, dict) and cases:
                for case, child in cases.items():
                    yield case, child, at.into(case)
            else:
                self._add(
                    at, f"{node_type.name}: has no cases", "cases: {value: node, …}", key=True
                )
        for slot in node_type.slots:
            if fields.get(slot.name) is not None:
                is_bare = node_type.bare_child and _is_bare_child(node_type, here.data)
                yield slot.name, fields[slot.name], here if is_bare else here.into(slot.name)
            elif slot.required and slot.name not in misspelt:
                message = f"{node_type.name}: '{slot.name}' is missing"
                self._add(here, message, f"{slot.name}: a node", key=True)

    def _port(self, node_type: NodeType, port: str, value: Data, here: ParseContext) -> Data:
        """Returns the value of a port with parameters filled in and keys prefixed."""
        info = node_type.ports.model_fields.get(port)
        metadata = {type(item) for item in info.metadata} if info else set()
        if Template in metadata and isinstance(value, str):
            for match in REFERENCE.finditer(value):
                if self._is_key(match[1], here) and is_expression(here.scope.fill(match[0])):
                    message = f"{port}: {match[0]} is an expression of keys where it is given"
                    self._add(here, message, "write it to a key with 'set' there, and give the key")
            return here.scope.fill_text(value)
        if WrittenKey in metadata and isinstance(value, str):
            if not KEY.fullmatch(value):
                bare = reference_of(value) or ""
                hint = f"without braces: {bare}" if KEY.fullmatch(bare) else _KEY_RULE
                self._add(here, f"{port}: {in_words(value)} cannot be a key", hint)
                return unknown("key")
            return here.scope.key(value)
        return self._filled(value, here)

    def _filled(self, value: Data, here: ParseContext) -> Data:
        """Returns a value with parameters filled in and keys prefixed; unknown where it is wrong.

        Expressions of parameters are replaced by their values.
        """
        if isinstance(value, dict):
            return {part: self._filled(item, here.into(part)) for part, item in value.items()}
        if isinstance(value, list):
            return [self._filled(item, here.into(part)) for part, item in enumerate(value)]
        key = reference_of(value)
        if key is not None:
            return here.scope.fill(value) if self._is_key(key, here) else unknown(key)
        if not is_expression(value):
            return value
        try:
            return here.scope.value_of(parse(value))
        except ExpressionError as error:
            location = here.source.part_location(here.path, error.start, error.end)
            self.problems.append(Problem(location, str(error), error.hint))
            return unknown("expression")

    def _is_key(self, key: str, here: ParseContext) -> bool:
        """Returns whether a text in braces can be a key; if not, reports it."""
        if KEY.fullmatch(key):
            return True
        self._add(here, f"'{{{key}}}' is not a reference to a key", _KEY_RULE)
        return False

    def _use(self, ports: Mapping[str, Data], here: ParseContext) -> list[tuple[str, NodeSpec]]:
        """Expand the subtree that a node uses."""
        self._uses += 1
        use = SubtreeUse(here, ports, self._uses)
        context = use.root_context()
        self.problems += use.problems
        if context is None:
            return []
        self.used.update(context.uses)
        root = self.tree(context)
        return [] if root is None else [("child", root)]

    def _add(
        self, context: ParseContext, message: str, hint: str = "", *, key: bool = False
    ) -> None:
        self.problems.append(context.problem(message, hint, key=key))


def _fields(node_type: NodeType, body: Data) -> dict[str, Data] | None:
    """Returns the body of a node as a mapping, whatever its notation; None if it is invalid."""
    if body is None:
        return {}
    if node_type.bare_child and _is_bare_child(node_type, body):
        return {node_type.slots[0].name: body}
    if isinstance(body, dict):
        return dict(body)
    if isinstance(body, list):
        return {"children": body} if node_type.many else None
    return {node_type.shorthand: body} if node_type.shorthand else None


def _is_bare_child(node_type: NodeType, body: Data) -> bool:
    return isinstance(body, str) or (
        isinstance(body, dict) and len(body) == 1 and not node_type.no_data_fields & body.keys()
    )


def _misspelt(node_type: NodeType, fields: Mapping[str, Data]) -> set[str]:
    """Returns missing fields that an unknown field most likely stands for: the check reports it."""
    known = node_type.fields_besides_ports | node_type.ports.model_fields.keys()
    others = fields.keys() - known
    meant = {meant_by(name, known) or nearest(name, known) for name in others}
    if any(isinstance(fields[name], dict) or name in RESERVED_NAMES for name in others):
        meant |= {"children", *(slot.name for slot in node_type.slots)}  # a node in their place
    return {name for name in node_type.fields_besides_ports - fields.keys() if name in meant}


def not_a_body(node_type: NodeType, body: Data) -> tuple[str, str]:
    """Returns message and hint for a body that no node of this type can have."""
    hint = ""
    if isinstance(body, str) and node_type.slots:
        hint = f"write {{{node_type.slots[0].name}: {body}}}"
    elif isinstance(body, (str, int, float)):
        hint = _as_mapping(node_type, body)
    elif isinstance(body, list):
        hint = "put several nodes below 'sequence:'" if node_type.slots else ""
    wanted = "a list of nodes" if node_type.many else "a mapping of ports"
    return f"{node_type.name}: expected {wanted}, not {in_words(body)}", hint


def _as_mapping(node_type: NodeType, body: Data) -> str:
    """Returns a hint with the mapping of the port that a bare value most likely stands for."""
    model = node_type.ports
    ports = [name for name, info in model.model_fields.items() if info.is_required()]
    for name in ports or model.exactly_one_of:
        try:
            validated(only(model, name), {name: body})
        except ValidationError:
            continue
        others = [one for one in ports if one != name]
        others += [slot.name for slot in node_type.slots if slot.required]
        rest = "".join(f", {one}: …" for one in others)
        return f"write {{{name}: {body}{rest}}}"
    return f"for example: {node_type.example}" if node_type.example else ""


def _not_a_node(data: Data) -> tuple[str, str]:
    if isinstance(data, dict) and data:
        keys = ", ".join(list(data)[:4])
        hint = f"indent the content of '{next(iter(data))}' further"
        return f"a node has one key, its kind; found {len(data)}: {keys}", hint
    hint = "a node is written 'kind: {port: value}'"
    if isinstance(data, bool):
        hint = f"as a condition: {{test: {in_words(data)}}}"
    if isinstance(data, list):
        hint = "for several nodes write 'sequence:' above the list"
    return f"expected a node, not {in_words(data)}", hint
