"""One arm's tree, built: ticked by the runner, looked at by the display."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias, cast

from py_trees.common import Status

from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.tree.leaf import Leaf
from bt_dualarm.tree.leaf_reports import LeafReports
from bt_dualarm.tree.report import NodeView, StatusName
from bt_dualarm.tree.watched import NAMES, Watched

TreeNode: TypeAlias = Leaf | Watched
"""Every node of a built tree is one of these."""


class ArmTree:
    """A tree that runs once.

    Args:
        root: Top node; all nodes have their places.
        leaves: Reports that the leaves fill.
        graft: Function that makes of the top node, and another definition, that of a changed tree.

    Attributes:
        leaves: Report of each run of a leaf, in the order of their starts.
    """

    def __init__(
        self,
        root: TreeNode,
        leaves: LeafReports,
        graft: Callable[[TreeNode, NodeSpec], TreeNode],
    ) -> None:
        self._root, self._graft = root, graft
        self.leaves = leaves

    @property
    def status(self) -> StatusName:
        """Status of the root."""
        return NAMES[self._root.status]

    def tick(self) -> None:
        """Tick once; a tree that has ended stays as it is."""
        if self._root.status not in (Status.SUCCESS, Status.FAILURE):
            self._root.tick_once()

    def halt(self) -> None:
        """Halt whatever is running; a tree that has ended stays as it is."""
        if self._root.status is Status.RUNNING:
            self._root.stop(Status.INVALID)

    def change(self, spec: NodeSpec) -> None:
        """Be another tree from now on, between two ticks; one that has ended stays as it is.

        Args:
            spec: Its definition, checked.
        """
        if self._root.status not in (Status.SUCCESS, Status.FAILURE):
            self._root = self._graft(self._root, spec)

    def view(self) -> NodeView:
        """As it stands now."""
        return _view(self._root)


def _view(node: TreeNode) -> NodeView:
    return NodeView(
        node.name,
        node.kind,
        NAMES[node.status],
        node.since,
        tuple(_view(cast("TreeNode", child)) for child in node.children),
        node.progress if isinstance(node, Leaf) else None,
        f"{node.code}: {node.reason}" if node.status is Status.FAILURE and node.code else "",
        node.halted,
    )
