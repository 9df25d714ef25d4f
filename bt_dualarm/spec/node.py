"""A node of a tree as the file writes it: not yet known to be right."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from bt_dualarm.spec.problems import Place, Problem
from bt_dualarm.spec.source import Data, Path, Source


@dataclass(frozen=True, eq=False)
class NodeSpec:
    """One node with all below it.

    Attributes:
        kind: A word of the language such as ``sequence``, or a skill's name.
        name: Name given by the author, else the kind.
        ports: Everything else that the node was given, as YAML data; parameters are filled in.
        children: Nodes below it, in the order of the file.
        slots: Role of each child for this node: ``children``, ``child``, ``condition``, a case, …
        source: The file it stands in.
        path: Path in that file.
        whole: Whether the parser could make sense of all that was written.
        user: Place where the subtree that it is part of is used, if it is part of one.
        parameters: Names of those that it may refer to.
    """

    kind: str
    name: str
    ports: Mapping[str, Data]
    children: tuple[NodeSpec, ...] = ()
    slots: tuple[str, ...] = ()
    source: Source = field(default_factory=lambda: Source("<none>", ()), repr=False)
    path: Path = field(default=(), repr=False)
    whole: bool = field(default=True, repr=False)
    user: Place | None = field(default=None, repr=False)
    parameters: frozenset[str] = field(default=frozenset(), repr=False)

    @property
    def place(self) -> Place:
        """Where the node's kind stands in the file."""
        return self.source.key_place((*self.path, self.kind))

    def problem(self, message: str, hint: str = "") -> Problem:
        """An error of the node as a whole."""
        return Problem(self.place, message, hint)

    def port_problem(
        self, path: Path, message: str, hint: str = "", *, key: bool = False
    ) -> Problem:
        """An error of one port, or of something inside its value."""
        return self.source.problem((*self.path, self.kind, *path), message, hint, key=key)

    def walk(self) -> Iterator[NodeSpec]:
        """This node, then those below it, in the order of the file."""
        waiting = [self]
        while waiting:
            node = waiting.pop()
            yield node
            waiting += reversed(node.children)
