"""From a checked tree of the file to one that can be ticked."""

from __future__ import annotations

import importlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from types import ModuleType
from typing import Final

from py_trees.behaviour import Behaviour

from bt_dualarm.skill.skill import Skill, SkillContext
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.ports import PortModel, reference_of, written_keys
from bt_dualarm.spec.source import Data
from bt_dualarm.tree import composites, decorators, words
from bt_dualarm.tree.arm_tree import ArmTree, TreeNode
from bt_dualarm.tree.binding import BoundPorts, Outputs
from bt_dualarm.tree.board import Board
from bt_dualarm.tree.forgetful import forget_parent
from bt_dualarm.tree.grafting import Grafting
from bt_dualarm.tree.leaf import Leaf
from bt_dualarm.tree.leaf_reports import LeafReports
from bt_dualarm.tree.notes import KeyWritten, OnNote, PortsRead
from bt_dualarm.tree.parts import Parts
from bt_dualarm.tree.report import StatusChange
from bt_dualarm.tree.watched import Teller, Watched
from bt_dualarm.tree.words import WordSkill


def _ticking(*modules: ModuleType) -> Iterator[type]:
    """The classes in some modules that name a word of the language as their own."""
    for module in modules:
        for item in vars(module).values():
            if isinstance(item, type) and "word" in vars(item):
                yield item


INNER: Final[Mapping[str, type[Watched]]] = {
    item.word.name: item for item in _ticking(composites, decorators) if issubclass(item, Watched)
}
"""Classes of the nodes with children, by word."""

LEAVES: Final[Mapping[str, type[WordSkill]]] = {
    item.word.name: item for item in _ticking(words) if issubclass(item, WordSkill)
}
"""Classes of the language's leaves, by word."""


def build_tree(
    arm: str,
    root: NodeSpec,
    skills: Mapping[str, type[Skill]],
    make_context: Callable[[str], SkillContext],
    clock: Callable[[], float],
    on_event: Callable[[StatusChange], None],
    on_note: OnNote | None = None,
) -> ArmTree:
    """Build one arm's tree with a blackboard of its own.

    Args:
        arm: Name of the arm.
        root: Top node, checked by `load_tree_file` with these skills.
        skills: Skills by name.
        make_context: Maker of what the leaf at a path is given.
        clock: Simulated time in seconds.
        on_event: Receiver of every change of a status.
        on_note: Receiver of ports and keys, None where nobody asks for them.
    """
    builder = _Builder(skills, make_context, Teller(arm, clock, on_event), on_note)
    grafting = Grafting(builder, root, told_apart)
    return ArmTree(builder.node(root, root.name), builder.reports, grafting.grafted)


class _Builder:
    def __init__(
        self,
        skills: Mapping[str, type[Skill]],
        make_context: Callable[[str], SkillContext],
        teller: Teller,
        on_note: OnNote | None,
    ) -> None:
        self._skills = {**skills, **LEAVES}
        self._make_context = make_context
        self._teller = teller
        self._on_note = on_note
        self._board = Board()
        self.reports = LeafReports()

    def node(self, spec: NodeSpec, path: str) -> TreeNode:
        children = tuple(
            self.node(child, f"{path}/{name}")
            for child, name in zip(spec.children, told_apart(spec.children), strict=True)
        )
        node = self._inner(spec, children) if children else self._leaf(spec, path)
        node.place(self._teller, path, spec.kind)
        return node

    def bound(self, spec: NodeSpec) -> BoundPorts:
        return BoundPorts(INNER[spec.kind].word.ports, spec.ports, self._board)

    def _inner(self, spec: NodeSpec, children: tuple[Behaviour, ...]) -> Watched:
        kind = INNER[spec.kind]
        node = kind.of(Parts(spec.name, children, spec.slots, self.bound(spec)))
        for child in children:
            forget_parent(child)
        return node

    def _leaf(self, spec: NodeSpec, path: str) -> Leaf:
        skill = self._skills[spec.kind]
        given = skill.Outputs.model_fields.keys() - skill.Ports.model_fields.keys()
        named = {name: reference_of(spec.ports.get(name)) for name in given}
        keys = {name: key for name, key in named.items() if key is not None}
        ports = {name: value for name, value in spec.ports.items() if name not in keys}
        for port, output in written_keys(skill.Ports).items():
            keys[output] = spec.ports[port]
        bound = BoundPorts(skill.Ports, ports, self._board)
        outputs = Outputs(skill.Outputs, keys, self._board, partial(self._wrote, path))
        context = self._make_context(path)
        for module in skill.needs:
            importlib.import_module(module)

        def begin() -> Skill:
            now = bound.now()
            self._began(path, now)
            return skill(now, context, outputs.write)

        return Leaf(spec.name, begin, context.arm, self.reports)

    def _began(self, path: str, ports: PortModel) -> None:
        if self._on_note is not None:
            time, arm = self._teller.clock(), self._teller.arm
            self._on_note(PortsRead(time, arm, path, ports.model_dump(mode="json")))

    def _wrote(self, path: str, key: str, value: Data) -> None:
        if self._on_note is not None:
            time, arm = self._teller.clock(), self._teller.arm
            self._on_note(KeyWritten(time, arm, path, key, value))


def told_apart(children: Sequence[NodeSpec]) -> list[str]:
    """Names of siblings; the second and later of equal ones are numbered."""
    seen: Counter[str] = Counter()
    names = []
    for child in children:
        seen[child.name] += 1
        count = seen[child.name]
        names.append(child.name if count == 1 else f"{child.name}#{count}")
    return names
