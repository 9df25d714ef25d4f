"""Bring a declared object or arm into the running world."""

from __future__ import annotations

from collections.abc import Iterator

from bt_dualarm import ArmName, Failure, ObjectName, PortModel, PoseSpec, Skill, WorldError, port


class Spawn(Skill):
    """Bring a declared object or arm into the running world; an arm's tree then starts."""

    class Ports(PortModel):
        object: ObjectName | None = port(None, "object to bring, declared with spawned: false")
        arm: ArmName | None = port(None, "arm to bring, declared with spawned: false")
        at: PoseSpec | None = port(None, "where the object comes, instead of its declared pose")

    failures = {
        "INVALID_TARGET": "not exactly one of object and arm was given, or a place for an arm",
        "NOT_SPAWNED": "the world cannot take it: it or another thing is there already",
    }
    example = "spawn: {object: cube}"
    ports: Ports

    def run(self) -> Iterator[None]:
        """Place it, and look whether it is there a tick later."""
        world, ports = self.arm.world, self.ports
        if (ports.object is None) == (ports.arm is None):
            raise Failure("INVALID_TARGET", "give either an object or an arm to spawn")
        if ports.arm is not None and ports.at is not None:
            raise Failure("INVALID_TARGET", "an arm comes where its base is declared: leave out at")
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
