"""Move the tool straight until it touches something: a guarded move."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator

import numpy as np

from bt_dualarm import (
    Direction,
    Failure,
    Grip,
    PortModel,
    Pose,
    Skill,
    Speed,
    Vector,
    port,
    unit_vector,
)

_TARE_S = (0.1, 0.5)
"""Age of the force samples whose mean is the zero: they contain friction and model errors."""

_EDGE_S = 0.35
"""Time after the start and before the end of the motion in which no contact is detected: joints
break away and stick then."""

_LINK_GAP_M = 0.01
"""Length by which the line ends before a link would touch something, by the nominal model."""

_LOOSE_RAD = 2e-3
"""Joint motion, likewise at the start: dry friction changes its sign meanwhile. A
motion up that is followed by a slow one down changes a UR10's torques by what 60 N at its tool
would: such a force is neither a contact nor a zero."""

_EARLY_N = 80.0
"""Increase of the force that is a contact nevertheless: the tool touched something from the start,
and a UR10 would press on it with 280 N before `_EDGE_S` is over."""

_WEAK_SHARE = 0.5
"""Share of what the joints can exert above which no force is waited for that nobody asked for: an
SO-101 whose shoulder applied its whole torque left its path before it pressed with 15 N."""

_LEAST_N = 1.0  # smallest force that a port may ask for

_STEP_M = 2e-4
_STEPS = 10
"""Length and largest number of the steps by which the tool moves back while it still presses."""


class _Samples:
    """Opposing forces and compensated torques of the last moments of a motion.

    Args:
        compensation: Compensated torques before the motion, of shape (dof,), N m.
    """

    def __init__(self, compensation: Vector) -> None:
        self._at_first = compensation
        self._kept = deque[tuple[float, float, Vector]]()

    def add(self, time: float, force: float, compensation: Vector) -> None:
        """Add what is sensed at a time in s: a force in N, and torques of shape (dof,), N m."""
        self._kept.append((time, force, compensation))
        while time - self._kept[0][0] > _TARE_S[1]:
            self._kept.popleft()

    @property
    def rise(self) -> float:
        """Increase of the force, N, over its mean of a moment ago; 0 until there is one."""
        before = [force for _, force, _ in self._before()]
        return self._kept[-1][1] - float(np.mean(before)) if before else 0.0

    @property
    def compensation(self) -> Vector:
        """Mean of the compensated torques of a moment ago, of shape (dof,), N m."""
        before = [torques for _, _, torques in self._before()]
        mean: Vector = np.mean(before or [self._at_first], axis=0)
        return mean

    def _before(self) -> list[tuple[float, float, Vector]]:
        return [one for one in self._kept if self._kept[-1][0] - one[0] >= _TARE_S[0]]


class MoveUntilContact(Skill):
    """Move the tool straight until a force opposes the motion, and stop there (guarded move)."""

    class Ports(PortModel):
        direction: Direction = port((0.0, 0.0, -1.0), "direction of the motion, world axes")
        distance: float = port(0.10, "largest distance of the motion", unit="m", ge=0.001, le=1.0)
        force: float = port(
            15.0,
            "opposing force at which the motion ends; if it is not given, at half of what a weak "
            "arm can exert",
            unit="N",
            ge=1,
            le=200,
        )
        speed: Speed = port(0.01, "fraction of the arm's limits")

    failures = {
        "NO_CONTACT": "no opposing force was detected over the whole distance",
        "IN_COLLISION": "a link that is not part of the tool would touch something first",
        "FORCE_LIMIT": "the contact force exceeded the arm's limit before it stopped",
        "SLIPPED": "the held object slid between the fingers",
        "DROPPED": "the gripper no longer holds the object",
        "TRACKING_ERROR": "the arm could not follow",
        "BUSY": "another leaf moves the arm",
    }
    example = "move_until_contact: {direction: [1, 0, 0], distance: 0.08}"
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Move, compare the force with that of a moment ago, stop, release the contact force."""
        direction = unit_vector(self.ports.direction)
        self.arm.refuse_shared()
        yield from self.arm.come_to_rest()  # the motion of a halted leaf may still be braking
        start = self.arm.commanded_tool_pose
        end = start.shifted(self.ports.distance * direction)
        rows = self.arm.line_on(end)
        blocked = self.arm.first_link_contact(rows)
        if blocked is not None:
            # The line ends before a link touches: what it touched would count as the contact.
            step = self.ports.distance / (len(rows) - 1)
            rows = rows[: max(0, blocked[0] - math.ceil(_LINK_GAP_M / step))]
            if len(rows) < 2:
                raise blocked[1]
        grip = self._grip()
        threshold = self.ports.force if grip is None else grip.firm_for(self.ports.force)
        ends = rows[[0, len(rows) // 2, -1]]
        if "force" not in self.ports.model_fields_set:
            weak = max(_WEAK_SHARE * self.arm.most_force(ends, direction), _LEAST_N)
            threshold = min(threshold, weak)
        timed = self.arm.time_path(rows, self.ports.speed)
        # A compliant arm presses less on what is held only by the friction of the fingers.
        motion = self.arm.begin(timed, may_touch=True, compliant=grip is not None)
        compliance = self.arm.controller.compliance
        samples = _Samples(compliance.compensation)
        duration = motion.trajectory.duration
        at_rest = self._opposing(direction)
        rubs = bool(self.arm.world.nominal[self.arm.name].friction.coulomb.any())
        while not motion.done:
            yield motion.progress
            self.arm.check()
            if grip is not None:
                yield from grip.watch()
            elapsed = motion.progress * duration
            moved = float(np.abs(self.arm.setpoint.q - rows[0]).max())
            opposing = self._opposing(direction)
            force = opposing - at_rest
            if elapsed < _EDGE_S or moved < _LOOSE_RAD:
                felt = grip is None and force > max(threshold, _EARLY_N)
            else:
                samples.add(self.time, opposing, compliance.compensation)
                # Without friction the zero stays: a light arm pushes ever harder for seconds, which
                # is no rise within a moment.
                force = samples.rise if rubs else max(samples.rise, force)
                felt = force > threshold and elapsed < duration - _EDGE_S
            if felt:
                self._score(force, start)
                if grip is None:
                    # The estimate of the disturbance contains the contact force already: a soft
                    # arm that compensates it would push on.
                    compliance.soften(compensation=samples.compensation)
                yield from self.arm.halt()
                yield from self.arm.relax()
                if grip is None:
                    yield from self._back_off(direction, opposing - force + threshold)
                return
        yield from self.arm.settle()
        if blocked is not None:
            raise blocked[1]
        raise Failure(
            "NO_CONTACT",
            f"the tool detected no contact over {1e3 * self.ports.distance:.0f} mm",
            distance_m=self.ports.distance,
        )

    def _opposing(self, direction: Vector) -> float:
        """Sensed force against the direction, N, with the error of the model."""
        return -float(direction @ self.arm.external_wrench[:3])

    def _back_off(self, direction: Vector, bound: float) -> Iterator[float | None]:
        """Move back until the force is below a bound, N.

        A stiff arm on something hard holds the force with which it came to rest: a UR10 pressed
        with 130 N, and with 280 N when it was to move until contact once more.
        """
        for _ in range(_STEPS):
            if self._opposing(direction) <= bound:
                return
            here = self.arm.commanded_tool_pose
            back = here.shifted(-_STEP_M * direction)
            timed = self.arm.time_path(self.arm.line_on(back), self.ports.speed)
            motion = self.arm.begin(timed, may_touch=True)
            while not motion.done:
                yield 1.0
                self.arm.check()
            yield from self.arm.halt()  # the contact keeps it from settling at its set-point

    def _grip(self) -> Grip | None:
        """Slip check of a held object, which is what makes the contact then; None without one."""
        held = self.arm.world.attachments.gripped_by(self.arm.name)
        return Grip(self.arm, held[0].object) if held else None

    def _score(self, force: float, start: Pose) -> None:
        position = self.arm.tool_pose.position
        self.metrics |= {
            "contact_force_n": force,
            "contact_after_m": float(np.linalg.norm(position - start.position)),
            **dict(
                zip(("contact_x_m", "contact_y_m", "contact_z_m"), position.tolist(), strict=True)
            ),
        }
