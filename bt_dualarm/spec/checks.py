"""Checks of parsed trees: ports, outputs, outcomes, blackboard flow, unused declarations."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field
from functools import cache, lru_cache
from types import MappingProxyType
from typing import Final, Literal

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from bt_dualarm.spec.cell import CATEGORIES, CellCheck, CellSpec
from bt_dualarm.spec.dimensions import ANYTHING, Dimension, ValueType, dimension_of, misfit
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.explain import explain, field_at, in_base_units, valid_in_units
from bt_dualarm.spec.expressions import (
    ExpressionError,
    as_number,
    keys_in,
    parse,
    resolved,
    type_of,
)
from bt_dualarm.spec.faults import RemovedObject
from bt_dualarm.spec.goals import SECTIONS, condition_problems
from bt_dualarm.spec.joints import moved_name
from bt_dualarm.spec.many import MOST_OF_A_KIND, ManySpec, members
from bt_dualarm.spec.node_types import (
    CONDITION_FIELDS,
    EITHER,
    FAILURE,
    KEY,
    REFERENCE,
    ChildOutcomes,
    LanguageNode,
    NodeSpec,
    NodeType,
    Outcomes,
    PortModel,
    WrittenKey,
    all_of,
    dynamic_ports,
    in_words,
    is_dynamic,
    is_unknown,
    item_models,
    key_name,
    kind_hint,
    metadata_of,
    miscounted,
    only,
    reference_of,
    templates_of,
    unit_of,
    validate_literals,
    validated,
    written_keys,
)
from bt_dualarm.spec.parser import ParamSpec, SubtreeSpec, not_a_body
from bt_dualarm.spec.problems import Location, Problem, meant_by, nearest, suggestion
from bt_dualarm.spec.relative_pose import PoseOf
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
    sections["subtree"] = source.get(("subtrees",))
    objects = sections["object"]
    moved: dict[str, Data] = {}
    placed: dict[str, Data] = {}
    for name, obj in objects.items() if isinstance(objects, dict) else ():
        parts = obj.get("parts") if isinstance(obj, dict) else None
        joints = obj.get("joints") if isinstance(obj, dict) else None
        sections[_part_of(name)] = parts
        sections[_joint_of(name)] = joints
        for joint, body in joints.items() if isinstance(joints, dict) else ():
            moves = body.get("parts") if isinstance(body, dict) else None
            moved[moved_name(str(name), str(joint))] = body
            names = moves if isinstance(moves, list) else ()
            its = dict.fromkeys(part for part in names if isinstance(part, str))
            sections[_part_of(moved_name(str(name), str(joint)))] = its
        for part, body in parts.items() if isinstance(parts, dict) else ():
            placed[f"{name}.{part}"] = body
    sections["object"] = {**(objects if isinstance(objects, dict) else {}), **moved}
    sections["object part"] = placed
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
    for name, obj in objects.items():
        many = obj.get("many") if isinstance(obj, dict) else None
        if many is None:
            found[name] = obj
            continue
        try:
            count = ManySpec.model_validate(with_tuples(many)).count
        except ValidationError:  # reported elsewhere; do not report the names as well
            count = MOST_OF_A_KIND
        found |= dict.fromkeys(members(name, count), obj)
    return found


def _part_of(name: object) -> str:
    """Category of the names of an object's parts."""
    return f"part of {name}"


def _joint_of(name: object) -> str:
    """Category of the names of an object's joints."""
    return f"joint of {name}"


_OF_AN_OBJECT: Final = {"part": _part_of, "joint": _joint_of}
"""Categories of what the object has that the port ``object`` of the same node names."""


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
            yield from check_node(node, node_type, declared, node_types)
        elif node_type is not None and not isinstance(node_type, LanguageNode):
            # The parser does not know a skill's shorthand; for language nodes it has already
            # reported this.
            body = node.source.get((*node.path, node.kind))
            yield node.port_problem((), *not_a_body(node_type, body))
        elif node_type is None and complete:
            message = f"there is no node or skill '{node.kind}'"
            hint = kind_hint(node.kind, node_types)
            if node.kind in declared.of(("subtree",)):
                hint = f"it is a subtree: subtree: {{use: {node.kind}}}"
            yield node.problem(message, hint)


