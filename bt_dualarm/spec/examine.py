"""All checks of the trees of one file, in the order in which they make sense."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from bt_dualarm.spec.check import Declared, check_tree
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.flow import Flow
from bt_dualarm.spec.kind import Kind
from bt_dualarm.spec.language import LANGUAGE
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.outcomes import warnings
from bt_dualarm.spec.presence import absent
from bt_dualarm.spec.problems import Problem
from bt_dualarm.spec.source import Source


@dataclass
class Examination:
    """Checks the trees of one file.

    Args:
        skills: Skills by name; without them leaves are passed over, and what depends on them.
        names: Names that the file declares.

    Attributes:
        problems: Found so far.
    """

    skills: Mapping[str, Kind] | None
    names: Declared
    problems: list[Problem] = field(default_factory=list)
    _kinds: Mapping[str, Kind] = field(init=False)

    def __post_init__(self) -> None:
        self._kinds = {**LANGUAGE, **(self.skills or {})}

    def nodes(self, root: NodeSpec) -> None:
        """Check each node by itself."""
        complete = self.skills is not None
        self.problems += check_tree(root, self._kinds, self.names, complete=complete)

    def tree(self, root: NodeSpec) -> None:
        """Check each node, and the blackboard where every node's outputs are known."""
        self.nodes(root)
        if all(node.kind in self._kinds for node in root.walk()):
            flow = Flow(self._kinds)
            flow.follow(root)
            self.problems += flow.problems

    def doubts(self, file: TreeFile, source: Source) -> Iterator[Problem]:
        """Warnings of what is allowed in a file without errors, but can hardly be meant."""
        for arm in file.arms.values():
            yield from warnings(arm.tree)
        yield from absent(file, source, self._kinds)


def declared_names(source: Source) -> Declared:
    """What the ports of a file's nodes may refer to."""
    sorts = {"object": source.get(("objects",)), "arm": source.get(("arms",))}
    return Declared(
        {
            sort: frozenset(items) if isinstance(items, dict) else frozenset()
            for sort, items in sorts.items()
        }
    )
