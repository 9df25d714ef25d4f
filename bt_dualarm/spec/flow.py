"""What is written to the blackboard before it is read.

Finds keys that nobody can have written yet, values of the wrong type, keys that nobody reads.

May-analysis: a key counts as written where any run of the tree could have written it, so that
no right tree is refused.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Set
from dataclasses import dataclass, field, replace
from functools import lru_cache

from pydantic import ValidationError

from bt_dualarm.spec.explain import explain
from bt_dualarm.spec.kind import Kind
from bt_dualarm.spec.language import LANGUAGE
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.ports import (
    KEY,
    REFERENCE,
    PortModel,
    key_name,
    only,
    reference_of,
    references_in,
    templates_of,
    validated,
    written_keys,
)
from bt_dualarm.spec.problems import Problem, nearest, suggestion
from bt_dualarm.spec.source import Data, Json

_OWN_KEYS = "nothing writes a key here; each arm and each use of a subtree has keys of its own"


@dataclass(frozen=True, eq=False)
class Write:
    """One place where a key is written.

    Attributes:
        node: Node that writes it.
        port: That names the key.
        key: Key as the arm's blackboard has it.
        literal: The value in YAML's notation as a list of one, empty if it is not known.
        model: Declares the output of that name, if a skill writes it.
    """

    node: NodeSpec
    port: str
    key: str
    literal: tuple[Data, ...] = ()
    model: type[PortModel] | None = None


@dataclass(frozen=True, eq=False)
class Read:
    """One place where a key is read."""

    node: NodeSpec
    port: str
    key: str
    model: type[PortModel] | None = None


@dataclass
class Flow:
    """The keys of one arm's tree.

    Args:
        kinds: Kinds by name, those of every node in the tree among them.

    Attributes:
        problems: Found by `follow`.
    """

    kinds: Mapping[str, Kind]
    problems: list[Problem] = field(default_factory=list)
    _before: dict[str, list[Write]] = field(default_factory=dict)
    _noted: set[Write] = field(default_factory=set)
    _hidden: set[Write] = field(default_factory=set)
    _writes: dict[NodeSpec, list[Write]] = field(default_factory=dict)

    def follow(self, root: NodeSpec) -> None:
        """Look at the whole tree."""
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

    def _visit(self, node: NodeSpec, everywhere: set[str]) -> list[Write]:
        """Check what a node and those below it read; returns what they newly write."""
        new: list[Write] = []
        word, kind = LANGUAGE.get(node.kind), self.kinds[node.kind]
        if word is not None and word.revisits(node):
            new += self._note(write for below in node.walk() for write in self._writes[below])
        for read in self._reads(node):
            writes = [w for w in self._before.get(read.key, ()) if w not in self._hidden]
            self._check(read, writes, everywhere)
        new += self._note(self._writes[node])
        branches: list[Write] = []
        for slot, child in zip(node.slots, node.children, strict=True):
            is_branch = kind.is_alternative(slot)
            hidden = set(branches) if is_branch else set()
            self._hidden |= hidden
            written = self._visit(child, everywhere)
            self._hidden -= hidden
            new += written
            branches += written if is_branch else []
        return new

    def _note(self, writes: Iterable[Write]) -> list[Write]:
        """Count writes as done from here on; returns those that were not."""
        new = [write for write in writes if write not in self._noted]
        self._noted.update(new)
        for write in new:
            self._before.setdefault(write.key, []).append(write)
        return new

    def _check(self, read: Read, writes: list[Write], everywhere: set[str]) -> None:
        if not writes:
            self.problems.append(_never_written(read, everywhere))
        for write in writes:
            complaint = _misfit(read.model, read.port, write) if read.model else ""
            if complaint:
                place = write.node.place
                hint = f"'{{{key_name(read.key)}}}' is written at {place}"
                message = f"{read.node.kind}: {complaint}"
                self.problems.append(read.node.port_problem((read.port,), message, hint))

    def _writes_of(self, node: NodeSpec) -> Iterator[Write]:
        kind = self.kinds[node.kind]
        for port, written in written_keys(kind.ports).items():
            key, value = node.ports.get(port), node.ports.get(written)
            if isinstance(key, str) and KEY.fullmatch(key_name(key)):
                yield Write(node, port, key, () if reference_of(value) else (value,))
        for name in kind.outputs.model_fields:
            output = reference_of(node.ports.get(name))
            if output is not None:
                yield Write(node, name, output, model=kind.outputs)

    def _reads(self, node: NodeSpec) -> Iterator[Read]:
        kind = self.kinds[node.kind]
        if kind.uses:  # what a subtree is given is read where its nodes read it
            return
        for port, key in references_in(kind.ports, node.ports).items():
            if KEY.fullmatch(key_name(key)):  # else the parser has refused it
                yield Read(node, port, key, kind.ports)
        for port in templates_of(kind.ports):
            for match in REFERENCE.finditer(str(node.ports.get(port, ""))):
                if KEY.fullmatch(key_name(match[1])):
                    yield Read(node, port, match[1])


def _never_written(read: Read, everywhere: set[str]) -> Problem:
    name = key_name(read.key)
    if read.key in everywhere:
        hint = "it is written further down only"
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


def _misfit(model: type[PortModel], port: str, write: Write) -> str:
    """Why what is written does not fit the port that reads it, empty if it may."""
    wanted = only(model, port)
    for value in write.literal:
        try:
            validated(wanted, {port: value})
        except ValidationError as error:
            return next(explain(error, wanted, {port: value}, "port")).message
    if write.model is None:
        return ""
    given, accepted = json_types(write.model, write.port), json_types(model, port)
    if given and accepted and not given & accepted:
        return f"{port}: expected {_words(accepted)}, not {_words(given)}"
    return ""


@lru_cache(maxsize=512)
def json_types(model: type[PortModel], name: str) -> frozenset[str]:
    """JSON's names of the types that a field may have; empty if it may have any."""
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
    kind = schema.get("type")
    return {"number" if kind == "integer" else str(kind)} if kind else set()


def _words(types: Set[str]) -> str:
    words = {"string": "text", "array": "a list", "object": "a mapping", "number": "a number"}
    return " or ".join(sorted(words.get(kind, kind) for kind in types))


def _unused(write: Write) -> Problem:
    message = f"{write.node.kind}: nothing reads '{{{key_name(write.key)}}}'"
    return replace(write.node.port_problem((write.port,), message), severity="warning")
