"""Checks of parsed trees: ports, outputs, outcomes, blackboard flow, unused declarations."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Set
from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field
from functools import lru_cache

from pydantic import ValidationError
from pydantic.fields import FieldInfo

from bt_dualarm.spec.cell import CATEGORIES, CellCheck, CellSpec
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.explain import explain
from bt_dualarm.spec.goals import SECTIONS, condition_problems
from bt_dualarm.spec.many import MOST_OF_A_KIND, ManySpec, members
from bt_dualarm.spec.node_types import (
    EITHER,
    KEY,
    REFERENCE,
    ChildOutcomes,
    LanguageNode,
    NodeSpec,
    NodeType,
    Outcomes,
    PortModel,
    in_words,
    is_unknown,
    key_name,
    kind_hint,
    metadata_of,
    miscounted,
    only,
    reference_of,
    references_in,
    templates_of,
    validate_literals,
    validated,
    written_keys,
)
from bt_dualarm.spec.parser import ParamSpec, SubtreeSpec, not_a_body
from bt_dualarm.spec.problems import Problem, nearest, suggestion
from bt_dualarm.spec.values import Refers
from bt_dualarm.spec.yaml_reader import Data, DataPath, Json, Source, with_tuples

# Nodes against the declarations of their node types: names, ports, outputs.


@dataclass(frozen=True)
class Declared:
    """Names that the tree file declares, by category, such as ``object``."""

    names: Mapping[str, frozenset[str]]

    def of(self, categories: tuple[str, ...]) -> frozenset[str]:
        """Returns all names of these categories."""
        return frozenset().union(*(self.names.get(each, frozenset()) for each in categories))


def declared_names(source: Source, given: Data) -> Declared:
    """Returns the names to which the ports of a file's nodes may refer.

    Args:
        source: Source of the file.
        given: Its section ``objects``, with its parameters filled in.
    """
    cell = source.get(("cell",))
    sections = {"object": _single(given), "arm": source.get(("arms",))}
    for category, section in CATEGORIES.items():
        sections[category] = cell.get(section) if isinstance(cell, dict) else None
    objects = sections["object"]
    for name, thing in objects.items() if isinstance(objects, dict) else ():
        parts = thing.get("parts") if isinstance(thing, dict) else None
        sections[_part_of(name)] = parts
    return Declared(
        {
            category: frozenset(items) if isinstance(items, dict) else frozenset()
            for category, items in sections.items()
        }
    )


def _single(objects: Data) -> Data:
    """Section ``objects`` with an entry for each object of an entry that stands for several."""
    if not isinstance(objects, dict):
        return None
    found: dict[str, Data] = {}
    for name, thing in objects.items():
        many = thing.get("many") if isinstance(thing, dict) else None
        if many is None:
            found[name] = thing
            continue
        try:
            count = ManySpec.model_validate(with_tuples(many)).count
        except ValidationError:  # reported elsewhere; names are not to be reported as well
            count = MOST_OF_A_KIND
        found |= dict.fromkeys(members(name, count), thing)
    return found


def _part_of(name: object) -> str:
    """Category of the names of an object's parts."""
    return f"part of {name}"


def check_tree(
    root: NodeSpec, node_types: Mapping[str, NodeType], declared: Declared, *, complete: bool = True
) -> Iterator[Problem]:
    """Returns every problem of the nodes of one tree.

    Args:
        root: Root of the tree.
        node_types: Node types by name, of the language and of the skills.
        declared: Names that ports may refer to.
        complete: Whether ``node_types`` has all skills; if not, unknown names are not reported.
    """
    # A subtree that is used often has many nodes with the same problems: each is checked once.
    checked: dict[tuple[int, DataPath], tuple[str, Mapping[str, Data], int]] = {}
    for node in root.walk():
        content = (node.kind, node.ports, len(node.children))
        if checked.get((id(node.source), node.path)) == content:
            continue
        checked[id(node.source), node.path] = content
        node_type = node_types.get(node.kind)
        if node_type is not None and node.whole:
            yield from check_node(node, node_type, declared)
        elif node_type is not None and not isinstance(node_type, LanguageNode):
            # The parser did not know the skill's shorthand; of the language it has reported this.
            body = node.source.get((*node.path, node.kind))
            yield node.port_problem((), *not_a_body(node_type, body))
        elif node_type is None and complete:
            message = f"there is no node or skill '{node.kind}'"
            yield node.problem(message, kind_hint(node.kind, node_types))