def with_bare_numbers(node: NodeSpec, node_types: Mapping[str, NodeType]) -> NodeSpec:
    """Returns a tree in which numbers stand for texts with a unit, as in `in_base_units`."""
    children = tuple(with_bare_numbers(child, node_types) for child in node.children)
    node_type = node_types.get(node.kind)
    ports = node.ports
    if node_type is not None:
        model = node_type.ports
        known = {name: value for name, value in ports.items() if name in model.model_fields}
        numbers = in_base_units(known, lambda data: validate_literals(model, data), model)
        ports = {**ports, **numbers}
    same = all(new is old for new, old in zip(children, node.children, strict=True))
    if same and ports == node.ports:
        return node
    return replace(node, ports=ports, children=children)


def check_node(
    node: NodeSpec,
    node_type: NodeType,
    declared: Declared,
    node_types: Mapping[str, NodeType] = MappingProxyType({}),
) -> Iterator[Problem]:
    """Returns every problem of one node's ports and outputs."""
    outputs = {
        name: node.ports[name] for name in node_type.outputs.model_fields if name in node.ports
    }
    ports = {name: value for name, value in node.ports.items() if name not in outputs}
    mistaken: list[DataPath] = []
    try:
        validate_literals(node_type.ports, ports)
    except ValidationError as error:
        # Likely misspellings of these get a hint here; they are listed nowhere else.
        meant = {nearest(name, CONDITION_FIELDS) for name in ports} - {None}
        also = node_type.fields_besides_ports | {str(name) for name in meant}
        for found in explain(error, node_type.ports, ports, "port", also):
            message = f"{node.kind}: {found.message}"
            at_key = found.at_key or not found.path
            key = reference_of(_at(ports, found.path))
            hint = _parameter_hint(node, key) if key else ""
            hint = hint or _misplaced_hint(node, node_type, found.path, node_types)
            yield node.port_problem(found.path, message, hint or found.hint, key=at_key)
            if not at_key:
                mistaken.append(found.path)
    for path, refers, name in _names_in(node_type.ports, ports):
        if any(path[: len(wrong)] == wrong for wrong in mistaken):
            continue  # a list of names, for example, where one is expected
        of_an_object = _OF_AN_OBJECT.get(refers.to[0])
        if of_an_object is not None:
            obj = node.ports.get("object")
            if not isinstance(obj, str) or obj not in declared.of(("object",)):
                continue  # known only when the node runs, or reported already
            refers = Refers((of_an_object(obj),))
        names = declared.of(refers.to)
        if name in refers.words and name in names:
            message = f"{node.kind}: '{name}' is a word of the language and a name of the file"
            yield node.port_problem(path, message, "rename what the file declares")
        elif name not in names | set(refers.words):
            kinds = [kind for kind in refers.to if kind != "object part"]
            what = "frame" if refers.words else " or ".join(kinds)
            hint = suggestion(name, names | set(refers.words), what)
            yield node.port_problem(path, f"{node.kind}: there is no {what} '{name}'", hint)
        elif refers.unlike and name == node.ports.get(refers.unlike):
            message = f"{node.kind}: {path[0]}: '{name}' cannot go into itself"
            yield node.port_problem(path, message)
        elif path[-1] == "on" and name.partition(".")[0] == node.ports.get("object"):
            of = metadata_of(node_type.ports.model_fields[str(path[0])], PoseOf)
            if of is not None and of.what in ("held", "object"):
                message = f"{node.kind}: {path[0]}: '{node.ports['object']}' cannot be on itself"
                yield node.port_problem(path, message)
    for name in node_type.ports.model_fields:
        if name in ports:
            yield from _wrong_units(node, node_type, name)
    references = dynamic_ports(node_type.ports, ports)
    complaint = miscounted(node_type.ports, ports) if references else ""
    if complaint:  # without references the model's own validator reports it
        yield node.port_problem((), f"{node.kind}: {complaint}", key=True)
    for name in (name for name in node_type.fixed & references if not is_unknown(ports[name])):
        message = f"{node.kind}: {name}: cannot come from the blackboard"
        yield node.port_problem((name,), message, "give a literal value, or use a parameter")
    if isinstance(node_type, LanguageNode):
        yield from node_type.problems(node)
    for name, value in outputs.items():
        if reference_of(value) is None:
            message = f"{node.kind}: output '{name}' needs a key to write, not {in_words(value)}"
            yield node.port_problem((name,), message, f'for example: {name}: "{{{name}}}"')


