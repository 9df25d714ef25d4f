"""Halting nodes, and making them forget what they said."""

from __future__ import annotations

from collections.abc import Iterable

from py_trees.behaviour import Behaviour
from py_trees.common import Status


def reset(nodes: Iterable[Behaviour]) -> None:
    """Make nodes forget what they said the last time."""
    for node in nodes:
        if node.status is not Status.INVALID:
            node.stop(Status.INVALID)


def halt_running(nodes: Iterable[Behaviour]) -> None:
    """Halt those that are running."""
    for node in nodes:
        if node.status is Status.RUNNING:
            node.stop(Status.INVALID)
