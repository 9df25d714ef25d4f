"""From YAML data to nodes: the shape of a tree, without knowing what the skills are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Final, TypeAlias

from bt_dualarm.spec.expand import Expansion
from bt_dualarm.spec.kind import Kind
from bt_dualarm.spec.language import LANGUAGE
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.ports import KEY, REFERENCE, Template, WrittenKey, reference_of, unknown
from bt_dualarm.spec.problems import Problem, nearest
from bt_dualarm.spec.site import Site, SubtreeSpec
from bt_dualarm.spec.source import Data
from bt_dualarm.spec.wording import in_words

MAX_EXPANDED: Final = 5_000
"""Nodes of all trees of a file with every use of a subtree written out."""

_DEEPEST: Final = 64
_LONGEST_NAME: Final = 60
_KEY_RULE: Final = "a key has letters, digits and _ and begins with a letter"
_WITHIN_TEXT: Final = "nothing is computed; only the messages of log and fail are put together"
_Child: TypeAlias = tuple[str, Data, Site]
"""What a child is to its node, its data, where it stands."""


@dataclass
class Parser:
    """Parses the trees of one file, writing out the subtrees that they use.

    Attributes:
        problems: Found so far.
        used: Subtrees that the trees use, directly or through others.
    """

    problems: list[Problem] = field(default_factory=list)
    used: set[SubtreeSpec] = field(default_factory=set)
    _count: int = 0
    _uses: int = 0

    def tree(self, site: Site) -> NodeSpec | None:
        """The tree at a place, or None with the reason among the problems."""
        return self.node(site.data, site)

    def node(self, data: Data, site: Site) -> NodeSpec | None:
        """The node that ``data`` is, or None with the reason among the problems."""
        self._count += 1
        if self._count > MAX_EXPANDED:
            if self._count == MAX_EXPANDED + 1:
                self._add(site, f"the trees have more than {MAX_EXPANDED} nodes")
            return None
        if site.depth >= _DEEPEST:
            self._add(site, f"nodes are nested deeper than {_DEEPEST} levels")
            return None
        if isinstance(data, str):
            data = {data: None}
        if not isinstance(data, dict) or len(data) != 1:
            self._add(site, *_not_a_node(data))
            return None
        name, body = next(iter(data.items()))
        return self._known_node(LANGUAGE.get(name) or Kind(name, ""), body, site.deeper())

    def _known_node(self, kind: Kind, body: Data, site: Site) -> NodeSpec:
        here = site.into(kind.name)
        fields = _fields(kind, body)
        if fields is None:
            if kind.name in LANGUAGE:  # of others it is told once it is known whether they are
                self._add(here, *not_a_body(kind, body))
            node = NodeSpec(kind.name, kind.name, {}, whole=False)
            return replace(node, source=site.source, path=site.path, user=site.user)
        children = list(self._children(kind, fields, here))
        ports = {
            port: self._port(kind, port, value, here.into(port))
            for port, value in fields.items()
            if port not in kind.no_ports
        }
        if kind.uses:
            children += self._use(ports, here)
        return NodeSpec(
            kind.name,
            self._name(kind, fields.get("name"), ports, here),
            ports,
            tuple(child for _, child in children),
            tuple(slot for slot, _ in children),
            site.source,
            site.path,
            user=site.user,
            parameters=frozenset(site.scope.values),
        )

    def _name(self, kind: Kind, given: Data, ports: Mapping[str, Data], here: Site) -> str:
        if given is None:  # a subtree's name may have come from a parameter
            used = ports.get(kind.uses)
            return used if isinstance(used, str) and KEY.fullmatch(used) else kind.name
        if (
            isinstance(given, str)
            and 0 < len(given) <= _LONGEST_NAME
            and given.isprintable()
            and not set(given) & set("/#{}")
        ):
            return given
        hint = f"at most {_LONGEST_NAME} characters, without / # {{ }}"
        self._add(here.into("name"), f"name: {in_words(given)} cannot be a node's name", hint)
        return kind.name

    def _children(
        self, kind: Kind, fields: Mapping[str, Data], here: Site
    ) -> Iterator[tuple[str, NodeSpec]]:
        for slot, data, site in self._places(kind, fields, here):
            child = self.node(data, site)
            if child is not None:
                yield slot, child

    def _places(self, kind: Kind, fields: Mapping[str, Data], here: Site) -> Iterator[_Child]:
        misspelt = _misspelt(kind, fields)
        if kind.many and "children" not in misspelt:
            yield from self._list(kind, fields.get("children"), here)
        if kind.cases and "cases" not in misspelt:
            yield from self._cases(kind, fields.get("cases"), here.into("cases"))
        for slot in kind.slots:
            if fields.get(slot.name) is not None:
                yield slot.name, fields[slot.name], here.into(slot.name)
            elif slot.required and slot.name not in misspelt:
                message = f"{kind.name}: '{slot.name}' is missing"
                self._add(here, message, f"{slot.name}: a node", key=True)

    def _list(self, kind: Kind, children: Data, here: Site) -> Iterator[_Child]:
        if isinstance(here.data, dict):
            here = here.into("children")
        if not isinstance(children, list) or not children:
            hint = f"{kind.name}: [node, node, …], or a mapping with 'children'"
            self._add(here, f"{kind.name}: has no children", hint, key=True)
            return
        for index, child in enumerate(children):
            yield "children", child, here.into(index)

    def _cases(self, kind: Kind, cases: Data, here: Site) -> Iterator[_Child]:
        if not isinstance(cases, dict) or not cases:
            self._add(here, f"{kind.name}: has no cases", "cases: {value: node, …}", key=True)
            return
        for case, child in cases.items():
            yield case, child, here.into(case)

    def _port(self, kind: Kind, port: str, value: Data, here: Site) -> Data:
        """The value of a port with its references resolved, as far as they can be by now."""
        metadata = _metadata(kind, port)
        if Template in metadata and isinstance(value, str):
            for match in REFERENCE.finditer(value):
                self._is_key(match[1], here)
            return here.scope.fill_text(value)
        if WrittenKey in metadata and isinstance(value, str):
            return self._written_key(value, here)
        return here.scope.fill(self._checked(value, here))

    def _written_key(self, value: str, here: Site) -> str:
        if not KEY.fullmatch(value):
            name = here.path[-1]
            self._add(here, f"{name}: {in_words(value)} cannot be a key", _KEY_RULE)
        return here.scope.key(value)

    def _checked(self, value: Data, here: Site) -> Data:
        """The value of a port; what is no reference but looks like one is said, and not known."""
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

    def _is_key(self, key: str, here: Site) -> bool:
        """Whether what stands in braces can be a key; else that is among the problems."""
        if KEY.fullmatch(key):
            return True
        self._add(here, f"'{{{key}}}' is not a reference to a key", _KEY_RULE)
        return False

    def _use(self, ports: Mapping[str, Data], here: Site) -> list[tuple[str, NodeSpec]]:
        """Write out the subtree that a node uses."""
        self._uses += 1
        expansion = Expansion(here, ports, self._uses)
        site = expansion.site()
        self.problems += expansion.problems
        self.used.update(site.uses if site is not None else ())
        root = self.tree(site) if site is not None else None
        return [] if root is None else [("child", root)]

    def _add(self, site: Site, message: str, hint: str = "", *, key: bool = False) -> None:
        self.problems.append(site.problem(message, hint, key=key))


def _fields(kind: Kind, body: Data) -> dict[str, Data] | None:
    """The body of a node as a mapping, whichever notation it has; None if it has none."""
    if body is None:
        return {}
    if isinstance(body, dict):
        return dict(body)
    if isinstance(body, list):
        return {"children": body} if kind.many else None
    return {kind.shorthand: body} if kind.shorthand else None


def _misspelt(kind: Kind, fields: Mapping[str, Data]) -> set[str]:
    """Missing places that an unknown field was most likely meant to be: its check says so."""
    unknown = fields.keys() - kind.places - kind.ports.model_fields.keys()
    if not unknown:
        return set()
    known = kind.places | kind.ports.model_fields.keys()
    meant = {nearest(name, known) for name in unknown}
    return {name for name in kind.places - fields.keys() if name in meant}


def not_a_body(kind: Kind, body: Data) -> tuple[str, str]:
    """Message and hint for what does not fit a node of this kind as a whole."""
    hint = ""
    if isinstance(body, str) and kind.slots:
        hint = f"write {{{kind.slots[0].name}: {body}}}"
    elif isinstance(body, list):
        hint = "several nodes go below 'sequence:'" if kind.slots else ""
    wanted = "a list of nodes" if kind.many else "a mapping of ports"
    return f"{kind.name}: expected {wanted}, not {in_words(body)}", hint


def _metadata(kind: Kind, port: str) -> set[type[object]]:
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
    return f"expected a node, not {in_words(data)}", hint
