"""Builds trees from checked nodes, and reloads their changed parts during a run."""

from __future__ import annotations

import importlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import TypeAlias, cast

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_dualarm.behaviors.blackboard import Blackboard, BoundPorts, Outputs
from bt_dualarm.behaviors.composites import Guard, While
from bt_dualarm.behaviors.decorators import Timeout
from bt_dualarm.behaviors.language import LEAF_CLASSES, PARENT_CLASSES
from bt_dualarm.behaviors.leaf import Leaf
from bt_dualarm.behaviors.node import (
    NAMES,
    NodeParts,
    ReportingNode,
    StatusReporter,
    detach_parent,
    reset,
)
from bt_dualarm.behaviors.report import (
    KeyWritten,
    LeafReports,
    NodeView,
    OnTraceEvent,
    PortsRead,
    StatusChange,
    StatusName,
)
from bt_dualarm.skill.cell import ActiveNode, CellAccess
from bt_dualarm.skill.skill import Skill, SkillContext
from bt_dualarm.spec.node_types import NodeSpec
from bt_dualarm.spec.ports import PortModel, reference_of, written_keys
from bt_dualarm.spec.yaml_reader import Data

TreeNode: TypeAlias = Leaf | ReportingNode
"""Node of a built tree."""


def build_tree(
    arm: str,
    root: NodeSpec,
    skills: Mapping[str, type[Skill]],
    make_context: Callable[[str], SkillContext],
    clock: Callable[[], float],
    on_event: Callable[[StatusChange], None],
    on_trace: OnTraceEvent | None = None,
    cell: CellAccess | None = None,
) -> ArmTree:
    """Builds one arm's tree with its own blackboard.

    Args:
        arm: Name of the arm.
        root: Root, checked by `load_tree_file` with these skills.
        skills: Skills by name.
        make_context: Function from the path of a leaf to the context of its skill.
        clock: Simulated time in seconds.
        on_event: Receiver of every status change.
        on_trace: Receiver of ports and keys, None if they are not recorded.
        cell: What the trees of the file share; nothing by default.
    """
    cell = cell or CellAccess.alone()
    reporter = StatusReporter(arm, clock, on_event)
    builder = _Builder(skills, make_context, reporter, on_trace, cell)
    reloading = TreeReload(builder, root)
    return ArmTree(builder.node(root, root.name), builder.reports, reloading.reload, cell)


class ArmTree:
    """Tree of one arm, which runs once.

    Args:
        root: Root with attached nodes.
        leaves: Reports that the leaves fill.
        reload: Function from the root and a changed definition to the root of the changed tree.
        cell: What the trees of the file share.

    Attributes:
        leaves: Report of each run of a leaf, in the order of their starts.
    """

    def __init__(
        self,
        root: TreeNode,
        leaves: LeafReports,
        reload: Callable[[TreeNode, NodeSpec], TreeNode],
        cell: CellAccess,
    ) -> None:
        self._cell = cell
        self._root = root
        self._reload = reload
        self.leaves = leaves

    @property
    def status(self) -> StatusName:
        """Status of the root."""
        return NAMES[self._root.status]

    def tick(self) -> None:
        """Tick once; no effect on a tree that has ended."""
        if self._root.status not in (Status.SUCCESS, Status.FAILURE):
            self._root.tick_once()

    def halt(self) -> None:
        """Halt the running nodes; no effect on a tree that has ended."""
        if self._root.status is Status.RUNNING:
            self._root.stop(Status.INVALID)

    def change(self, spec: NodeSpec) -> None:
        """Reload a changed definition between two ticks; no effect on a tree that has ended.

        Args:
            spec: Checked definition.
        """
        if self._root.status not in (Status.SUCCESS, Status.FAILURE):
            self._root = self._reload(self._root, spec)

    def view(self) -> NodeView:
        """Returns the current state of all nodes."""
        return _view(self._root, self._cell)

    def active(self) -> Iterator[ActiveNode]:
        """Yields the running nodes without running children."""
        waiting: list[tuple[TreeNode, bool]] = [(self._root, False)]
        while waiting:
            node, may_be_halted = waiting.pop()
            if node.status is not Status.RUNNING:
                continue
            running = [child for child in node.children if child.status is Status.RUNNING]
            if not running:
                yield ActiveNode(node.path, may_be_halted)
                continue
            may_be_halted = may_be_halted or _may_halt(node)
            waiting += [(cast("TreeNode", child), may_be_halted) for child in running]


def _may_halt(node: TreeNode) -> bool:
    """Returns whether a node halts running children by itself; of a parallel that is not counted.

    The other children of a parallel are active nodes of the same arm, which count by themselves.
    """
    return isinstance(node, (Timeout, Guard, While)) or getattr(node, "memory", True) is False


def _view(node: TreeNode, cell: CellAccess) -> NodeView:
    is_running = node.status is Status.RUNNING
    return NodeView(
        node.name,
        node.kind,
        NAMES[node.status],
        node.since,
        tuple(_view(cast("TreeNode", child), cell) for child in node.children),
        node.progress if isinstance(node, Leaf) else None,
        f"{node.code}: {node.reason}" if node.status is Status.FAILURE and node.code else "",
        node.halted,
        cell.shared.waiting(cell.arm, node.path) if is_running else "",
    )


