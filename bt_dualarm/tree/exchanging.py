"""Nodes that remember which child they are at, and go on when their children are exchanged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias, cast

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_dualarm.spec.composite_words import Memory
from bt_dualarm.tree.binding import BoundPorts
from bt_dualarm.tree.watched import Watched

Siblings: TypeAlias = Sequence[Behaviour]
"""Children of one node, in the order of the file."""

Became: TypeAlias = Mapping[Behaviour, Behaviour]
"""What became of a node's children: themselves, or others in their places; the rest is gone."""


class Remembering(Watched):
    """Mixed into py_trees' sequence and selector."""

    current_child: Behaviour | None
    memory: bool

    def exchange(self, children: Siblings, slots: tuple[str, ...], became: Became) -> bool:
        """Go on with the child that is in the place of the one that ran.

        Where that is gone, with the one that stands behind those that came before it.
        """
        before = [*self.children]
        super().exchange(children, slots, became)
        now = self.current_child
        if now is None or self.status is not Status.RUNNING:
            self.current_child = None if now is None else children[0]
            return True
        if now in became:
            self.current_child = became[now]
            return True
        earlier = [became[child] for child in before[: before.index(now)] if child in became]
        place = 1 + max((children.index(child) for child in earlier), default=-1)
        if place < len(children):
            self.current_child = children[place]
        return place < len(children)

    def redefine(self, ports: BoundPorts) -> bool:
        """Take up whether to remember."""
        self.memory = cast("Memory", ports.now()).memory
        return True
