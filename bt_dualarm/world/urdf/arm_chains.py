"""Chains of a URDF that could be arms: where joints follow one another without a fork."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from bt_dualarm.world.urdf.joint import Joint
from bt_dualarm.world.urdf.kinematic_tree import KinematicTree

LEAST_JOINTS: Final = 2
"""Joints of what is shown as an arm; fewer are wheels, lids and fingers."""

_ARM: Final = re.compile(r"arm|hand|wrist|elbow|gripper|tool|shoulder|ee_|tcp", re.IGNORECASE)
_LEG: Final = re.compile(
    r"leg|foot|ankle|knee|hip|wheel|head|neck|finger|thumb|little|index|middle|ring_|flex",
    re.IGNORECASE,
)
_FINGER: Final = re.compile(r"finger|jaw|gripper|mover|thumb|palm", re.IGNORECASE)
_JAW: Final = re.compile(r"finger|jaw|thumb", re.IGNORECASE)
_WRIST: Final = re.compile(r"yaw|roll|pitch|wrist", re.IGNORECASE)
_TOOLS: Final = (
    re.compile(r"tcp|tool|effector|eef|ee_|_ee$|grasp|gripper_frame", re.IGNORECASE),
    re.compile(r"tip|gripper|hand|flange", re.IGNORECASE),
)


@dataclass(frozen=True)
class ArmChain:
    """A chain that could be an arm.

    Attributes:
        base: Link that the first joint hangs on.
        tool: Link at the end.
        joints: Names of the joints that turn, base to tip.
    """

    base: str
    tool: str
    joints: tuple[str, ...]

    @property
    def rank(self) -> tuple[int, int, str]:
        """What sorts arms before legs, many joints before few."""
        words = " ".join((*self.joints, self.tool))
        likely = len(_LEG.findall(words)) - len(_ARM.findall(words))
        return (likely > 0) - (likely < 0), -len(self.joints), self.base


def arm_chains(tree: KinematicTree) -> tuple[ArmChain, ...]:
    """Chains of two joints and more, those first that are most likely arms."""
    return tuple(sorted(_segments(tree), key=lambda chain: chain.rank))


def turning_joints(tree: KinematicTree, base: str, tool: str) -> tuple[str, ...]:
    """Names of the joints between two links that could move, base to tip; none without a chain."""
    return tuple(joint.name for joint in tree.chain(base, tool) or () if joint.turns)


def _segments(tree: KinematicTree) -> Iterator[ArmChain]:
    """Chains from fork to fork, or to the end."""
    moves = _links_with_joints_below(tree)
    waiting = [(tree.root, tree.root, 0)]
    while waiting:
        start, link, turned = waiting.pop()
        further = [
            joint for joint in tree.below.get(link, ()) if joint.turns or joint.child in moves
        ]
        if len(further) == 1:
            joint = further[0]
            waiting.append((start, joint.child, turned + joint.turns))
            continue
        if turned >= LEAST_JOINTS:
            yield from _chain(tree, start, link)
        waiting += [(link, joint.child, int(joint.turns)) for joint in further]


def _chain(tree: KinematicTree, start: str, last: str) -> Iterator[ArmChain]:
    """The chain between two links, without the gripper at its end."""
    joints = [joint for joint in tree.chain(start, last) or () if joint.turns]
    while joints and _closes(joints[-1]):
        last = joints.pop().parent
    if len(joints) >= LEAST_JOINTS:
        base, tool = joints[0].parent, _tool(tree, last)
        yield ArmChain(base, tool, turning_joints(tree, base, tool))


def _closes(joint: Joint) -> bool:
    """Whether a joint moves a finger, to go by its name."""
    name = f"{joint.name} {joint.child}"
    return _FINGER.search(name) is not None and _WRIST.search(name) is None


def _links_with_joints_below(tree: KinematicTree) -> set[str]:
    """Links below which something turns."""
    found: set[str] = set()
    for link in reversed(list(tree.subtree(tree.root))):
        if any(joint.turns or joint.child in found for joint in tree.below.get(link, ())):
            found.add(link)
    return found


def _tool(tree: KinematicTree, last: str) -> str:
    """The link that its name makes the tool, of those that hang on the last one without a joint."""
    waiting, found = [last], [last]
    while waiting:
        for joint in tree.below.get(waiting.pop(), ()):
            if joint.kind == "fixed":
                waiting.append(joint.child)
                found.append(joint.child)
    for tool in _TOOLS:
        named = [link for link in found if tool.search(link) and not _JAW.search(link)]
        if named:
            return named[-1]
    return last
