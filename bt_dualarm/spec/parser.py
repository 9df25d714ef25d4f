"""Parses YAML data into nodes, with the subtrees of the file and of those that it includes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path as FilePath
from typing import Final, TypeAlias

from bt_dualarm.spec.node_types import LanguageNode, NodeSpec, NodeType
from bt_dualarm.spec.parameters import Misdeclared, ParamSpec, Scope, declared
from bt_dualarm.spec.ports import (
    KEY,
    REFERENCE,
    Template,
    WrittenKey,
    in_words,
    is_unknown,
    reference_of,
    unknown,
)
from bt_dualarm.spec.problems import Location, Problem, SpecError, nearest, suggestion
from bt_dualarm.spec.yaml_reader import Data, DataPath, Source, read_file, read_text

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
_WITHIN_TEXT: Final = (
    "there are no expressions; only the messages of log and fail may contain references"
)


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
            Scope(self._values(subtree), prefix),
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
            message = f"subtree '{subtree.name}' needs its parameter '{name}'"
            self._add((), message, f"{name}: {spec.description or spec.type}", key=True)
            return unknown(name)
        if isinstance(spec, Misdeclared):
            return spec.default
        value = given[name]
        if reference_of(value) is None and spec.type == "key":
            message = f"{name}: expected a blackboard key"
            self._add(("params", name), message, f'for example "{{{name}}}"')
        elif reference_of(value) is None:
            for complaint in spec.complaints(name, value):
                self._add(("params", name), complaint)
        return value

    def _add(
        self, path: tuple[str, ...], message: str, hint: str = "", *, key: bool = False
    ) -> None:
        self.problems.append(self.here.into(*path).problem(message, hint, key=key))


@dataclass
class Libraries:
    """Reads the subtrees of a file and of its includes, each file once.

    Args:
        root: Folder outside of which no file is read, wherever a symlink leads.
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
            return self._refuse(source, entry, f"'{path}' is outside of the folder {self.root}")
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
            data = {data: None}
        if not isinstance(data, dict) or len(data) != 1:
            self._add(context, *_not_a_node(data))
            return None
        name, body = next(iter(data.items()))
        node_type = self.language.get(name) or NodeType(name, "")
        return self._node_of_type(node_type, body, context.deeper())

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
                yield slot.name, fields[slot.name], here.into(slot.name)
            elif slot.required and slot.name not in misspelt:
                message = f"{node_type.name}: '{slot.name}' is missing"
                self._add(here, message, f"{slot.name}: a node", key=True)

    def _port(self, node_type: NodeType, port: str, value: Data, here: ParseContext) -> Data:
        """Returns the value of a port with parameters filled in and keys prefixed."""
        info = node_type.ports.model_fields.get(port)
        metadata = {type(item) for item in info.metadata} if info else set()
        if Template in metadata and isinstance(value, str):
            for match in REFERENCE.finditer(value):
                self._is_key(match[1], here)
            return here.scope.fill_text(value)
        if WrittenKey in metadata and isinstance(value, str):
            if not KEY.fullmatch(value):
                self._add(here, f"{port}: {in_words(value)} cannot be a key", _KEY_RULE)
            return here.scope.key(value)
        return here.scope.fill(self._checked(value, here))

    def _checked(self, value: Data, here: ParseContext) -> Data:
        """Returns the value of a port, with malformed references reported and made unknown."""
        if isinstance(value, dict):
            return {part: self._checked(item, here.into(part)) for part, item in value.items()}
        if isinstance(value, list):
            return [self._checked(item, here.into(part)) for part, item in enumerate(value)]
        if not isinstance(value, str):
            return value
        key = reference_of(value)
        if key is not None:
            return value if self._is_key(key, here) else unknown(key)
        within = (match for match in REFERENCE.finditer(value) if KEY.match(match[1].strip()))
        for match in within:
            message = (
                f"{in_words(value)}: {match[0]} stands for a whole value, not for a part of it"
            )
            self._add(here, message, _WITHIN_TEXT)
            return unknown(match[1])
        return value

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
    if isinstance(body, dict):
        return dict(body)
    if isinstance(body, list):
        return {"children": body} if node_type.many else None
    return {node_type.shorthand: body} if node_type.shorthand else None


def _misspelt(node_type: NodeType, fields: Mapping[str, Data]) -> set[str]:
    """Returns missing fields that an unknown field most likely stands for: the check reports it."""
    known = node_type.fields_besides_ports | node_type.ports.model_fields.keys()
    meant = {nearest(name, known) for name in fields.keys() - known}
    return {name for name in node_type.fields_besides_ports - fields.keys() if name in meant}


def not_a_body(node_type: NodeType, body: Data) -> tuple[str, str]:
    """Returns message and hint for a body that no node of this type can have."""
    hint = ""
    if isinstance(body, str) and node_type.slots:
        hint = f"write {{{node_type.slots[0].name}: {body}}}"
    elif isinstance(body, list):
        hint = "put several nodes below 'sequence:'" if node_type.slots else ""
    wanted = "a list of nodes" if node_type.many else "a mapping of ports"
    return f"{node_type.name}: expected {wanted}, not {in_words(body)}", hint


def _not_a_node(data: Data) -> tuple[str, str]:
    if isinstance(data, dict) and data:
        keys = ", ".join(list(data)[:4])
        hint = f"indent the content of '{next(iter(data))}' further"
        return f"a node has one key, its kind; found {len(data)}: {keys}", hint
    hint = "a node is written 'kind: {port: value}'"
    if isinstance(data, list):
        hint = "for several nodes write 'sequence:' above the list"
    return f"expected a node, not {in_words(data)}", hint