def check_node(node: NodeSpec, node_type: NodeType, declared: Declared) -> Iterator[Problem]:
    """Returns every problem of one node's ports and outputs."""
    outputs = {
        name: node.ports[name] for name in node_type.outputs.model_fields if name in node.ports
    }
    ports = {name: value for name, value in node.ports.items() if name not in outputs}
    known: set[DataPath] = set()
    try:
        validate_literals(node_type.ports, ports)
    except ValidationError as error:
        for found in explain(error, node_type.ports, ports, "port", node_type.fields_besides_ports):
            message = f"{node.kind}: {found.message}"
            at_key = found.at_key or not found.path
            key = reference_of(_at(ports, found.path))
            hint = _parameter_hint(node, key) if key else ""
            yield node.port_problem(found.path, message, hint or found.hint, key=at_key)
            known.add(found.path)
    for path, key in _inner_references({} if node_type.uses else ports):
        if path not in known:
            message = f"{node.kind}: '{{{key_name(key)}}}' is not a parameter"
            hint = _parameter_hint(node, key) or "a key can only stand for a whole port"
            yield node.port_problem(path, message, hint)
    for name, field in node_type.ports.model_fields.items():
        if name in ports:
            yield from _unknown_name(node, name, field, ports[name], declared)
    references = references_in(node_type.ports, ports)
    complaint = miscounted(node_type.ports, ports) if references else ""
    if complaint:  # without references the model's own validator reports it
        yield node.port_problem((), f"{node.kind}: {complaint}", key=True)
    for name in (
        name for name in node_type.fixed & references.keys() if not is_unknown(ports[name])
    ):
        message = f"{node.kind}: {name}: cannot come from the blackboard"
        yield node.port_problem((name,), message, "give a literal value, or use a parameter")
    if isinstance(node_type, LanguageNode):
        yield from node_type.problems(node)
    for name, value in outputs.items():
        if reference_of(value) is None:
            message = f"{node.kind}: output '{name}' needs a key to write, not {in_words(value)}"
            yield node.port_problem((name,), message, f'for example: {name}: "{{{name}}}"')


def _inner_references(data: Data, path: DataPath = ()) -> Iterator[tuple[DataPath, str]]:
    """Returns references within a port's value, which cannot be replaced in a running tree."""
    if isinstance(data, (dict, list)):
        for part, item in data.items() if isinstance(data, dict) else enumerate(data):
            yield from _inner_references(item, (*path, part))
    key = reference_of(data)
    if key is not None and len(path) > 1 and not is_unknown(data):
        yield path, key


def _at(data: Data, path: DataPath) -> Data:
    """Returns the data at a path; None if a part of it is missing."""
    for part in path:
        try:
            data = data[part]
        except (KeyError, IndexError, TypeError):
            return None
    return data


def _parameter_hint(node: NodeSpec, key: str) -> str:
    """Returns a hint to the parameter with the most similar name, empty if there is none."""
    close = nearest(key_name(key), node.parameters)
    return f"did you mean the parameter '{close}'?" if close else ""


def _unknown_name(
    node: NodeSpec, port: str, field: FieldInfo, value: Data, declared: Declared
) -> Iterator[Problem]:
    refers = refers_of(field)
    if refers is None:
        return
    if refers.to == ("part",):
        thing = node.ports.get("object")
        if thing is None or reference_of(thing) is not None:
            return  # known only when the node runs
        refers = Refers((_part_of(thing),))
    names = declared.of(refers.to)
    several = isinstance(value, list)
    for index, name in enumerate(value if several else [value]):
        if isinstance(name, str) and reference_of(name) is None and name not in names:
            what = " or ".join(refers.to)
            hint = suggestion(name, names, what)
            path = (port, index) if several else (port,)
            yield node.port_problem(path, f"{node.kind}: there is no {what} '{name}'", hint)


def refers_of(field: FieldInfo) -> Refers | None:
    """Returns the reference metadata of a port that holds a name, else None."""
    return metadata_of(field, Refers)


