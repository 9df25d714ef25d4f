"""Open the gripper."""

from __future__ import annotations

from collections.abc import Iterator

from bt_dualarm import GripForce, GripSpeed, GripWidth, PortModel, Skill, port


class OpenGripper(Skill):
    """Open the gripper as wide as it was told, or let a cup's vacuum go."""

    class Ports(PortModel):
        width: GripWidth | None = port(
            None, "opening to go to; by default all of it", unit="m", gt=0, le=1
        )
        speed: GripSpeed | None = port(
            None, "speed of the fingers together; by default the fastest", unit="m/s", gt=0, le=2
        )
        force: GripForce | None = port(
            None, "most force of each finger; by default the most", unit="N", gt=0, le=5000
        )

    failures = {
        "INVALID_TARGET": "the gripper cannot do what it is asked for",
        "NOT_OPEN": "the fingers did not get there: something is in their way",
    }
    example = "open_gripper: {width: 0.06}"
    needs_gripper = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Open, wait until the fingers are there; what they held they hold no more."""
        gripper, ports = self.arm.gripper, self.ports
        page = gripper.page
        goal = ports.width if ports.width is not None else page.stroke if page.fingers else 1.0
        gripper.command(goal, ports.speed, ports.force)
        yield from gripper.until_open()
        gripper.forget_released()
        self.metrics["width_m"] = gripper.width