def _dynamic_texts(data: Data, path: DataPath = ()) -> Iterator[tuple[DataPath, str]]:
    """Yields the references and expressions in a value, with their paths in it."""
    if isinstance(data, (dict, list)):
        for part, item in data.items() if isinstance(data, dict) else enumerate(data):
            yield from _dynamic_texts(item, (*path, part))
    elif isinstance(data, str) and is_dynamic(data):
        yield path, data


def _written(node: NodeSpec, node_type: NodeType, port: str) -> tuple[DataPath, Data]:
    """Returns the path below the node's kind of a port's value, and the value as in the file."""
    body = node.source.get((*node.path, node.kind))
    if isinstance(body, dict):
        return (port,), body.get(port)
    return (), body if node_type.shorthand == port else None


def _wrong_units(node: NodeSpec, node_type: NodeType, port: str) -> Iterator[Problem]:
    """Returns the errors of units that are known from the declarations of parameters."""
    above, value = _written(node, node_type, port)
    for path, text in _dynamic_texts(value):
        try:
            found = type_of(parse(text), node.types)
        except ExpressionError:
            continue  # the parser has reported it
        complaint = misfit(found, _dimension_at(node_type.ports, (port, *path)))
        if complaint:
            message = f"{node.kind}: {_owner(port, path)}: {complaint}"
            yield node.port_problem((*above, *path), message)


def _misfit_of_type(found: ValueType, model: type[PortModel], port: str, path: DataPath) -> str:
    """Returns why no value of a type fits a port, or a part of it; empty if one may."""
    accepted = frozenset() if path else json_types(model, port)
    if found.kind and accepted and found.kind not in accepted:
        return f"expected {_type_names(accepted)}, not {_type_names({found.kind})}"
    return misfit(found, _dimension_at(model, (port, *path)))


def _dimension_at(model: type[PortModel], path: DataPath) -> Dimension | None:
    field = field_at(model, path)
    return None if field is None else dimension_of(unit_of(field))


def _owner(port: str, path: DataPath) -> str:
    return next((part for part in reversed(path) if isinstance(part, str)), port)


def _at(data: Data, path: DataPath) -> Data:
    """Returns the data at a path; None if a part of it is missing."""
    for part in path:
        try:
            data = data[part]
        except (KeyError, IndexError, TypeError):
            return None
    return data


def _misplaced_hint(
    node: NodeSpec, node_type: NodeType, path: DataPath, node_types: Mapping[str, NodeType]
) -> str:
    """Hint for an unknown port that is a child node, or a reference without quotes."""
    name = str(path[0]) if len(path) == 1 else ""
    known = node_type.fields_besides_ports | node_type.ports.model_fields.keys()
    if not name or name in known or meant_by(name, known):
        return ""
    if name in node_types and node_type.many:
        return f"begin each child with a dash: '- {name}: …'"
    if name in node_types and node_type.slots:
        given = set(node.slots)
        slot = next((one.name for one in node_type.slots if one.name not in given), "child")
        return f"write it within '{slot}': {{{slot}: {{{name}: …}}}}"
    if "params" in node_type.ports.model_fields and not nearest(name, known):
        return f"a parameter of the subtree belongs within 'params': {{params: {{{name}: …}}}}"
    if node.ports[name] is None and len(node.ports) == 1:
        return f'if the key or parameter is meant, quote it: "{{{name}}}"'
    return ""


def _parameter_hint(node: NodeSpec, key: str) -> str:
    """Returns a hint to the parameter with the most similar name, empty if there is none."""
    close = nearest(key_name(key), node.parameters)
    return f"did you mean the parameter '{close}'?" if close else ""


