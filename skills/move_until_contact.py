"""Move the tool straight until it touches something: a guarded move."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np

from bt_dualarm import (
    Failure,
    Grip,
    PortModel,
    Pose,
    Skill,
    Speed,
    Vector3,
    port,
    unit_vector,
)

_TARE_S = (0.1, 0.5)
"""How long ago the force was that counts as none: friction and masses that are off are in it."""

_EDGE_S = 0.35
"""At the beginning and the end of the way, where joints break loose and stick: nothing counts."""

_LOOSE_RAD = 2e-3
"""Way of the set-point's joints, likewise at the beginning: dry friction turns around meanwhile. A
motion up that is followed by a slow one down changes a UR10's torques by what 60 N at its tool
would: such a force is neither a touch nor what to compare one with."""


class MoveUntilContact(Skill):
    """Move the tool straight until it feels a force against its motion, and stay there."""

    class Ports(PortModel):
        direction: Vector3 = port((0.0, 0.0, -1.0), "way of the tool, world axes")
        distance: float = port(0.10, "farthest that it goes", unit="m", ge=0.001, le=1.0)
        force: float = port(15.0, "force against the motion that ends it", unit="N", ge=1, le=200)
        speed: Speed = port(0.01, "share of the arm's limits")

    failures = {
        "INVALID_TARGET": "the direction has no length",
        "NO_CONTACT": "the tool felt nothing all the way",
        "FORCE_LIMIT": "it pressed harder than the arm may, before it had stopped",
        "TRACKING_ERROR": "the arm could not follow",
        "BUSY": "another leaf moves the arm",
    }
    example = "move_until_contact: {direction: [1, 0, 0], distance: 0.08}"
    needs = ("scipy.interpolate",)
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Go, compare the force with what it was a moment ago, stop, no longer press."""
        way = unit_vector(self.ports.direction)
        start = self.arm.commanded_tool_pose
        end = Pose(start.position + self.ports.distance * way, start.quaternion)
        rows = self.arm.line_on(end)
        grip = self._grip()
        force_that_ends = self.ports.force if grip is None else grip.firm_for(self.ports.force)
        timed = self.arm.time_path(rows, self.ports.speed)
        # What is pressed on the fingers' friction slides less where the arm gives way.
        motion = self.arm.begin(timed, may_touch=True, compliant=grip is not None)
        felt, duration = deque[tuple[float, float]](), motion.trajectory.duration
        while not motion.done:
            yield motion.progress
            self.arm.check()
            if grip is not None:
                grip.look()
            gone = motion.progress * duration
            moved = float(np.abs(self.arm.setpoint.q - rows[0]).max())
            if gone < _EDGE_S or moved < _LOOSE_RAD:
                continue
            force = self._rise(felt, -float(way @ self.arm.external_wrench[:3]))
            if force > force_that_ends and gone < duration - _EDGE_S:
                self._note(force, start)
                yield from self.arm.halt()
                yield from self.arm.relax()
                return
        yield from self.arm.settle()
        raise Failure(
            "NO_CONTACT",
            f"the tool felt nothing on {1e3 * self.ports.distance:.0f} mm",
            distance_m=self.ports.distance,
        )

    def _grip(self) -> Grip | None:
        """A watch over what the gripper holds, which is what meets something then."""
        held = self.arm.world.attachments.gripped_by(self.arm.name)
        return Grip(self.arm, held[0].object) if held else None

    def _rise(self, felt: deque[tuple[float, float]], force: float) -> float:
        """By how much a force in N is more than it was a moment ago."""
        now, (latest, earliest) = self.time, _TARE_S
        felt.append((now, force))
        while now - felt[0][0] > earliest:
            felt.popleft()
        before = [one for at, one in felt if now - at >= latest]
        return force - float(np.mean(before)) if before else 0.0

    def _note(self, force: float, start: Pose) -> None:
        place = self.arm.tool_pose.position
        self.metrics |= {
            "contact_force_n": force,
            "contact_after_m": float(np.linalg.norm(place - start.position)),
            **dict(zip(("contact_x_m", "contact_y_m", "contact_z_m"), place.tolist(), strict=True)),
        }
