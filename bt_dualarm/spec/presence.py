"""Warnings of things that a tree names but that nothing brings into the world."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from bt_dualarm.spec.check import Declared, refers_of
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.kind import Kind
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.ports import reference_of
from bt_dualarm.spec.problems import Problem
from bt_dualarm.spec.source import Source


def absent(file: TreeFile, source: Source, kinds: Mapping[str, Kind]) -> Iterator[Problem]:
    """Warn of objects that are used and arms that are declared, but never spawned.

    Args:
        file: The file; all its trees count, as an arm may spawn what another one uses.
        source: The file as it was read.
        kinds: Kinds of node by name: the language's words and the skills.
    """
    nodes = [node for arm in file.arms.values() for node in arm.tree.walk()]
    named = [
        node.ports.get(port)
        for node in nodes
        if node.kind in kinds
        for port in kinds[node.kind].brings_in
    ]
    if any(reference_of(value) for value in named):
        return  # what is spawned is known only when it happens
    spawned = {value for value in named if isinstance(value, str)}
    objects = {name for name, item in file.objects.items() if not item.spawned} - spawned
    arms = {name for name, item in file.arms.items() if not item.spawned} - spawned
    for arm in sorted(arms):
        message = f"arm '{arm}' has spawned: false and no leaf spawns it: its tree never starts"
        yield replace(source.problem(("arms", arm), message, key=True), severity="warning")
    waiting = Declared({"object": frozenset(objects), "arm": frozenset(arms)})
    for node in nodes:
        if node.kind in kinds:
            yield from _uses_of(node, kinds[node.kind], waiting)


def _uses_of(node: NodeSpec, kind: Kind, waiting: Declared) -> Iterator[Problem]:
    for port, field in kind.ports.model_fields.items():
        refers, value = refers_of(field), node.ports.get(port)
        if refers and isinstance(value, str) and value in waiting.of(refers.to):
            message = f"{node.kind}: '{value}' has spawned: false and no leaf spawns it"
            yield replace(node.port_problem((port,), message), severity="warning")
