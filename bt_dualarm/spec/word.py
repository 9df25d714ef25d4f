"""One word of the tree language: all that the check, the schema, the docs and a tree need of it.

A word is defined once, in `composite_words`, `decorator_words` or `leaf_words`; the class in
``bt_dualarm.tree`` that ticks it names that definition as its ``word``. Nothing else knows a word.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

from bt_dualarm.spec.ends import Ends, EndsRule, either
from bt_dualarm.spec.kind import Kind
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.problems import Problem

Complaint: TypeAlias = Callable[[NodeSpec], Iterator[Problem]]
"""Everything wrong with a node that the types of its ports cannot say."""

Pointless: TypeAlias = Callable[[NodeSpec, Sequence[Ends]], str]
"""Why a node does nothing, given how each of its children can end; empty if it does something."""


def nothing_wrong(_: NodeSpec) -> Iterator[Problem]:
    """A `Complaint` that has none."""
    yield from ()


def _never(_: NodeSpec) -> bool:
    return False


def _useful(_: NodeSpec, _ends: Sequence[Ends]) -> str:
    return ""


@dataclass(frozen=True, kw_only=True)
class Word(Kind):
    """A word of the language.

    Attributes:
        ends: Rule of how a node can end.
        goes_on: Whether a child that succeeds (True) or one that fails (False) is followed by the
            next; None where children do not follow each other.
        revisits: Whether a node may tick a child after one that comes later in the file.
        complaint: Rule of what is wrong with a node beyond the types of its ports.
        pointless: Rule of when a node does nothing.
        synonyms: Names in other libraries of behaviour trees, each with what to write here besides
            the word, ``memory: false``, or nothing.
    """

    ends: EndsRule = either
    goes_on: bool | None = None
    revisits: Callable[[NodeSpec], bool] = _never
    complaint: Complaint = nothing_wrong
    pointless: Pointless = _useful
    synonyms: Mapping[str, str] = field(default_factory=dict)
