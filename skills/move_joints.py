"""Move the joints to given angles, or by given angles."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping

import numpy as np

from bt_dualarm import (
    Failure,
    JointAngles,
    JointOffsets,
    PortModel,
    Skill,
    Speed,
    Trajectory,
    Vector,
    port,
)


class MoveJoints(Skill):
    """Move the joints to or by angles along a straight line in joint space."""

    class Ports(PortModel):
        exactly_one_of = ("to", "by")

        to: JointAngles | None = port(
            None, "angles of all joints, base to tip, or {joint: angle} for some", unit="deg"
        )
        by: JointOffsets | None = port(None, "the same, relative to the current angles", unit="deg")
        speed: Speed = port(0.5, "fraction of the arm's limits")

    failures = {
        "INVALID_TARGET": "the number of angles is not the number of joints, or no such joint",
        "JOINT_LIMIT": "an angle is beyond the joint's limits",
        "IN_COLLISION": "the arm would touch something on the path",
        "TRACKING_ERROR": "the arm was blocked or could not follow",
        "BUSY": "another leaf moves the arm",
    }
    example = "move_joints: {by: [0, 0, 0, 0, 0, 45], speed: 0.5}"
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Check the goal, move, measure the error."""
        arm = self.arm
        goal = self._goal(arm.setpoint.q)
        yield from arm.come_to_rest()  # the motion of a halted leaf may still be braking
        yield from arm.past_others(self.ports.speed).along(lambda: self._straight_to(goal))
        error = np.abs(arm.q - goal)
        self.metrics["joint_error_rad"] = float(error.max())

    def _straight_to(self, goal: Vector) -> Generator[None, None, Trajectory]:
        yield from ()
        return self.arm.straight_to(goal, self.ports.speed)

    def _goal(self, now: Vector) -> Vector:
        """Angles of all joints, of shape (dof,), rad."""
        to = self.ports.to
        by = self.ports.by
        goal = now.copy() if by is None else np.zeros_like(now)
        for joint, angle in self._by_index(by if to is None else to, len(now)).items():
            goal[joint] = angle
        return goal if by is None else now + goal

    def _by_index(self, angles: JointAngles | JointOffsets | None, dof: int) -> Mapping[int, float]:
        joints = self.arm.robot.joints
        if isinstance(angles, dict):
            unknown = [name for name in angles if name not in joints]
            if unknown:
                known = ", ".join(joints)
                raise Failure("INVALID_TARGET", f"the arm has no joint {unknown[0]!r}: {known}")
            return {joints.index(name): angle for name, angle in angles.items()}
        given = angles or ()
        if len(given) != dof:
            raise Failure("INVALID_TARGET", f"{len(given)} angles were given for {dof} joints")
        return dict(enumerate(given))