# Data flow of the blackboard: keys that cannot have been written yet, values of the wrong type,
# keys that are never read. A may-analysis: a key counts as written where any run of the tree could
# have written it, so that no correct tree is refused.


_OWN_KEYS = (
    "nothing writes a key in this scope; each arm and each use of a subtree has its own keys"
)


@dataclass(frozen=True, eq=False)
class KeyWrite:
    """A write of a key.

    Attributes:
        node: Node that writes it.
        port: Port or output that names the key.
        key: Key on the arm's blackboard, with the prefix of its subtree.
        literal: Value in YAML notation as a tuple of one, empty if it is not known.
        model: Model with the output of that name, None if a port has the value.
    """

    node: NodeSpec
    port: str
    key: str
    literal: tuple[Data, ...] = ()
    model: type[PortModel] | None = None


@dataclass(frozen=True, eq=False)
class KeyRead:
    """A read of a key; ``model`` has the port, None for a key within a text."""

    node: NodeSpec
    port: str
    key: str
    model: type[PortModel] | None = None


@dataclass
class Flow:
    """Data flow of one arm's blackboard.

    Args:
        node_types: Node types by name, including those of all nodes of the tree.

    Attributes:
        problems: Problems found by `follow`.
    """

    node_types: Mapping[str, NodeType]
    problems: list[Problem] = dataclass_field(default_factory=list)
    _before: dict[str, list[KeyWrite]] = dataclass_field(default_factory=dict)
    _recorded: set[KeyWrite] = dataclass_field(default_factory=set)
    _hidden: set[KeyWrite] = dataclass_field(default_factory=set)
    _writes: dict[NodeSpec, list[KeyWrite]] = dataclass_field(default_factory=dict)

    def follow(self, root: NodeSpec) -> None:
        """Check the whole tree."""
        self._writes = {node: list(self._writes_of(node)) for node in root.walk()}
        everywhere = {write.key for writes in self._writes.values() for write in writes}
        self._visit(root, everywhere)
        read = {read.key for node in root.walk() for read in self._reads(node)}
        self.problems += [
            _unused(write)
            for writes in self._writes.values()
            for write in writes
            if write.key not in read
        ]

    def _visit(self, node: NodeSpec, everywhere: set[str]) -> list[KeyWrite]:
        """Check the reads of a node and its descendants; returns their new writes."""
        new: list[KeyWrite] = []
        node_type = self.node_types[node.kind]
        if isinstance(node_type, LanguageNode) and node_type.revisits(node):
            new += self._record(write for below in node.walk() for write in self._writes[below])
        for read in self._reads(node):
            writes = [w for w in self._before.get(read.key, ()) if w not in self._hidden]
            self._check(read, writes, everywhere)
        new += self._record(self._writes[node])
        branches: list[KeyWrite] = []
        for slot, child in zip(node.slots, node.children, strict=True):
            is_branch = node_type.is_alternative(slot)
            hidden = set(branches) if is_branch else set()
            self._hidden |= hidden
            written = self._visit(child, everywhere)
            self._hidden -= hidden
            new += written
            branches += written if is_branch else []
        return new

    def _record(self, writes: Iterable[KeyWrite]) -> list[KeyWrite]:
        """Count writes as done from here on; returns those that did not count before."""
        new = [write for write in writes if write not in self._recorded]
        self._recorded.update(new)
        for write in new:
            self._before.setdefault(write.key, []).append(write)
        return new

    def _check(self, read: KeyRead, writes: list[KeyWrite], everywhere: set[str]) -> None:
        if not writes:
            self.problems.append(_never_written(read, everywhere))
        for write in writes:
            complaint = _misfit(read.model, read.port, write) if read.model else ""
            if complaint:
                hint = f"'{{{key_name(read.key)}}}' is written at {write.node.location}"
                message = f"{read.node.kind}: {complaint}"
                self.problems.append(read.node.port_problem((read.port,), message, hint))

    def _writes_of(self, node: NodeSpec) -> Iterator[KeyWrite]:
        node_type = self.node_types[node.kind]
        for port, written in written_keys(node_type.ports).items():
            key = node.ports.get(port)
            value = node.ports.get(written)
            if isinstance(key, str) and KEY.fullmatch(key_name(key)):
                yield KeyWrite(node, port, key, () if reference_of(value) else (value,))
        for name in node_type.outputs.model_fields:
            output = reference_of(node.ports.get(name))
            if output is not None:
                yield KeyWrite(node, name, output, model=node_type.outputs)

    def _reads(self, node: NodeSpec) -> Iterator[KeyRead]:
        node_type = self.node_types[node.kind]
        if node_type.uses:  # parameters of a subtree are read where its nodes read them
            return
        for port, key in references_in(node_type.ports, node.ports).items():
            if KEY.fullmatch(key_name(key)):  # else the parser has refused it
                yield KeyRead(node, port, key, node_type.ports)
        for port in templates_of(node_type.ports):
            for match in REFERENCE.finditer(str(node.ports.get(port, ""))):
                if KEY.fullmatch(key_name(match[1])):
                    yield KeyRead(node, port, match[1])


