"""Let go of what the gripper holds."""

from __future__ import annotations

from collections.abc import Iterator

from bt_dualarm import Duration, Failure, GripSpeed, PortModel, Skill, port


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
        start = gripper.width
        goal = min(start + self.ports.width, page.stroke) if page.fingers else 1.0
        gripper.command(goal, self.ports.speed)
        for thing in gripper.held:
            gripper.let_go(thing)
        began = self.time
        way = max(goal - start, 0.0) if page.fingers else 0.0
        latest = began + 1.0 + 2.0 * way / max(gripper.commanded.speed, 1e-3) + self.ports.settle
        free_since: float | None = None
        while free_since is None or self.time - free_since < self.ports.settle:
            yield min((self.time - began) / (latest - began), 1.0)
            free = self._is_free(goal)
            free_since = None if not free else self.time if free_since is None else free_since
            if self.time > latest:
                raise Failure(
                    "NOT_OPEN",
                    f"the fingers stand {1e3 * gripper.width:.1f} mm apart",
                    width_m=gripper.width,
                    force_n=gripper.force,
                )
        self.metrics["width_m"] = gripper.width

    def _is_free(self, goal: float) -> bool:
        gripper = self.arm.gripper
        if not gripper.page.fingers:
            return gripper.vacuum < 0.01
        return gripper.at_rest and gripper.width >= goal - gripper.page.resolution - 1e-3
