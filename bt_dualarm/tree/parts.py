"""What a node with children is made of."""

from __future__ import annotations

from dataclasses import dataclass

from py_trees.behaviour import Behaviour

from bt_dualarm.tree.binding import BoundPorts


@dataclass(frozen=True)
class Parts:
    """All that the class of a node needs to make one.

    Attributes:
        name: Name that people are shown.
        children: Nodes below it, at least one, in the order of the file.
        slots: Role of each child for the node: ``child``, ``condition``, a case, …
        ports: Its ports, bound to the arm's blackboard.
    """

    name: str
    children: tuple[Behaviour, ...]
    slots: tuple[str, ...]
    ports: BoundPorts
