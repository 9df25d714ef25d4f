"""Release an attached object."""

from __future__ import annotations

from collections.abc import Iterator

from bt_dualarm import (
    Duration,
    Failure,
    LeftStanding,
    ObjectName,
    PortModel,
    Skill,
    is_tied_to,
    port,
    stands_without,
)


class Detach(Skill):
    """Release an attached object and verify that it comes to rest there."""

    class Ports(PortModel):
        object: ObjectName = port(..., "object to release; not a failure if it is not held")
        tolerance: float = port(
            0.01, "largest motion while it comes to rest", unit="m", ge=1e-3, le=1.0
        )
        settle: Duration = port(2.0, "longest time to come to rest", gt=0, le=30)

    failures = {
        "NOT_THERE": "the object is not in the world",
        "NOT_AT_REST": "the object fell, slid or still moves",
        "STILL_HELD": "a gripper holds the object, or it sticks to the tool and would move along",
    }
    example = "detach: {object: cube}"
    ports: Ports

    def run(self) -> Iterator[float]:
        """Release, then watch the object until it rests."""
        world = self.arm.world
        name = self.ports.object
        if name not in self.arm.held:
            # What a joint of an object moves is held under a name of its own: `door.hinge`.
            name = next((part for part in self.arm.held if world.moves_on(part, name)), name)
        held = world.attachments.find(self.arm.name, name)
        if held is not None and held.by_gripper and self.arm.gripper.holding:
            raise Failure(
                "STILL_HELD",
                f"the gripper holds {name!r}: `release`, `open_gripper` or `place` releases it",
            )
        left_at = world.object_pose(name)
        self.arm.detach(name)
        left = LeftStanding(self.arm, name)
        yield from left.until_rest(self.ports.settle)
        if name in self.arm.held:
            raise Failure("NOT_AT_REST", f"{name!r} was attached again")
        moved = left.pose.distance(left_at)
        self.metrics["moved_m"] = moved
        if moved > self.ports.tolerance or not left.rests:
            raise Failure(
                "NOT_AT_REST",
                f"{name!r} moved {1000 * moved:.1f} mm after its release"
                + ("" if left.rests else f", and still moves after {self.ports.settle:g} s"),
                moved_m=moved,
            )
        if not stands_without(self.arm, name):
            raise Failure(
                "STILL_HELD", f"{name!r} is still attached to the tool: nothing else supports it"
            )
        if is_tied_to(self.arm, name):
            raise Failure("STILL_HELD", f"{name!r} is supported, but sticks to the tool")
