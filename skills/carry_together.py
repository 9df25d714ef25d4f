"""Carry one object with two or three arms."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from typing import Annotated

from pydantic import Field

from bt_dualarm import (
    ArmName,
    Carrying,
    CarryPorts,
    Counterpart,
    Failure,
    JointPart,
    ObjectName,
    ObjectPose,
    PortModel,
    Skill,
    port,
    shared_grasp,
)

_Names = Annotated[tuple[ArmName, ...], Field(min_length=1, max_length=2)]


class _ObjectPorts(PortModel):
    at_most_one_of = ("to", "path")
    object: ObjectName = port(..., "object to carry; the file declares its shape")
    # A keyword of Python cannot be written as the name of an attribute.
    __annotations__["with"] = _Names
    vars()["with"] = port(..., "other arms that carry it, each with such a leaf of its own")
    to: ObjectPose | None = port(
        None, "goal pose of the object in the world; by default with its current orientation"
    )
    path: Annotated[tuple[ObjectPose, ...], Field(min_length=1, max_length=100)] | None = port(
        None, "poses of the object through which it is carried, the last one its goal"
    )


class CarryTogether(Skill):
    """Carry an object with other arms: grasp it, carry it as one mechanism, set it down."""

    class Ports(CarryPorts, _ObjectPorts):
        pass

    counterpart = Counterpart(
        "carry_together", partner="with", its_partner="with", by_one=("to", "path")
    )
    failures = Carrying.failures
    example = "carry_together: {object: beam, with: [arm2], to: {xyz: [0.05, -0.5, 0.525]}}"
    begins_anywhere = True
    needs = ("bt_dualarm.skill.preload_grasping",)
    needs_gripper = True
    takes_hold = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Meet the other arms, plan everything before moving, then act together."""
        arm = self.arm
        ports = self.ports
        name = ports.object
        partners: tuple[str, ...] = getattr(ports, "with")
        members = tuple(sorted({arm.name, *partners}))
        if len(members) != 1 + len(partners):
            raise Failure("INVALID_TARGET", f"`with` of {arm.name} names it, or an arm twice")
        goals = ports.path or (() if ports.to is None else (ports.to,))
        with ExitStack() as stack:
            for partner in partners:
                stack.enter_context(shared_grasp(arm, partner, name))
            label = f"the carrying of {name!r} by {' and '.join(members)}"
            joint = stack.enter_context(JointPart(self.context, label, members))
            carrying = Carrying(arm, joint, members, name, goals, ports, self.metrics)
            yield from carrying.through()
