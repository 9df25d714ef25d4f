"""Remove an object or another arm from the running world."""

from __future__ import annotations

from collections.abc import Iterator

from bt_dualarm import ArmName, Failure, ObjectName, PortModel, Skill, WorldError, port


class Remove(Skill):
    """Remove an object or another arm from the running world; objects that the arm held fall."""

    class Ports(PortModel):
        exactly_one_of = ("object", "arm")

        object: ObjectName | None = port(None, "object to remove, even if an arm holds it")
        arm: ArmName | None = port(None, "arm to remove; its tree ends as removed")

    takes_out = ("object", "arm")
    failures = {
        "INVALID_TARGET": "an arm does not remove itself",
        "NOT_REMOVED": "it is not in the world, or a part of another object",
    }
    example = "remove: {object: cube}"
    ports: Ports

    def run(self) -> Iterator[None]:
        """Remove it, and check a tick later that it is gone."""
        world = self.arm.world
        ports = self.ports
        if ports.arm == self.arm.name:
            raise Failure("INVALID_TARGET", f"{self.arm.name} cannot remove itself")
        try:
            if ports.object is not None:
                world.remove_object(ports.object)
                self.arm.known.forget(ports.object, "it was removed")
            elif ports.arm is not None:
                world.remove_arm(ports.arm)
        except WorldError as error:
            raise Failure("NOT_REMOVED", str(error)) from error
        yield
        if ports.object in world.objects or ports.arm in world.arms:
            raise Failure("NOT_REMOVED", "it is still in the world a tick later")
