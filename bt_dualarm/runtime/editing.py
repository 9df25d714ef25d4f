"""A run whose file is edited while it goes on: trees are taken up, nothing else can change."""

from __future__ import annotations

from collections.abc import Iterator

from bt_dualarm.errors import RunError
from bt_dualarm.runtime.history_start import tree_facts
from bt_dualarm.runtime.run import Run
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.node import NodeSpec


def take_up(run: Run, before: TreeFile, now: TreeFile) -> list[str]:
    """Give the arms of a run the trees of an edited file, between two steps.

    Leaves whose path, kind and ports are the same go on; others that run are halted, and begin
    anew. Trees that have ended stay as they are.

    Args:
        run: The run.
        before: The file as it was checked and taken up last.
        now: The file as it is, checked with the same skills.

    Returns:
        Sentences on what became of each tree that is another.

    Raises:
        RunError: More than trees has been changed; nothing is taken up.
    """
    other = [*_others(before, now)]
    if other:
        raise RunError(
            f"{', '.join(other)}: while a run goes on, only trees can be changed; start it anew"
        )
    present = {arm.name: arm for arm in run.assembly.arms.present}
    said = []
    for name, arm in now.arms.items():
        if same(before.arms[name].tree, arm.tree):
            continue
        run.assembly.trees[name] = arm.tree
        if name not in present:
            said.append(f"{name}: the tree that it will begin with is another")
            continue
        with run.watchdog:
            taken = present[name].change(arm.tree, run.time)
        said.append(f"{name}: {'the tree is another' if taken else 'its tree has ended'}")
        if taken and run.kept is not None:
            run.kept.notes.of_edit(name, tree_facts(arm.tree))
    return said


def same(one: NodeSpec, other: NodeSpec) -> bool:
    """Whether two trees say the same."""
    alike = (one.kind, one.name, one.ports, one.slots) == (
        other.kind,
        other.name,
        other.ports,
        other.slots,
    )
    return (
        alike
        and len(one.children) == len(other.children)
        and all(map(same, one.children, other.children))
    )


def _others(before: TreeFile, now: TreeFile) -> Iterator[str]:
    """What has been changed besides trees."""
    if before.world != now.world:
        yield "world"
    if before.objects != now.objects:
        yield "objects"
    if [*before.arms] != [*now.arms]:
        yield "arms"
        return
    for name, arm in now.arms.items():
        if before.arms[name].model_copy(update={"tree": arm.tree}) != arm:
            yield f"arms.{name}"
