"""From a checked tree of the file to one that can be ticked."""

from __future__ import annotations

import importlib
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any, Final

from py_trees.behaviour import Behaviour

from bt_dualarm.skill import Skill, SkillContext
from bt_dualarm.spec.language import LANGUAGE
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.ports import reference_of
from bt_dualarm.tree import composites, decorators
from bt_dualarm.tree.arm_tree import ArmTree
from bt_dualarm.tree.binding import BoundPorts, Outputs
from bt_dualarm.tree.board import Board
from bt_dualarm.tree.leaf import Leaf
from bt_dualarm.tree.report import LeafReport, StatusChange
from bt_dualarm.tree.watched import Teller
from bt_dualarm.tree.words import WORDS

_OURS: Final[Mapping[str, type[composites.Node]]] = {
    "parallel": composites.Parallel,
    "if": composites.If,
    "while": composites.While,
    "guard": composites.Guard,
    "retry": decorators.Retry,
    "repeat": decorators.Repeat,
    "timeout": decorators.Timeout,
    "delay": decorators.Delay,
    "rate": decorators.Rate,
    "on_halt": decorators.OnHalt,
    "subtree": decorators.Subtree,
}
_OF_PY_TREES: Final[Mapping[str, Callable[[str, Behaviour], Behaviour]]] = {
    "inverter": decorators.Inverter,
    "force_success": decorators.ForceSuccess,
    "force_failure": decorators.ForceFailure,
    "run_once": decorators.RunOnce,
}


def build_tree(
    arm: str,
    root: NodeSpec,
    skills: Mapping[str, type[Skill]],
    make_context: Callable[[str], SkillContext],
    clock: Callable[[], float],
    on_event: Callable[[StatusChange], None],
) -> ArmTree:
    """Build one arm's tree with a blackboard of its own.

    Args:
        arm: Name of the arm.
        root: Checked by `load_tree_file` with these skills.
        skills: By name.
        make_context: What the leaf at a path is given.
        clock: Simulated time in seconds.
        on_event: Receives every change of a status.
    """
    builder = _Builder(skills, make_context, Teller(arm, clock, on_event))
    return ArmTree(builder.node(root, root.name), builder.reports)


class _Builder:
    def __init__(
        self,
        skills: Mapping[str, type[Skill]],
        make_context: Callable[[str], SkillContext],
        teller: Teller,
    ) -> None:
        self._skills = {**skills, **WORDS}
        self._make_context = make_context
        self._teller = teller
        self._board = Board()
        self.reports: list[LeafReport] = []

    def node(self, spec: NodeSpec, path: str) -> Any:
        children = [
            self.node(child, f"{path}/{name}")
            for child, name in zip(spec.children, _told_apart(spec.children), strict=True)
        ]
        node = self._inner(spec, children) if children else self._leaf(spec, path)
        node.place(self._teller, path, spec.kind)
        return node

    def _inner(self, spec: NodeSpec, children: list[Behaviour]) -> Any:
        if spec.kind in _OF_PY_TREES:
            return _OF_PY_TREES[spec.kind](spec.name, children[0])
        ports = BoundPorts(LANGUAGE[spec.kind].ports, spec.ports, self._board)
        if spec.kind in ("sequence", "selector"):
            kind = composites.Sequence if spec.kind == "sequence" else composites.Selector
            return kind(spec.name, ports.now().memory, children)
        if spec.kind == "switch":
            return composites.Switch(spec.name, children, ports.now, spec.slots)
        return _OURS[spec.kind](spec.name, children, ports.now)

    def _leaf(self, spec: NodeSpec, path: str) -> Leaf:
        skill = self._skills[spec.kind]
        given = skill.Outputs.model_fields.keys() & spec.ports.keys()
        keys = {name: key for name in given if (key := reference_of(spec.ports[name]))}
        ports = {name: value for name, value in spec.ports.items() if name not in keys}
        if spec.kind == "set":
            keys, ports = {"value": spec.ports["key"]}, dict(spec.ports)
        bound = BoundPorts(skill.Ports, ports, self._board)
        outputs = Outputs(skill.Outputs, keys, self._board)
        context = self._make_context(path)
        for module in skill.needs:
            importlib.import_module(module)

        def begin() -> Skill:
            return skill(bound.now(), context, outputs.write)

        return Leaf(spec.name, begin, context.arm.release, self.reports, context.arm.trouble)


def _told_apart(children: tuple[NodeSpec, ...]) -> list[str]:
    """Names of siblings; the second and later of equal ones are numbered."""
    seen: Counter[str] = Counter()
    names = []
    for child in children:
        seen[child.name] += 1
        count = seen[child.name]
        names.append(child.name if count == 1 else f"{child.name}#{count}")
    return names
