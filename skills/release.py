"""Release what the gripper holds."""

from __future__ import annotations

from collections.abc import Iterator

from bt_dualarm import Duration, GripSpeed, PortModel, Skill, port


class Release(Skill):
    """Release what the gripper holds by opening it a little; what is attached stays attached."""

    class Ports(PortModel):
        width: float = port(0.01, "increase of the opening", unit="m", gt=0, le=0.5)
        speed: GripSpeed | None = port(
            None, "speed of the opening; by default the largest", unit="m/s", gt=0, le=2
        )
        settle: Duration = port(0.1, "time for which it must stay open before it succeeds", le=10)

    failures = {
        "INVALID_TARGET": "a value is beyond the gripper's range",
        "NOT_OPEN": "the fingers did not open",
    }
    example = "release: {width: 0.02}"
    needs_gripper = True
    lets_go = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Open a little, or release the vacuum, and verify that nothing is held any more."""
        gripper = self.arm.gripper
        description = gripper.description
        goal = (
            min(gripper.width + self.ports.width, description.stroke)
            if description.fingers
            else 1.0
        )
        gripper.command(goal, self.ports.speed)
        yield from gripper.until_open(self.ports.settle)
        gripper.forget_released()
        if self.arm.controller.compliance.active:
            # Compliant since a contact, it may have moved as the contact force ended.
            yield from self.arm.settle()
        self.metrics["width_m"] = gripper.width
