"""A tree that is changed while it runs: what is unchanged goes on, the rest begins anew."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol, cast

from py_trees.behaviour import Behaviour

from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.tree.arm_tree import TreeNode
from bt_dualarm.tree.binding import BoundPorts
from bt_dualarm.tree.halting import reset
from bt_dualarm.tree.watched import Watched


class Builder(Protocol):
    """Makes nodes that share one blackboard."""

    def node(self, spec: NodeSpec, path: str) -> TreeNode:
        """A node with all below it, in its place."""

    def bound(self, spec: NodeSpec) -> BoundPorts:
        """Ports of a node with children."""


class Grafting:
    """Changes the tree of one arm, between two of its ticks.

    Two nodes are one where their paths and kinds are the same. A leaf whose ports are the same goes
    on; another one is halted, and begins anew when its parent comes to it. A node with children
    goes on with those it has then; with other ports it begins to count, or to wait, anew.

    Args:
        builder: Maker of new nodes.
        spec: The tree as it is built.
        names: Function that gives siblings names that differ.
    """

    def __init__(
        self,
        builder: Builder,
        spec: NodeSpec,
        names: Callable[[Sequence[NodeSpec]], list[str]],
    ) -> None:
        self._builder, self._spec, self._names = builder, spec, names

    def grafted(self, root: TreeNode, now: NodeSpec) -> TreeNode:
        """The tree as it shall be from now on.

        Args:
            root: Top node of the tree as it is.
            now: Definition of the tree as it shall be, checked.
        """
        was, self._spec = self._spec, now
        if was.name != now.name:
            return self._anew(root, now, now.name)
        return self._node(root, was, now, now.name)

    def _node(self, old: TreeNode, was: NodeSpec, now: NodeSpec, path: str) -> TreeNode:
        if was.kind != now.kind or bool(was.children) != bool(now.children):
            return self._anew(old, now, path)
        if not isinstance(old, Watched):
            return old if was.ports == now.ports else self._anew(old, now, path)
        children, became = self._children(old, was, now, path)
        goes_on = old.exchange(children, now.slots, became)
        if was.ports != now.ports:
            goes_on = old.redefine(self._builder.bound(now)) and goes_on
        if not goes_on:
            reset((old,))
        return old

    def _children(
        self, old: Watched, was: NodeSpec, now: NodeSpec, path: str
    ) -> tuple[list[Behaviour], dict[Behaviour, Behaviour]]:
        """The children that it shall have, and what became of those that it had."""
        names = zip(self._names(was.children), old.children, was.children, strict=True)
        there = {name: (cast("TreeNode", child), spec) for name, child, spec in names}
        children: list[Behaviour] = []
        became: dict[Behaviour, Behaviour] = {}
        for spec, name in zip(now.children, self._names(now.children), strict=True):
            below = f"{path}/{name}"
            if name in there:
                child, before = there.pop(name)
                became[child] = self._node(child, before, spec, below)
                children.append(became[child])
            else:
                children.append(self._builder.node(spec, below))
            children[-1].parent = None
        for gone, _ in there.values():
            reset((gone,))
        return children, became

    def _anew(self, old: TreeNode, now: NodeSpec, path: str) -> TreeNode:
        reset((old,))
        return self._builder.node(now, path)
