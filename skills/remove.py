"""Take an object or another arm out of the running world."""

from __future__ import annotations

from collections.abc import Iterator

from bt_dualarm import ArmName, Failure, ObjectName, PortModel, Skill, WorldError, port


class Remove(Skill):
    """Take an object or another arm out of the running world; what that arm held falls."""

    class Ports(PortModel):
        exactly_one_of = ("object", "arm")

        object: ObjectName | None = port(None, "object to take away, out of any arm's hold")
        arm: ArmName | None = port(None, "arm to take away; its tree ends as removed")

    failures = {
        "INVALID_TARGET": "an arm does not remove itself",
        "NOT_REMOVED": "it is not in the world",
    }
    example = "remove: {object: cube}"
    ports: Ports

    def run(self) -> Iterator[None]:
        """Take it away, and look whether it is gone a tick later."""
        world, ports = self.arm.world, self.ports
        if ports.arm == self.arm.name:
            raise Failure("INVALID_TARGET", f"{self.arm.name} cannot remove itself")
        try:
            if ports.object is not None:
                world.remove_object(ports.object)
            elif ports.arm is not None:
                world.remove_arm(ports.arm)
        except WorldError as error:
            raise Failure("NOT_REMOVED", str(error)) from error
        yield
        if ports.object in world.objects or ports.arm in world.arms:
            raise Failure("NOT_REMOVED", "it is still in the world a tick later")
