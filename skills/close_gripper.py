"""Close the gripper until it holds something or is at the commanded opening."""

from __future__ import annotations

from collections.abc import Iterator

from bt_dualarm import (
    Duration,
    Failure,
    GripForce,
    GripSpeed,
    GripWidth,
    ObjectName,
    ObjectPose,
    PortModel,
    Pose,
    Skill,
    port,
)


class CloseGripper(Skill):
    """Close the fingers, or apply the vacuum of a cup, and hold the object."""

    class Ports(PortModel):
        width: GripWidth = port(
            0.0, "opening to close to; 0 to close completely", unit="m", ge=0, le=1
        )
        speed: GripSpeed | None = port(
            None, "speed of the opening; by default the largest", unit="m/s", gt=0, le=2
        )
        force: GripForce | None = port(
            None, "force of each pad, or of a cup; by default the largest", unit="N", gt=0, le=5000
        )
        object: ObjectName | None = port(
            None, "object between the fingers; the arm then assumes that it moves with the tool"
        )
        at: ObjectPose | None = port(
            None, "estimated pose of that object; by default its true pose"
        )
        empty: bool = port(False, "whether to succeed even if nothing is between the fingers")
        settle: Duration = port(0.2, "time for which the hold must last before it succeeds", le=10)

    failures = {
        "EMPTY": "nothing is between the fingers, or the cup does not seal",
        "INVALID_TARGET": "a value is beyond the gripper's range, or the object is fixed",
        "NOT_THERE": "the object is not in the world",
        "NOT_CLOSED": "the fingers did not come to rest",
        "GRIPPER_FULL": "the gripper holds an object other than the named one",
        "WRONG_OBJECT": "the named object is elsewhere, or not as wide as what is held",
    }
    example = "close_gripper: {force: 40}"
    needs_gripper = True
    takes_hold = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Close, wait until the fingers are at rest, and verify that they keep holding."""
        gripper = self.arm.gripper
        ports = self.ports
        if ports.object is not None:
            self._refuse_other_held(ports.object)
        pose = self._estimated_pose()
        gripper.command(ports.width, ports.speed, ports.force)
        began = self.time
        travel = max(gripper.width - ports.width, 0.0)
        latest = began + 1.0 + 2.0 * travel / max(gripper.commanded.speed, 1e-3) + ports.settle
        held_since: float | None = None
        while True:
            yield min((self.time - began) / (latest - began), 1.0)
            done = gripper.holding or (ports.empty and self._closed())
            held_since = None if not done else self.time if held_since is None else held_since
            if held_since is not None and self.time - held_since >= ports.settle:
                break
            if self.time > latest:
                self._refuse()
        self.metrics["width_m"] = gripper.width
        self.metrics["force_n"] = gripper.force
        if not gripper.holding:
            gripper.forget_lost()
        elif ports.object is not None and pose is not None:
            self._attach(ports.object, pose)

    def _refuse_other_held(self, name: str) -> None:
        """An object that is already held may be named now, but not renamed."""
        gripper = self.arm.gripper
        gripper.forget_lost()
        if gripper.held and gripper.held != (name,):
            gripper.refuse_other(name)

    def _attach(self, name: str, before: Pose) -> None:
        """Attach the named object in the nominal model, if its pose and width fit what is held."""
        gripper = self.arm.gripper
        ports = self.ports
        world = self.arm.world
        estimate = before if ports.at is not None else world.object_pose(name)
        why_not = gripper.why_not(name, estimate)
        if why_not is not None:
            raise Failure("WRONG_OBJECT", why_not, width_m=gripper.width)
        meant = gripper.meant_around(name, before)
        gripper.hold(name, gripper.between_the_pads(before, meant))

    def _estimated_pose(self) -> Pose | None:
        """Estimated pose of the named object before the fingers touch it."""
        name = self.ports.object
        world = self.arm.world
        if name is None:
            return None
        if world.objects[name].fixed:
            raise Failure("INVALID_TARGET", world.fixed_reason(name))
        return world.object_pose(name) if self.ports.at is None else self.ports.at.pose

    def _closed(self) -> bool:
        gripper = self.arm.gripper
        goal = max(self.ports.width, gripper.closed_width)
        return gripper.at_rest and gripper.width <= goal + gripper.description.resolution + 1e-3

    def _refuse(self) -> None:
        gripper = self.arm.gripper
        numbers = {"width_m": gripper.width, "force_n": gripper.force}
        if not gripper.description.fingers:
            raise Failure("EMPTY", "the cup does not seal", vacuum=gripper.vacuum)
        if self._closed():
            raise Failure("EMPTY", "the fingers closed on nothing", **numbers)
        raise Failure("NOT_CLOSED", "the fingers did not come to rest on anything", **numbers)