class TreeReload:
    """Reloads changed definitions of one arm's tree between two of its ticks.

    Nodes with the same path and kind are the same node. A leaf with the same ports continues;
    another one is halted, and starts again when its parent ticks it. A node with children continues
    with its new children; with other ports it starts counting, or waiting, again.

    Args:
        builder: Builder of new nodes.
        spec: Definition of the current tree.
    """

    def __init__(self, builder: _Builder, spec: NodeSpec) -> None:
        self._builder = builder
        self._spec = spec

    def reload(self, root: TreeNode, now: NodeSpec) -> TreeNode:
        """Returns the root of the changed tree.

        Args:
            root: Root of the current tree.
            now: Checked definition of the changed tree.
        """
        was = self._spec
        self._spec = now
        if was.name != now.name:
            return self._replace(root, now, now.name)
        return self._node(root, was, now, now.name)

    def _node(self, old: TreeNode, was: NodeSpec, now: NodeSpec, path: str) -> TreeNode:
        if was.kind != now.kind or bool(was.children) != bool(now.children):
            return self._replace(old, now, path)
        if not isinstance(old, ReportingNode):
            return old if was.ports == now.ports else self._replace(old, now, path)
        children, became = self._children(old, was, now, path)
        continues = old.swap_children(children, now.slots, became)
        if was.ports != now.ports:
            continues = old.swap_ports(self._builder.bound(now)) and continues
        if not continues:
            reset((old,))
        return old

    def _children(
        self, old: ReportingNode, was: NodeSpec, now: NodeSpec, path: str
    ) -> tuple[list[Behaviour], dict[Behaviour, Behaviour]]:
        """Returns the new children, and the new child in the position of each old one."""
        names = zip(unique_names(was.children), old.children, was.children, strict=True)
        there = {name: (cast("TreeNode", child), spec) for name, child, spec in names}
        children: list[Behaviour] = []
        became: dict[Behaviour, Behaviour] = {}
        for spec, name in zip(now.children, unique_names(now.children), strict=True):
            below = f"{path}/{name}"
            if name in there:
                child, before = there.pop(name)
                became[child] = self._node(child, before, spec, below)
                children.append(became[child])
            else:
                children.append(self._builder.node(spec, below))
            children[-1].parent = None
        for gone, _ in there.values():
            reset((gone,))
        return children, became

    def _replace(self, old: TreeNode, now: NodeSpec, path: str) -> TreeNode:
        reset((old,))
        return self._builder.node(now, path)


class _Builder:
    """Builds nodes that share one blackboard; arguments as `build_tree`."""

    def __init__(
        self,
        skills: Mapping[str, type[Skill]],
        make_context: Callable[[str], SkillContext],
        reporter: StatusReporter,
        on_trace: OnTraceEvent | None,
        cell: CellAccess,
    ) -> None:
        self._cell = cell
        self._skills = {**skills, **LEAF_CLASSES}
        self._make_context = make_context
        self._reporter = reporter
        self._on_trace = on_trace
        self._blackboard = Blackboard()
        self.reports = LeafReports()

    def node(self, spec: NodeSpec, path: str) -> TreeNode:
        """Returns a node with its descendants, attached at a path."""
        children = tuple(
            self.node(child, f"{path}/{name}")
            for child, name in zip(spec.children, unique_names(spec.children), strict=True)
        )
        node: TreeNode
        if children:
            parts = NodeParts(spec.name, children, spec.slots, self.bound(spec), self._cell)
            node = PARENT_CLASSES[spec.kind].of(parts)
            for child in children:
                detach_parent(child)
        else:
            node = self._leaf(spec, path)
        node.attach(self._reporter, path, spec.kind)
        return node

    def bound(self, spec: NodeSpec) -> BoundPorts:
        """Returns the ports of a node with children."""
        return BoundPorts(PARENT_CLASSES[spec.kind].node_type.ports, spec.ports, self._blackboard)

    def _leaf(self, spec: NodeSpec, path: str) -> Leaf:
        skill = self._skills[spec.kind]
        outputs = skill.Outputs.model_fields.keys() - skill.Ports.model_fields.keys()
        named = {name: reference_of(spec.ports.get(name)) for name in outputs}
        keys = {name: key for name, key in named.items() if key is not None}
        ports = {name: value for name, value in spec.ports.items() if name not in keys}
        for port, output in written_keys(skill.Ports).items():
            keys[output] = spec.ports[port]
        bound = BoundPorts(skill.Ports, ports, self._blackboard)
        writer = Outputs(skill.Outputs, keys, self._blackboard, partial(self._trace_key, path))
        context = self._make_context(path)
        for module in skill.needs:
            importlib.import_module(module)

        def begin() -> Skill:
            now = bound.now()
            self._trace_ports(path, now)
            return skill(now, context, writer.write)

        return Leaf(spec.name, begin, context.arm, self.reports)

    def _trace_ports(self, path: str, ports: PortModel) -> None:
        if self._on_trace is not None:
            time = self._reporter.clock()
            arm = self._reporter.arm
            self._on_trace(PortsRead(time, arm, path, ports.model_dump(mode="json")))

    def _trace_key(self, path: str, key: str, value: Data) -> None:
        if self._on_trace is not None:
            time = self._reporter.clock()
            arm = self._reporter.arm
            self._on_trace(KeyWritten(time, arm, path, key, value))


def unique_names(children: Sequence[NodeSpec]) -> list[str]:
    """Returns the names of siblings; the second and later of equal ones are numbered."""
    seen: Counter[str] = Counter()
    names = []
    for child in children:
        seen[child.name] += 1
        count = seen[child.name]
        names.append(child.name if count == 1 else f"{child.name}#{count}")
    return names
