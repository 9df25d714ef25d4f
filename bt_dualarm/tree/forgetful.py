"""Nodes that nothing of theirs refers back to: a tree is gone as soon as nobody needs it."""

from __future__ import annotations

from collections.abc import Iterator

from py_trees.behaviour import Behaviour


class Forgetful(Behaviour):
    """Mixed into nodes, does without the iterator over itself that py_trees keeps in each.

    Nothing uses it, and it is a circle: it would keep the tree, and with it the world, in memory
    until Python looks for circles.
    """

    @property
    def iterator(self) -> Iterator[Behaviour]:
        """One tick of the node, as py_trees has it."""
        return self.tick()

    @iterator.setter
    def iterator(self, _: Iterator[Behaviour]) -> None:
        """Forget it."""


def forget_parent(node: Behaviour) -> None:
    """Take away a node's reference to its parent: nobody looks up the tree."""
    node.parent = None