def _never_written(read: KeyRead, everywhere: set[str]) -> Problem:
    name = key_name(read.key)
    if read.key in everywhere:
        hint = "it is written only further down"
    else:
        scope = read.key.removesuffix(name)
        written = {key_name(key) for key in everywhere if key == scope + key_name(key)}
        parameter = nearest(name, written | read.node.parameters)
        if parameter in read.node.parameters:
            hint = f"did you mean the parameter '{parameter}'?"
        else:
            hint = suggestion(name, written, "key") if written else _OWN_KEYS
    if read.node.user:
        hint += f"; the subtree is used at {read.node.user}"
    message = f"{read.node.kind}: no node before this one writes '{{{name}}}'"
    return read.node.port_problem((read.port,), message, hint)


def _misfit(model: type[PortModel], port: str, write: KeyWrite) -> str:
    """Returns why a written value does not fit the port that reads it, empty if it may fit."""
    wanted = only(model, port)
    for value in write.literal:
        try:
            validated(wanted, {port: value})
        except ValidationError as error:
            return next(explain(error, wanted, {port: value}, "port")).message
    if write.model is None:
        return ""
    given = json_types(write.model, write.port)
    accepted = json_types(model, port)
    if given and accepted and not given & accepted:
        return f"{port}: expected {_type_names(accepted)}, not {_type_names(given)}"
    return ""


@lru_cache(maxsize=512)
def json_types(model: type[PortModel], name: str) -> frozenset[str]:
    """Returns the JSON types that a field accepts; empty if it accepts any."""
    schema = only(model, name).model_json_schema()
    return frozenset(_types_in(schema["properties"][name], schema.get("$defs", {})))


def _types_in(schema: Json, definitions: Json) -> set[str]:
    if "$ref" in schema:
        return _types_in(definitions[schema["$ref"].rpartition("/")[2]], definitions)
    members = [_types_in(item, definitions) for item in schema.get("anyOf", ())]
    if members:
        return set().union(*members) if all(members) else set()
    if "enum" in schema or "const" in schema:
        values = schema.get("enum", [schema.get("const")])
        return {"string" if isinstance(value, str) else "number" for value in values}
    name = schema.get("type")
    return {"number" if name == "integer" else str(name)} if name else set()


def _type_names(types: Set[str]) -> str:
    names = {"string": "text", "array": "a list", "object": "a mapping", "number": "a number"}
    return " or ".join(sorted(names.get(each, each) for each in types))


def _unused(write: KeyWrite) -> Problem:
    message = f"{write.node.kind}: nothing reads '{{{key_name(write.key)}}}'"
    return replace(write.node.port_problem((write.port,), message), severity="warning")


# Warnings that follow from the outcomes of nodes: branches that no tick can reach, leaves after a
# node that never ends, nodes without effect.


def outcomes_in(root: NodeSpec, node_types: Mapping[str, NodeType]) -> dict[NodeSpec, Outcomes]:
    """Returns the outcomes of each node of a tree, as far as the file determines them."""
    known: dict[NodeSpec, Outcomes] = {}
    for node in reversed(tuple(root.walk())):  # children come after their parent
        node_type = node_types.get(node.kind)
        reads = any(reference_of(value) for value in node.ports.values())
        if not isinstance(node_type, LanguageNode):
            known[node] = EITHER
        elif not node.children and (reads or not node_type.is_leaf or node_type.uses):
            # A leaf that depends on the blackboard; a parent whose children were not parsed.
            known[node] = EITHER
        else:
            known[node] = node_type.outcomes(node, [known[child] for child in node.children])
    return known


