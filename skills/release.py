"""Let go of what the gripper holds."""

from __future__ import annotations

from collections.abc import Iterator

from bt_dualarm import Duration, GripSpeed, PortModel, Skill, port


class Release(Skill):
    """Let go of what the gripper holds, opening no wider than it has to."""

    class Ports(PortModel):
        width: float = port(
            0.01, "how much wider than now the fingers open", unit="m", gt=0, le=0.5
        )
        speed: GripSpeed | None = port(
            None, "speed of the fingers together; by default the fastest", unit="m/s", gt=0, le=2
        )
        settle: Duration = port(0.1, "how long nothing may be held afterwards", le=10)

    failures = {
        "INVALID_TARGET": "the gripper cannot do what it is asked for",
        "NOT_OPEN": "the fingers did not come apart",
    }
    example = "release: {width: 0.02}"
    needs_gripper = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Open by a little, or let the vacuum go, and see that nothing presses any more."""
        gripper, page = self.arm.gripper, self.arm.gripper.page
        goal = min(gripper.width + self.ports.width, page.stroke) if page.fingers else 1.0
        gripper.command(goal, self.ports.speed)
        yield from gripper.until_open(self.ports.settle)
        gripper.forget_released()
        self.metrics["width_m"] = gripper.width
