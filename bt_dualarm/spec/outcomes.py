"""Warnings that follow from how each node of a tree can end.

Branches that no tick can reach, leaves after a node that never ends, nodes that change nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from bt_dualarm.spec.ends import EITHER, Ends
from bt_dualarm.spec.language import LANGUAGE
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.ports import reference_of
from bt_dualarm.spec.problems import Problem
from bt_dualarm.spec.word import Word


def ends_below(root: NodeSpec) -> dict[NodeSpec, Ends]:
    """How each node of a tree can end, as far as that can be told from the file."""
    known: dict[NodeSpec, Ends] = {}
    for node in reversed(tuple(root.walk())):  # children come after their parent
        known[node] = _ends(node, [known[child] for child in node.children])
    return known


def _ends(node: NodeSpec, children: Sequence[Ends]) -> Ends:
    word = LANGUAGE.get(node.kind)
    if word is None:
        return EITHER
    reads = any(reference_of(value) for value in node.ports.values())
    if not children and (reads or not word.is_leaf or word.uses):
        return EITHER
    return word.ends(node, children)


def warnings(root: NodeSpec) -> Iterator[Problem]:
    """Everything in a tree that is allowed but can hardly be meant."""
    ends = ends_below(root)
    for node in root.walk():
        word = LANGUAGE.get(node.kind)
        if word is None:
            continue
        children = [ends[child] for child in node.children]
        found = [*_never_followed(word, node, children), *_never_chosen(word, node, children)]
        pointless = word.pointless(node, children)
        for message, where in [*found, (pointless, node)] if pointless else found:
            yield replace(where.problem(message), severity="warning")


def _never_followed(
    word: Word, node: NodeSpec, ends: Sequence[Ends]
) -> Iterator[tuple[str, NodeSpec]]:
    """The first child that no tick reaches because of one before it."""
    if word.goes_on is None:
        return
    for child, before, end in zip(node.children[1:], node.children, ends, strict=False):
        if not (end.succeeds if word.goes_on else end.fails):
            how = "always fails" if word.goes_on else "cannot fail"
            how = "never ends" if end.never else how
            yield f"no tick reaches this: '{before.name}' before it {how}", child
            return


def _never_chosen(
    word: Word, node: NodeSpec, ends: Sequence[Ends]
) -> Iterator[tuple[str, NodeSpec]]:
    """Children behind an end that the first child cannot have."""
    after = {slot.name: slot.after for slot in word.slots if slot.after is not None}
    for slot, child in zip(node.slots, node.children, strict=True):
        if slot in after and not (ends[0].succeeds if after[slot] else ends[0].fails):
            how = "never holds" if after[slot] else "always holds"
            yield f"no tick reaches this: '{node.children[0].name}' {how}", child
