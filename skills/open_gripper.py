"""Open the gripper."""

from __future__ import annotations

from collections.abc import Iterator

from bt_dualarm import GripForce, GripSpeed, GripWidth, PortModel, Skill, port


class OpenGripper(Skill):
    """Open the fingers to a width, or release a cup's vacuum."""

    class Ports(PortModel):
        width: GripWidth | None = port(
            None, "opening; by default the largest", unit="m", gt=0, le=1
        )
        speed: GripSpeed | None = port(
            None, "speed of the opening; by default the largest", unit="m/s", gt=0, le=2
        )
        force: GripForce | None = port(
            None,
            "largest force of each finger; by default that of the gripper",
            unit="N",
            gt=0,
            le=5000,
        )

    failures = {
        "INVALID_TARGET": "a value is beyond the gripper's range",
        "NOT_OPEN": "the fingers did not reach the opening: something blocks them",
    }
    example = "open_gripper: {width: 0.06}"
    needs_gripper = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Open, wait until the fingers are there, detach what they held."""
        gripper = self.arm.gripper
        ports = self.ports
        description = gripper.description
        # A cup releases at any width but 0.
        goal = (
            ports.width
            if ports.width is not None
            else description.stroke
            if description.fingers
            else 1.0
        )
        gripper.command(goal, ports.speed, ports.force)
        yield from gripper.until_open()
        gripper.forget_released()
        self.metrics["width_m"] = gripper.width