def outcome_warnings(root: NodeSpec, node_types: Mapping[str, NodeType]) -> Iterator[Problem]:
    """Returns warnings of everything in a tree that is allowed but can hardly be intended."""
    outcomes = outcomes_in(root, node_types)
    for node in root.walk():
        node_type = node_types.get(node.kind)
        if not isinstance(node_type, LanguageNode):
            continue
        children = [outcomes[child] for child in node.children]
        found = [
            *_never_followed(node_type, node, children),
            *_never_chosen(node_type, node, children),
        ]
        no_effect = node_type.no_effect(node, children)
        for message, where in [*found, (no_effect, node)] if no_effect else found:
            yield replace(where.problem(message), severity="warning")


def _never_followed(
    node_type: LanguageNode, node: NodeSpec, children: ChildOutcomes
) -> Iterator[tuple[str, NodeSpec]]:
    """Returns the first child that no tick reaches because of one before it."""
    succeeds = node_type.advances_on
    if succeeds is None:
        return
    for child, before, end in zip(node.children[1:], node.children, children, strict=False):
        if not (end.succeeds if succeeds else end.fails):
            how = "always fails" if succeeds else "cannot fail"
            how = "never ends" if end.never else how
            yield f"unreachable: '{before.name}' before it {how}", child
            return


def _never_chosen(
    node_type: LanguageNode, node: NodeSpec, children: ChildOutcomes
) -> Iterator[tuple[str, NodeSpec]]:
    """Returns children that are ticked after a result that the first child cannot have."""
    after = {slot.name: slot.after for slot in node_type.slots if slot.after is not None}
    for slot, child in zip(node.slots, node.children, strict=True):
        if slot in after and not (children[0].succeeds if after[slot] else children[0].fails):
            how = "never holds" if after[slot] else "always holds"
            yield f"unreachable: '{node.children[0].name}' {how}", child


# Warnings of objects and arms that a tree names but that are never spawned.


def absent(file: TreeFile, source: Source, node_types: Mapping[str, NodeType]) -> Iterator[Problem]:
    """Returns warnings of objects that are used and arms that are declared, but never spawned.

    Args:
        file: The file; all its trees count, as an arm may spawn what another one uses.
        source: Source of the file.
        node_types: Node types by name, of the language and of the skills.
    """
    nodes = [node for arm in file.arms.values() for node in arm.tree.walk()]
    named = [
        node.ports.get(port)
        for node in nodes
        if node.kind in node_types
        for port in node_types[node.kind].brings_in
    ]
    if any(reference_of(value) for value in named):
        return  # what is spawned is known only in the run
    spawned = {value for value in named if isinstance(value, str)}
    objects = {name for name, item in file.objects.items() if not item.spawned} - spawned
    arms = {name for name, item in file.arms.items() if not item.spawned} - spawned
    for arm in sorted(arms):
        message = f"arm '{arm}' has spawned: false and no leaf spawns it: its tree never starts"
        yield replace(source.problem(("arms", arm), message, key=True), severity="warning")
    waiting = Declared({"object": frozenset(objects), "arm": frozenset(arms)})
    for node in nodes:
        fields = node_types[node.kind].ports.model_fields if node.kind in node_types else {}
        for port, field in fields.items():
            refers = refers_of(field)
            value = node.ports.get(port)
            if refers and isinstance(value, str) and value in waiting.of(refers.to):
                message = f"{node.kind}: '{value}' has spawned: false and no leaf spawns it"
                yield replace(node.port_problem((port,), message), severity="warning")


# Warnings of parameters and subtrees that a file declares but does not use.