def _names_in(
    model: type[BaseModel], values: Mapping[str, Data], path: DataPath = ()
) -> Iterator[tuple[DataPath, Refers, str]]:
    """Yields the literal names in a model's fields, and in the fields of their values."""
    for field_name, field in model.model_fields.items():
        refers = refers_of(field)
        value = values.get(field_name)
        several = isinstance(value, list)
        items: list[Data] = value if isinstance(value, list) else [value]
        for index, one in enumerate(items):
            at = (*path, field_name, index) if several else (*path, field_name)
            if refers is not None and isinstance(one, str) and not is_dynamic(one):
                yield at, refers, one
            elif isinstance(one, dict):
                for nested in item_models(field.annotation):
                    yield from _names_in(nested, one, at)


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
        literal: All values that may be written, in YAML notation; empty if they are not known.
        model: Model with the output of that name, None if a port has the value.
    """

    node: NodeSpec
    port: str
    key: str
    literal: tuple[Data, ...] = ()
    model: type[PortModel] | None = None


def _literal_values(written: WrittenKey, value: Data) -> tuple[Data, ...]:
    """Returns all values that a node may write to a key, empty if they are not known."""
    if written.what == "value":
        return () if is_dynamic(value) else (value,)
    items = value if isinstance(value, list) else []
    if written.what == "indices":
        return tuple(range(len(items)))
    return () if is_dynamic(items) else tuple(items)


@dataclass(frozen=True, eq=False)
class KeyRead:
    """A read of a key.

    Attributes:
        node: Node that reads it.
        port: Port that refers to it.
        key: Key on the arm's blackboard, with the prefix of its subtree.
        model: Model with the port if its whole value is that of the key, else None.
        path: Path of the reference below the node's kind in the file.
    """

    node: NodeSpec
    port: str
    key: str
    model: type[PortModel] | None = None
    path: DataPath = ()

    @property
    def location(self) -> Location:
        """Location of the reference."""
        path = (*self.node.path, self.node.kind, *self.path)
        text = self.node.source.get(path)
        reference = f"{{{key_name(self.key)}}}"
        if self.model is not None or not isinstance(text, str) or reference not in text:
            return self.node.source.location(path)
        start = text.index(reference)
        return self.node.source.part_location(path, start, start + len(reference))


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
        overwritten = self._overwritten(node, node_type)
        if isinstance(node_type, LanguageNode) and node_type.revisits(node):
            new += self._record(write for below in node.walk() for write in self._writes[below])
        for read in self._reads(node):
            writes = [w for w in self._before.get(read.key, ()) if w not in self._hidden]
            self._check(read, writes, everywhere)
        self._check_expressions(node, node_type)
        new += self._record(self._writes[node])
        branches: list[KeyWrite] = []
        self._hidden |= overwritten
        for slot, child in zip(node.slots, node.children, strict=True):
            is_branch = node_type.is_alternative(slot)
            hidden = set(branches) if is_branch else set()
            self._hidden |= hidden
            written = self._visit(child, everywhere)
            self._hidden -= hidden
            new += written
            branches += written if is_branch else []
        self._hidden -= overwritten
        return new

    def _overwritten(self, node: NodeSpec, node_type: NodeType) -> set[KeyWrite]:
        """Returns earlier writes of keys that a loop writes before each start of its child."""
        keys = [
            node.ports.get(port)
            for port, written in written_keys(node_type.ports).items()
            if written.what != "value"
        ]
        earlier = {write for key in keys for write in self._before.get(str(key), ())}
        # A loop around this one has recorded its own writes already.
        return earlier - self._hidden - set(self._writes[node])

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

    def _check_expressions(self, node: NodeSpec, node_type: NodeType) -> None:
        """Check units, and values where those of all keys are known."""
        if node_type.uses:
            return
        for port in dynamic_ports(node_type.ports, node.ports):
            value = node.ports[port]
            if reference_of(value) is not None:
                continue
            writes = {
                key: [w for w in self._before.get(key, ()) if w not in self._hidden]
                for key in keys_in(value)
            }
            if not all(writes.values()):
                continue  # reported as never written
            above, written = _written(node, node_type, port)
            originals = dict(_dynamic_texts(written))
            types = {key: _common_type(each) for key, each in writes.items()}
            wrong = False
            for path, text in _dynamic_texts(value):
                where = node.source.location((*node.path, node.kind, *above, *path))
                try:
                    found = type_of(parse(text), types)
                    complaint = _misfit_of_type(found, node_type.ports, port, path)
                    hint = ""
                except ExpressionError as error:
                    complaint = str(error)
                    hint = error.hint
                    if originals.get(path) == text:
                        at = (*node.path, node.kind, *above, *path)
                        where = node.source.part_location(at, error.start, error.end)
                if complaint:
                    wrong = True
                    message = f"{node.kind}: {_owner(port, path)}: {complaint}"
                    self.problems.append(Problem(where, message, hint))
            if not wrong:
                self._check_values(node, node_type.ports, port, above, writes)

    def _check_values(
        self,
        node: NodeSpec,
        model: type[PortModel],
        port: str,
        above: DataPath,
        writes: Mapping[str, Sequence[KeyWrite]],
    ) -> None:
        """Check the value of a port for all that is written to its keys, if all of it is known.

        It is an error only if no combination of these values is allowed: which of them occur
        together is not known.
        """
        known = [[value for write in each for value in write.literal] for each in writes.values()]
        if math.prod(map(len, known)) > _MOST_COMBINATIONS or any(
            not write.literal for each in writes.values() for write in each
        ):
            return
        wanted = only(model, port)
        literal = {port: node.ports[port]}
        reported = set[str]()  # what is wrong whatever the keys are
        try:
            validate_literals(wanted, literal)
        except ValidationError as error:
            reported = {one.message for one in explain(error, wanted, literal, "port")}
        complaint = ""
        for values in itertools.product(*known):
            given = dict(zip(writes, values, strict=True))
            try:
                value = resolved(node.ports[port], given.__getitem__)
                valid_in_units(wanted, {port: value})
                return
            except ExpressionError as error:
                found = f"{_owner(port, ())}: {error}"
            except ValidationError as error:
                found = next(explain(error, wanted, {port: value}, "port")).message
                if found in reported:
                    return
            if not complaint:
                shown = (f"'{{{key_name(key)}}}' is {in_words(one)}" for key, one in given.items())
                complaint = f"{found}, where {' and '.join(shown)}"
        self.problems.append(node.port_problem(above, f"{node.kind}: {complaint}"))

    def _writes_of(self, node: NodeSpec) -> Iterator[KeyWrite]:
        node_type = self.node_types[node.kind]
        for port, written in written_keys(node_type.ports).items():
            key = node.ports.get(port)
            value = node.ports.get(written.port)
            if isinstance(key, str) and KEY.fullmatch(key_name(key)):
                yield KeyWrite(node, port, key, _literal_values(written, value))
        for name in node_type.outputs.model_fields:
            output = reference_of(node.ports.get(name))
            if output is not None:
                yield KeyWrite(node, name, output, model=node_type.outputs)

    def _reads(self, node: NodeSpec) -> Iterator[KeyRead]:
        node_type = self.node_types[node.kind]
        if node_type.uses:  # parameters of a subtree are read where its nodes read them
            return
        for port in sorted(dynamic_ports(node_type.ports, node.ports)):
            above, _ = _written(node, node_type, port)
            for path, text in _dynamic_texts(node.ports[port]):
                whole = not path and reference_of(text) is not None
                model = node_type.ports if whole else None
                for key in keys_in(text):
                    if KEY.fullmatch(key_name(key)):  # otherwise the parser has refused it
                        yield KeyRead(node, port, key, model, (*above, *path))
        for port in templates_of(node_type.ports):
            for match in REFERENCE.finditer(str(node.ports.get(port, ""))):
                if KEY.fullmatch(key_name(match[1])):
                    yield KeyRead(node, port, match[1], path=_written(node, node_type, port)[0])


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
        parameters = read.node.source.get(("params",))
        if isinstance(parameters, dict) and name in parameters:
            hint = "it is a parameter of the file: declare it in the subtree as well, and use that "
            hint += f'with params: {{{name}: "{{{name}}}"}}'
        hint += f"; the subtree is used at {read.node.user}"
    message = f"{read.node.kind}: no node before this one writes '{{{name}}}'"
    return Problem(read.location, message, hint)


_MOST_COMBINATIONS = 64
"""Combinations of written values for which an expression is evaluated in the check."""


def _common_type(writes: Iterable[KeyWrite]) -> ValueType:
    """Returns what all values of a key have in common."""
    found = {_type_of_write(write) for write in writes}
    return found.pop() if len(found) == 1 else ANYTHING


def _type_of_write(write: KeyWrite) -> ValueType:
    if write.model is not None:
        kinds = json_types(write.model, write.port)
        kind = next(iter(kinds)) if len(kinds) == 1 else ""
        return ValueType(kind, dimension_of(unit_of(write.model.model_fields[write.port])))
    found = {_type_of_value(value) for value in write.literal}
    return found.pop() if len(found) == 1 else ANYTHING


def _type_of_value(value: Data) -> ValueType:
    if isinstance(value, str) and as_number(value) is not None:
        return ValueType("number", type_of(parse(f"max({value}, {value})"), {}).dimension)
    names = {bool: "boolean", str: "string", list: "array", dict: "object"}
    return ValueType(names.get(type(value), "number" if value is not None else ""))


def _misfit(model: type[PortModel], port: str, write: KeyWrite) -> str:
    """Returns why a written value does not fit the port that reads it, empty if it may fit."""
    wanted = only(model, port)
    for value in write.literal:
        try:
            valid_in_units(wanted, {port: value})
        except ValidationError as error:
            return next(explain(error, wanted, {port: value}, "port")).message
    if write.model is None:
        return ""
    given = json_types(write.model, write.port)
    accepted = json_types(model, port)
    if given and accepted and not given & accepted:
        return f"{port}: expected {_type_names(accepted)}, not {_type_names(given)}"
    complaint = _misfit_of_type(_type_of_write(write), model, port, ())
    return f"{port}: {complaint}" if complaint else ""


@lru_cache(maxsize=512)
def json_types(model: type[PortModel], name: str) -> frozenset[str]:
    """Returns the JSON types that a field accepts; empty if it accepts any."""
    schema = only(model, name).model_json_schema()
    return frozenset(_types_in(schema["properties"][name], schema.get("$defs", {})))


def _types_in(schema: Json, definitions: Json) -> set[str]:
    if "$ref" in schema:
        return _types_in(definitions[schema["$ref"].rpartition("/")[2]], definitions)
    members = [
        _types_in(item, definitions)
        for item in (*schema.get("anyOf", ()), *schema.get("oneOf", ()))
    ]
    if members:
        return set().union(*members) if all(members) else set()
    if "enum" in schema or "const" in schema:
        values = schema.get("enum", [schema.get("const")])
        return {"string" if isinstance(value, str) else "number" for value in values}
    name = schema.get("type")
    return {"number" if name == "integer" else str(name)} if name else set()


def _type_names(types: Set[str]) -> str:
    names = {
        "string": "text",
        "array": "a list",
        "object": "a mapping",
        "number": "a number",
        "boolean": "true or false",
    }
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
        reads = any(map(is_dynamic, node.ports.values()))
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


# Warnings of motions that drift when they are repeated.

_DRIFT_M: Final = 1e-3
"""Smallest displacement in m of one repetition that is reported."""


def drift_warnings(root: NodeSpec, node_types: Mapping[str, NodeType]) -> Iterator[Problem]:
    """Returns warnings of skills that end elsewhere than they began each time they are repeated.

    Only where the file determines it: one leaf of the repeated ones moves the tool by a known
    distance, and no other leaf moves it.
    """
    for node in root.walk():
        node_type = node_types.get(node.kind)
        if not (isinstance(node_type, LanguageNode) and node_type.repeats(node)):
            continue
        shifts = [*_shifts_below(node, node_types)]
        known = [shift for shift in shifts if shift is not None and shift[1] > _DRIFT_M]
        if None in shifts or len(known) != 1:
            continue
        leaf, distance, advice = known[0]
        message = (
            f"each repetition moves the tool by {1000 * distance:.0f} mm: it ends elsewhere than "
            f"it begins"
        )
        yield replace(leaf.problem(message, advice), severity="warning")


def _shifts_below(
    node: NodeSpec, node_types: Mapping[str, NodeType]
) -> Iterator[tuple[NodeSpec, float, str] | None]:
    """Yields how far each leaf below a node moves the tool; None if unknown before the run."""
    for below in itertools.islice(node.walk(), 1, None):
        node_type = node_types.get(below.kind)
        if isinstance(node_type, LanguageNode):
            is_repeated = node_type.repeats(below)  # which has its own warning, if it drifts
            if is_repeated or (len(below.children) > 1 and not node_type.runs_all(below)):
                yield None
        elif node_type is not None:
            shift = _shift_of(below, node_type)
            yield None if shift is None else (below, *shift)


def _shift_of(node: NodeSpec, node_type: NodeType) -> tuple[float, str] | None:
    outputs = node_type.outputs.model_fields.keys()
    ports = {name: value for name, value in node.ports.items() if name not in outputs}
    try:
        checked = validated(node_type.ports, ports)
    except ValidationError:  # a value of the blackboard
        return None
    return node_type.shift(checked)


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
    if any(map(is_dynamic, named)):
        return  # which object is spawned is known only at run time
    spawned = {value for value in named if isinstance(value, str)}
    objects = {
        name
        for name, item in file.objects.items()
        if not (item.spawned or (item.joint.owner if item.joint else name) in spawned)
    }
    arms = {name for name, item in file.arms.items() if not item.spawned} - spawned
    for arm in sorted(arms):
        message = f"arm '{arm}' has spawned: false and no leaf spawns it: its tree never starts"
        yield replace(source.problem(("arms", arm), message, key=True), severity="warning")
    waiting = Declared({"object": frozenset(objects), "arm": frozenset(arms)})
    for node in nodes:
        if node.kind not in node_types:
            continue
        for path, refers, name in _names_in(node_types[node.kind].ports, node.ports):
            if name in waiting.of(refers.to):
                message = f"{node.kind}: '{name}' has spawned: false and no leaf spawns it"
                yield replace(node.port_problem(path, message), severity="warning")


# Warnings of arms that do not hold what a node needs them to hold.

_TAKE_FIRST: Final = "put `grasp` before it, or `take_over` or `approach_and_attach`"


def empty_handed(file: TreeFile, node_types: Mapping[str, NodeType]) -> Iterator[Problem]:
    """Returns a warning for each arm with a node that needs a held object when it holds none.

    Only what must happen counts: that nothing in its tree takes an object, that nothing before the
    node does, or that a node before it has let go of it and none has taken one since.

    Args:
        file: The file.
        node_types: Node types by name, of the language and of the skills.
    """
    for name, arm in file.arms.items():
        nodes = [node for node in arm.tree.walk() if node.kind in node_types]
        taking = [node for node in nodes if node_types[node.kind].takes_hold]
        if not taking:
            needing = next((node for node in nodes if node_types[node.kind].needs_held), None)
            why = "never holds an object: nothing in its tree takes one"
        elif not all(node_types[node.kind].needs_gripper for node in taking):
            continue  # besides the object in its gripper, it may carry attached ones
        else:
            needing, why = _Hand(node_types, taking[0]).first_in_need(arm.tree)
        if needing is not None:
            problem = needing.problem(f"{needing.kind}: {name} {why}", _TAKE_FIRST)
            yield replace(problem, severity="warning")


class _Hand:
    """What a gripper holds while a tree runs, as far as it is certain.

    Args:
        node_types: Node types by name.
        first: First node of the tree that takes an object.
    """

    def __init__(self, node_types: Mapping[str, NodeType], first: NodeSpec) -> None:
        self._node_types = node_types
        self._why = f"holds no object yet: '{first.kind}' comes later"

    def first_in_need(self, node: NodeSpec, *, certain: bool = True) -> tuple[NodeSpec | None, str]:
        """First node from this one down that needs a held object while it holds none, and why.

        Args:
            node: Node that runs next.
            certain: Whether the tree goes on only if the node has succeeded.
        """
        node_type = self._node_types.get(node.kind)
        if node_type is None:  # it may do anything
            self._why = ""
        elif not node.children:
            if self._why and node_type.needs_held:
                return node, self._why
            if node_type.takes_hold:
                self._why = ""
            elif node_type.lets_go and certain:
                self._why = f"holds nothing any more: '{node.kind}' has let go of it before"
        elif isinstance(node_type, LanguageNode) and (
            len(node.children) == 1 or node_type.advances_on is True
        ):
            for number, child in enumerate(node.children):
                ends = [EITHER] * len(node.children)
                ends[number] = FAILURE
                must = certain and not node_type.outcomes(node, ends).succeeds
                found = self.first_in_need(child, certain=must)
                if found[0] is not None:
                    return found
        else:  # its children run in another order, or not all of them
            below = [one for one in node.walk() if one.kind in self._node_types]
            if any(self._node_types[one.kind].takes_hold for one in below):
                self._why = ""
            needing = (one for one in below if self._node_types[one.kind].needs_held)
            if self._why:
                return next(needing, None), self._why
        return None, ""


# Warnings of objects and arms that a tree spawns although they are there.


def present(file: TreeFile, node_types: Mapping[str, NodeType]) -> Iterator[Problem]:
    """Returns warnings of what is in the world from the start, and spawned before any removal.

    Args:
        file: The file; in all its trees, a removal may come before.
        node_types: Node types by name, of the language and of the skills.
    """
    at_start = {name for name, item in file.objects.items() if item.spawned}
    at_start |= {name for name, arm in file.arms.items() if arm.spawned}
    at_start -= {one.object for one in file.faults.values() if isinstance(one, RemovedObject)}
    spawns = [*_bodies(file, node_types, "brings_in")]
    removals = [*_bodies(file, node_types, "takes_out")]
    again = {body for *_, body in spawns}  # an arm that is spawned again runs its tree once more
    for arm, stage, node, port, name in spawns:
        may_be_removed = any(
            one != arm or number <= stage or not {arm, None}.isdisjoint(again)
            for one, number, *_, body in removals
            if body in (name, None)
        )
        if name in at_start and not may_be_removed:
            message = f"{node.kind}: '{name}' is in the world already: no leaf removes it before"
            problem = node.port_problem((port,), message, f"{name}: {{spawned: false, …}}")
            yield replace(problem, severity="warning")


def _bodies(
    file: TreeFile, node_types: Mapping[str, NodeType], ports: Literal["brings_in", "takes_out"]
) -> Iterator[tuple[str, int, NodeSpec, str, str | None]]:
    """Yields arm, stage, node, port and name of each object or arm that nodes bring in or take out.

    The name is None if it is known only at run time.
    """
    for arm, spec in file.arms.items():
        for number, stage in enumerate(_stages(spec.tree, node_types)):
            for node in stage.walk():
                named = getattr(node_types[node.kind], ports) if node.kind in node_types else ()
                for port in sorted(named):
                    value = node.ports.get(port)
                    if value is not None:
                        name = value if isinstance(value, str) and not is_dynamic(value) else None
                        yield arm, number, node, port, name


def _stages(node: NodeSpec, node_types: Mapping[str, NodeType]) -> Iterator[NodeSpec]:
    """Yields parts of a tree of which each ends before the next begins, and never runs again."""
    node_type = node_types.get(node.kind)
    if (
        isinstance(node_type, LanguageNode)
        and node.children
        and node_type.runs_all(node)
        and not node_type.repeats(node)
    ):
        for child in node.children:
            yield from _stages(child, node_types)
    else:
        yield node


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


# Warnings of angles that seem to be in radians.

_RADIANS: Final = tuple(math.radians(angle) for angle in (45, 90, 135, 180, 225, 270, 315, 360))

_ROUNDED: Final = 2e-3
"""Largest difference of a rounded angle in radians, such as 3.14, from its exact value."""


def in_radians(source: Source) -> Iterator[Problem]:
    """Returns warnings of rotations, which are in degrees, that seem to be in radians."""
    for path, angles in _rotations(source.data, ()):
        known = {
            angle: math.degrees(math.copysign(exact, angle))
            for angle in angles
            for exact in _RADIANS
            if abs(abs(angle) - exact) < _ROUNDED
        }
        if not known:
            continue
        shown = ", ".join(f"{angle:g}" for angle in angles)
        degrees = (known.get(angle, round(math.degrees(angle), 1)) for angle in angles)
        problem = source.problem(
            path,
            f"rpy: [{shown}] seems to be in radians; it is taken as degrees",
            f"in degrees: [{', '.join(f'{angle:g}' for angle in degrees)}]; "
            f"or with a unit: '{next(iter(known)):g} rad'",
        )
        yield replace(problem, severity="warning")


def _rotations(data: Data, path: DataPath) -> Iterator[tuple[DataPath, list[float]]]:
    """Yields the path of each ``rpy`` with its numbers."""
    if isinstance(data, dict):
        for name, item in data.items():
            if name == "rpy" and isinstance(item, (list, tuple)):
                if all(isinstance(one, (int, float)) for one in item):
                    yield (*path, name), [float(one) for one in item]
            else:
                yield from _rotations(item, (*path, name))
    elif isinstance(data, (list, tuple)):
        for index, item in enumerate(data):
            yield from _rotations(item, (*path, index))


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
        self._node_types = all_of(self.language, self.skills or {})

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
        objects = self.names.of(("object",))
        check = CellCheck(
            source, cell, objects, trees, self._node_types, is_sound=cache(self._is_sound)
        )
        self.problems += check.problems()

    def _is_sound(self, node: NodeSpec) -> bool:
        """Whether a node has no errors of its own."""
        node_type = self._node_types.get(node.kind)
        if node_type is None or not node.whole:
            return node.whole and self.skills is None  # it may be one of the skills
        return not any(check_node(node, node_type, self.names, self._node_types))

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
            yield from drift_warnings(arm.tree, self._node_types)
        yield from absent(file, source, self._node_types)
        yield from empty_handed(file, self._node_types)
        yield from present(file, self._node_types)
