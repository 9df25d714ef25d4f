"""What a tree notes besides its statuses: ports as a leaf began with them, keys written."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from bt_dualarm.spec.source import Data


@dataclass(frozen=True)
class PortsRead:
    """A leaf began with these values.

    Attributes:
        time: Simulated time in seconds.
        arm: Name of the arm whose tree it is.
        path: Path of the leaf, as in `StatusChange`.
        ports: Values of all ports, in YAML's notation; references are looked up.
    """

    time: float
    arm: str
    path: str
    ports: Mapping[str, Data]


@dataclass(frozen=True)
class KeyWritten:
    """A leaf wrote a key of its arm's blackboard.

    Attributes:
        time: Simulated time in seconds.
        arm: Name of the arm whose blackboard it is.
        path: Path of the leaf.
        key: Name of the key.
        value: Value in YAML's notation.
    """

    time: float
    arm: str
    path: str
    key: str
    value: Data


TreeNote: TypeAlias = PortsRead | KeyWritten

OnNote: TypeAlias = Callable[[TreeNote], None]
"""Receiver of notes, in the order in which things happen."""
