"""What the leaves of a file ask of its grippers, held against their pages."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from bt_dualarm.spec.annotations import metadata_of
from bt_dualarm.spec.document import ArmSpec
from bt_dualarm.spec.goals import OfGripper
from bt_dualarm.spec.kind import Kind
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.ports import reference_of
from bt_dualarm.spec.problems import Problem
from bt_dualarm.world.grippers.gripper import Gripper, Span
from bt_dualarm.world.grippers.named import gripper_names

_UNITS = {"width": "m", "speed": "m/s", "force": "N"}


def gripper_problems(
    arm: str, spec: ArmSpec, gripper: Gripper | None, kinds: Mapping[str, Kind]
) -> Iterator[Problem]:
    """Leaves that need a gripper where there is none, or more than the gripper can do.

    Args:
        arm: Name of the arm.
        spec: What the file says of it.
        gripper: Its gripper; None where it has none, or none that could be read.
        kinds: Kinds of all nodes, by name.
    """
    for node in spec.tree.walk():
        kind = kinds.get(node.kind)
        if kind is None:
            continue
        if kind.needs_gripper and spec.gripper is None:
            known = ", ".join(gripper_names())
            hint = f"give {arm} one: gripper: NAME ({known})"
            yield node.problem(f"{node.kind}: {arm} has no gripper", hint)
        elif gripper is not None:
            yield from _beyond(node, kind, gripper)


def _beyond(node: NodeSpec, kind: Kind, gripper: Gripper) -> Iterator[Problem]:
    """Numbers that are written out and beyond the limits of the gripper's page."""
    for port, declared in kind.ports.model_fields.items():
        asked, value = metadata_of(declared, OfGripper), node.ports.get(port)
        if asked is None or value is None or reference_of(value) is not None:
            continue
        span = _limits(gripper, asked.what)
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if span is not None and is_number and not span.least <= value <= span.most:
            unit = _UNITS[asked.what]
            message = f"{node.kind}: {port}: {gripper.name} cannot do {value:g} {unit}"
            hint = f"its {asked.what} is {span.least:g} to {span.most:g} {unit}"
            yield node.port_problem((port,), message, hint)


def _limits(gripper: Gripper, what: str) -> Span | None:
    """What a gripper can be asked for; None where that means nothing to it, as a cup's width."""
    if what == "force":
        return gripper.force
    if not gripper.fingers:
        return None
    return gripper.speed if what == "speed" else Span(0.0, gripper.stroke)
