"""The check of parsed nodes against what each kind declares: names, ports, outputs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from pydantic import ValidationError
from pydantic.fields import FieldInfo

from bt_dualarm.spec.annotations import metadata_of
from bt_dualarm.spec.explain import explain
from bt_dualarm.spec.kind import Kind
from bt_dualarm.spec.language import LANGUAGE
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.parse import not_a_body
from bt_dualarm.spec.ports import (
    is_unknown,
    key_name,
    miscounted,
    reference_of,
    references_in,
    validate_literals,
)
from bt_dualarm.spec.problems import Problem, nearest, suggestion
from bt_dualarm.spec.source import Data, Path
from bt_dualarm.spec.synonyms import kind_hint
from bt_dualarm.spec.values import Refers
from bt_dualarm.spec.wording import in_words


@dataclass(frozen=True)
class Declared:
    """Names that the tree file declares, by what they are: ``object`` and ``arm``."""

    names: Mapping[str, frozenset[str]]

    def of(self, what: tuple[str, ...]) -> frozenset[str]:
        """All names of these sorts."""
        return frozenset().union(*(self.names.get(sort, frozenset()) for sort in what))


def check_tree(
    root: NodeSpec, kinds: Mapping[str, Kind], declared: Declared, *, complete: bool = True
) -> Iterator[Problem]:
    """Everything wrong with the nodes of one tree.

    Args:
        root: The tree.
        kinds: Kinds of node by name: the language's words and the skills.
        declared: Names that ports may refer to.
        complete: Whether ``kinds`` has all skills; if not, unknown kinds are passed over.
    """
    for node in _once(root):
        kind = kinds.get(node.kind)
        if kind is not None and node.whole:
            yield from check_node(node, kind, declared)
        elif kind is not None and node.kind not in LANGUAGE:  # else the parser has said so
            body = node.source.get((*node.path, node.kind))
            yield node.port_problem((), *not_a_body(kind, body))
        elif kind is None and complete:
            message = f"there is no node or skill '{node.kind}'"
            yield node.problem(message, kind_hint(node.kind, kinds))


def _once(root: NodeSpec) -> Iterator[NodeSpec]:
    """The nodes of a tree, those of a subtree that is used often once for all alike."""
    alike: dict[tuple[int, Path], NodeSpec] = {}
    for node in root.walk():
        before = alike.get((id(node.source), node.path))
        if before is None or not _is_alike(before, node):
            alike[id(node.source), node.path] = node
            yield node


def _is_alike(one: NodeSpec, other: NodeSpec) -> bool:
    """Whether the same is wrong with two nodes that stand in one place, if anything is."""
    return (one.kind, one.ports, len(one.children)) == (
        other.kind,
        other.ports,
        len(other.children),
    )


def check_node(node: NodeSpec, kind: Kind, declared: Declared) -> Iterator[Problem]:
    """Everything wrong with one node's ports and outputs."""
    outputs = {name: node.ports[name] for name in kind.outputs.model_fields if name in node.ports}
    ports = {name: value for name, value in node.ports.items() if name not in outputs}
    known: set[Path] = set()
    try:
        validate_literals(kind.ports, ports)
    except ValidationError as error:
        for found in explain(error, kind.ports, ports, "port", kind.places):
            message = f"{node.kind}: {found.message}"
            at_key = found.at_key or not found.path
            key = reference_of(_at(ports, found.path))
            hint = _parameter_hint(node, key) if key else ""
            yield node.port_problem(found.path, message, hint or found.hint, key=at_key)
            known.add(found.path)
    for path, key in _inner_references({} if kind.uses else ports):
        if path not in known:
            message = f"{node.kind}: '{{{key_name(key)}}}' is no parameter"
            hint = _parameter_hint(node, key) or "a key can only stand for a whole port"
            yield node.port_problem(path, message, hint)
    for name, field in kind.ports.model_fields.items():
        if name in ports:
            yield from _unknown_name(node, name, field, ports[name], declared)
    references = references_in(kind.ports, ports)
    complaint = miscounted(kind.ports, ports) if references else ""
    if complaint:  # without references the model itself has said so
        yield node.port_problem((), f"{node.kind}: {complaint}", key=True)
    for name in (name for name in kind.fixed & references.keys() if not is_unknown(ports[name])):
        message = f"{node.kind}: {name}: cannot come from the blackboard"
        yield node.port_problem((name,), message, "write the value out, or use a parameter")
    if node.kind in LANGUAGE:
        yield from LANGUAGE[node.kind].complaint(node)
    for name, value in outputs.items():
        if reference_of(value) is None:
            message = f"{node.kind}: output '{name}' needs a key to write, not {in_words(value)}"
            yield node.port_problem((name,), message, f'for example: {name}: "{{{name}}}"')


def _inner_references(data: Data, path: Path = ()) -> Iterator[tuple[Path, str]]:
    """References inside of a port's value, where they cannot be replaced in a running tree."""
    if isinstance(data, (dict, list)):
        for part, item in data.items() if isinstance(data, dict) else enumerate(data):
            yield from _inner_references(item, (*path, part))
    key = reference_of(data)
    if key is not None and len(path) > 1 and not is_unknown(data):
        yield path, key


def _at(data: Data, path: Path) -> Data:
    """What the data has at a path; None where a part of it is missing."""
    for part in path:
        try:
            data = data[part]
        except (KeyError, IndexError, TypeError):
            return None
    return data


def _parameter_hint(node: NodeSpec, key: str) -> str:
    """The parameter that was most likely meant by a key, if one is near enough."""
    close = nearest(key_name(key), node.parameters)
    return f"did you mean the parameter '{close}'?" if close else ""


def _unknown_name(
    node: NodeSpec, port: str, field: FieldInfo, value: Data, declared: Declared
) -> Iterator[Problem]:
    refers = refers_of(field)
    if refers is None or not isinstance(value, str) or reference_of(value) is not None:
        return
    names = declared.of(refers.to)
    if value not in names:
        what = " or ".join(refers.to)
        hint = suggestion(value, names, what)
        yield node.port_problem((port,), f"{node.kind}: there is no {what} '{value}'", hint)


def refers_of(field: FieldInfo) -> Refers | None:
    """What the names in this port refer to, if it holds names."""
    return metadata_of(field, Refers)
