"""Bring a declared object or arm into the running world."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Self

from pydantic import model_validator

from bt_dualarm import ArmName, Failure, ObjectName, PortModel, PoseSpec, Skill, WorldError, port


class Spawn(Skill):
    """Bring a declared object or arm into the running world; an arm's tree then starts."""

    class Ports(PortModel):
        exactly_one_of = ("object", "arm")

        object: ObjectName | None = port(None, "object to bring, declared with spawned: false")
        arm: ArmName | None = port(None, "arm to bring, declared with spawned: false")
        at: PoseSpec | None = port(None, "where the object comes, instead of its declared pose")

        @model_validator(mode="after")
        def _arms_have_their_place(self) -> Self:
            if self.arm is not None and self.at is not None:
                raise ValueError("an arm comes where its base is declared: leave out at")
            return self

    brings_in = ("object", "arm")
    failures = {
        "NOT_SPAWNED": "the world cannot take it: it or another thing is there already",
    }
    example = "spawn: {object: cube}"
    ports: Ports

    def run(self) -> Iterator[None]:
        """Place it, and look whether it is there a tick later."""
        world, ports = self.arm.world, self.ports
        try:
            if ports.object is not None:
                world.spawn_object(ports.object, ports.at.pose if ports.at else None)
            elif ports.arm is not None:
                world.spawn_arm(ports.arm)
        except WorldError as error:
            raise Failure("NOT_SPAWNED", str(error)) from error
        yield
        if ports.object not in world.objects and ports.arm not in world.arms:
            raise Failure("NOT_SPAWNED", "it is not in the world a tick after it was placed")