def unused(
    source: Source,
    params: Mapping[str, ParamSpec],
    subtrees: Iterable[SubtreeSpec],
    used: Set[SubtreeSpec],
) -> Iterator[Problem]:
    """Returns warnings of parameters that no value refers to and subtrees that no tree uses.

    Args:
        source: A file without errors.
        params: Parameters that it declares.
        subtrees: Subtrees that it declares; a file without arms declares them for other files.
        used: Subtrees that are used by the arms' trees, and by each other. One that a parameter
            can choose by its name, ``use: "{grasp}"``, counts as used, too.
    """
    choices = {choice for param in params.values() for choice in param.choices or ()}
    outside = {part: item for part, item in source.data.items() if part not in _OF_SUBTREES}
    yield from _params(source, ("params",), params, outside)
    for subtree in subtrees:
        *path, tree = subtree.path
        yield from _params(source, (*path, "params"), subtree.params, source.get((*path, tree)))
        if "arms" in source.data and subtree not in used and subtree.name not in choices:
            message = f"nothing uses the subtree '{subtree.name}'"
            yield _warning(source, tuple(path), message)


_OF_SUBTREES = frozenset({"params", "subtrees", "include"})


def _params(
    source: Source, path: DataPath, params: Mapping[str, ParamSpec], data: Data
) -> Iterator[Problem]:
    texts = set(_texts(data))
    named = {match[1] for text in texts for match in REFERENCE.finditer(text)}
    for name, param in params.items():
        # A parameter of type key may also be written without braces: {key: out}.
        if name not in named and not (param.type == "key" and name in texts):
            yield _warning(source, (*path, name), f"nothing uses the parameter '{name}'")


def _texts(data: Data) -> Iterator[str]:
    if isinstance(data, str):
        yield data
    elif isinstance(data, (dict, list)):
        for item in data.values() if isinstance(data, dict) else data:
            yield from _texts(item)


def _warning(source: Source, path: DataPath, message: str) -> Problem:
    return replace(source.problem(path, message, key=True), severity="warning")


# All checks of the trees of one file.


@dataclass
class Examination:
    """Checks the trees of one file.

    Args:
        language: Node types of the language by name.
        skills: Node types of the skills by name; None to check no leaves that are skills.
        names: Names that the file declares.

    Attributes:
        problems: Problems found so far.
    """

    language: Mapping[str, LanguageNode]
    skills: Mapping[str, NodeType] | None
    names: Declared
    problems: list[Problem] = dataclass_field(default_factory=list)
    _node_types: Mapping[str, NodeType] = dataclass_field(init=False)

    def __post_init__(self) -> None:
        self._node_types = {**self.language, **(self.skills or {})}

    def nodes(self, root: NodeSpec) -> None:
        """Check each node by itself."""
        complete = self.skills is not None
        self.problems += check_tree(root, self._node_types, self.names, complete=complete)

    def tree(self, root: NodeSpec) -> None:
        """Check each node, and the blackboard where every node's outputs are known."""
        self.nodes(root)
        if all(node.kind in self._node_types for node in root.walk()):
            flow = Flow(self._node_types)
            flow.follow(root)
            self.problems += flow.problems

    def cell(self, cell: CellSpec, source: Source, trees: Mapping[str, NodeSpec]) -> None:
        """Check what the trees share.

        Args:
            cell: Cell of the file.
            source: Source of the file.
            trees: Tree of each arm, by the arm's name.
        """
        check = CellCheck(source, cell, self.names.of(("object",)), trees, self._node_types)
        self.problems += check.problems()

    def conditions(self, file: TreeFile, source: Source) -> None:
        """Check the names in goals and invariants."""
        sections = {name: getattr(file, name) for name in SECTIONS}
        objects, arms = self.names.of(("object",)), self.names.of(("arm",))
        self.problems += condition_problems(sections, source, file.cell, objects, arms)

    def warnings(self, file: TreeFile, source: Source) -> Iterator[Problem]:
        """Returns warnings of everything in a correct file that can hardly be intended."""
        trees = {name: arm.tree for name, arm in file.arms.items()}
        objects = self.names.of(("object",))
        zones = frozenset(
            ("zone", condition.in_zone)
            for section in SECTIONS
            for condition in getattr(file, section).values()
            if condition.in_zone is not None
        )
        check = CellCheck(source, file.cell, objects, trees, self._node_types, zones)
        yield from check.warnings()
        for arm in file.arms.values():
            yield from outcome_warnings(arm.tree, self._node_types)
        yield from absent(file, source, self._node_types)
