"""Add a declared object or arm to the running world."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Self

from pydantic import model_validator

from bt_dualarm import ArmName, Failure, ObjectName, ObjectPose, PortModel, Skill, WorldError, port


class Spawn(Skill):
    """Add a declared object or arm to the running world; an arm's tree then starts."""

    class Ports(PortModel):
        exactly_one_of = ("object", "arm")

        object: ObjectName | None = port(None, "object to add, declared with spawned: false")
        arm: ArmName | None = port(None, "arm to add, declared with spawned: false")
        at: ObjectPose | None = port(None, "pose of the object, instead of its declared one")

        @model_validator(mode="after")
        def _arm_has_a_declared_pose(self) -> Self:
            if self.arm is not None and self.at is not None:
                raise ValueError("an arm is placed at its declared base: omit at")
            return self

    brings_in = ("object", "arm")
    failures = {
        "NOT_SPAWNED": "it is already in the world, or a part of another object, or something "
        "occupies its pose",
    }
    example = "spawn: {object: cube}"
    ports: Ports

    def run(self) -> Iterator[None]:
        """Add it, and check a tick later that it is there."""
        world = self.arm.world
        ports = self.ports
        try:
            if ports.object is not None:
                world.spawn_object(ports.object, ports.at.pose if ports.at else None)
                declared = world.declared_objects[ports.object]
                self.arm.known.put(ports.object, (ports.at or declared.pose).pose)
            elif ports.arm is not None:
                world.spawn_arm(ports.arm)
        except WorldError as error:
            raise Failure("NOT_SPAWNED", str(error)) from error
        yield
        if ports.object not in world.objects and ports.arm not in world.arms:
            raise Failure("NOT_SPAWNED", "it is not in the world a tick after it was spawned")
