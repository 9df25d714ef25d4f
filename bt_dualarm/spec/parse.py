"""From YAML data to nodes: the shape of a tree, without knowing what the skills are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from bt_dualarm.spec.explain import describe
from bt_dualarm.spec.language import LANGUAGE, Kind
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.ports import KEY, Template, WrittenKey, reference_of
from bt_dualarm.spec.problems import Problem
from bt_dualarm.spec.scope import Scope
from bt_dualarm.spec.source import Data, Path, Source

MAX_EXPANDED: Final = 10_000
"""Nodes of one tree with every use of a subtree written out."""

_LONGEST_NAME: Final = 60
_LEAF: Final = Kind("leaf", "")


@dataclass
class Parser:
    """Parses the trees of one file; collects what is wrong on the way.

    Attributes:
        problems: Found so far.
    """

    problems: list[Problem] = field(default_factory=list)
    _count: int = 0

    def node(self, data: Data, source: Source, path: Path, scope: Scope) -> NodeSpec | None:
        """The node at ``path``, or None with the reason among the problems."""
        self._count += 1
        if self._count > MAX_EXPANDED:
            if self._count == MAX_EXPANDED + 1:
                self._add(source, path, f"the trees have more than {MAX_EXPANDED} nodes")
            return None
        if isinstance(data, str):
            data = {data: None}
        if not isinstance(data, dict) or len(data) != 1:
            self._add(source, path, *_not_a_node(data))
            return None
        kind_name, body = next(iter(data.items()))
        kind = LANGUAGE.get(kind_name, _LEAF)
        fields = self._fields(kind, kind_name, body, source, path)
        name = self._name(fields.pop("name", None), kind_name, source, path)
        children = tuple(self._children(kind, kind_name, fields, source, path, scope))
        for place in kind.places:
            fields.pop(place, None)
        return NodeSpec(
            kind_name,
            name,
            self._ports(kind, kind_name, fields, source, path, scope),
            tuple(child for _, child in children),
            tuple(slot for slot, _ in children),
            source,
            path,
        )

    def _fields(
        self, kind: Kind, name: str, body: Data, source: Source, path: Path
    ) -> dict[str, Data]:
        """The body of a node as a mapping, whichever notation it has."""
        if body is None:
            return {}
        if isinstance(body, dict):
            return dict(body)
        if isinstance(body, list) and kind.many:
            return {"children": body}
        if kind.shorthand and not isinstance(body, list):
            return {kind.shorthand: body}
        wanted = "a list of nodes" if kind.many else "a mapping of ports"
        hint = f"for example: {kind.example}" if kind.example else ""
        message = f"{name}: expected {wanted}, not {describe(body)}"
        self._add(source, (*path, name), message, hint)
        return {}

    def _name(self, given: Data, kind_name: str, source: Source, path: Path) -> str:
        if given is None:
            return kind_name
        if (
            isinstance(given, str)
            and 0 < len(given) <= _LONGEST_NAME
            and given.isprintable()
            and not set(given) & set("/#{}")
        ):
            return given
        hint = f"at most {_LONGEST_NAME} characters, without / # {{ }}"
        message = f"name: {describe(given)} cannot be a node's name"
        self._add(source, (*path, kind_name, "name"), message, hint)
        return kind_name

    def _children(
        self,
        kind: Kind,
        kind_name: str,
        fields: Mapping[str, Data],
        source: Source,
        path: Path,
        scope: Scope,
    ) -> Iterator[tuple[str, NodeSpec]]:
        here = (*path, kind_name)
        for slot, data, place in self._places(kind, kind_name, fields, source, here):
            child = self.node(data, source, place, scope)
            if child is not None:
                yield slot, child

    def _places(
        self, kind: Kind, name: str, fields: Mapping[str, Data], source: Source, here: Path
    ) -> Iterator[tuple[str, Data, Path]]:
        """Each child's place in the node, its data, and its path in the file."""
        if kind.many:
            yield from self._list(name, fields.get("children"), source, here)
        if kind.cases:
            yield from self._cases(name, fields.get("cases"), source, (*here, "cases"))
        for slot in kind.slots:
            if fields.get(slot.name) is not None:
                yield slot.name, fields[slot.name], (*here, slot.name)
            elif slot.required:
                message = f"{name}: '{slot.name}' is missing"
                self._add(source, here, message, f"{slot.name}: a node", key=True)

    def _list(
        self, name: str, children: Data, source: Source, here: Path
    ) -> Iterator[tuple[str, Data, Path]]:
        path = (*here, "children") if (*here, "children") in source.values else here
        if not isinstance(children, list) or not children:
            hint = f"{name}: [node, node, …], or a mapping with 'children'"
            self._add(source, path, f"{name}: has no children", hint, key=True)
            return
        for index, child in enumerate(children):
            yield "children", child, (*path, index)

    def _cases(
        self, name: str, cases: Data, source: Source, path: Path
    ) -> Iterator[tuple[str, Data, Path]]:
        if not isinstance(cases, dict) or not cases:
            hint = "cases: {value: node, value: node}"
            self._add(source, path, f"{name}: has no cases", hint, key=True)
            return
        for case, child in cases.items():
            yield case, child, (*path, case)

    def _ports(
        self,
        kind: Kind,
        kind_name: str,
        fields: Mapping[str, Data],
        source: Source,
        path: Path,
        scope: Scope,
    ) -> dict[str, Data]:
        ports: dict[str, Data] = {}
        for name, value in fields.items():
            self._check_references(value, source, (*path, kind_name, name))
            metadata = _metadata(kind, name)
            if Template in metadata and isinstance(value, str):
                ports[name] = scope.fill_text(value)
            elif WrittenKey in metadata and isinstance(value, str) and KEY.fullmatch(value):
                ports[name] = scope.key(value)
            else:
                ports[name] = scope.fill(value)
        return ports

    def _check_references(self, value: Data, source: Source, path: Path) -> None:
        if isinstance(value, (dict, list)):
            items = value.items() if isinstance(value, dict) else enumerate(value)
            for part, item in items:
                self._check_references(item, source, (*path, part))
            return
        key = reference_of(value)
        if key is not None and not KEY.fullmatch(key):
            hint = "a key has letters, digits and _ and begins with a letter"
            self._add(source, path, f"'{{{key}}}' is not a reference to a key", hint)

    def _add(
        self, source: Source, path: Path, message: str, hint: str = "", *, key: bool = False
    ) -> None:
        self.problems.append(source.problem(path, message, hint, key=key))


def _metadata(kind: Kind, port: str) -> set[type[Any]]:
    info = kind.ports.model_fields.get(port)
    return {type(item) for item in info.metadata} if info else set()


def _not_a_node(data: Data) -> tuple[str, str]:
    if isinstance(data, dict) and data:
        keys = ", ".join(list(data)[:4])
        hint = f"indent what belongs to '{next(iter(data))}' further than it"
        return f"a node has one key, its kind; here are {len(data)}: {keys}", hint
    hint = "a node is written 'kind: {port: value}'"
    if isinstance(data, list):
        hint = "for several nodes write 'sequence:' above the list"
    return f"expected a node, not {describe(data)}", hint
