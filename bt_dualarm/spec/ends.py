"""How a node can end, as far as that can be told from the file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

from bt_dualarm.spec.node import NodeSpec


@dataclass(frozen=True)
class Ends:
    """How a node can end; one that can do neither never ends."""

    succeeds: bool = True
    fails: bool = True

    @property
    def never(self) -> bool:
        """Whether it goes on until it is halted."""
        return not (self.succeeds or self.fails)


EITHER: Final = Ends()
SUCCESS: Final = Ends(fails=False)
FAILURE: Final = Ends(succeeds=False)

EndsRule: TypeAlias = Callable[[NodeSpec, Sequence[Ends]], Ends]
"""How a node can end, given how each of its children can, in the order of the file."""


def either(_: NodeSpec, _ends: Sequence[Ends]) -> Ends:
    """The rule of what may succeed and may fail."""
    return EITHER


def success(_: NodeSpec, _ends: Sequence[Ends]) -> Ends:
    """The rule of what cannot fail."""
    return SUCCESS


def failure(_: NodeSpec, _ends: Sequence[Ends]) -> Ends:
    """The rule of what cannot succeed."""
    return FAILURE


def as_child(_: NodeSpec, ends: Sequence[Ends]) -> Ends:
    """The rule of what ends as its first child does."""
    return ends[0]
