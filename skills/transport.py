"""Carry the attached object to a pose."""

from __future__ import annotations

from collections.abc import Iterator
from math import degrees

from bt_dualarm import (
    Angle,
    CarriedPose,
    Failure,
    KnownShape,
    ObjectName,
    Planner,
    PortModel,
    Pose,
    Skill,
    Speed,
    held_through,
    port,
)


class Transport(Skill):
    """Carry an attached object to a pose, and check that it arrived and was not lost."""

    class Ports(PortModel):
        object: ObjectName | None = port(
            None, "object to carry; by default the one that is attached to this arm, or held"
        )
        to: CarriedPose = port(..., "pose of the object in the world; turned as now if only xyz")
        speed: Speed = port(0.5, "share of the arm's limits")
        planner: Planner = port("RRTConnect", "searches where the straight way is not free")
        tolerance: float = port(
            0.005,
            "largest distance of the object from its goal at the end",
            unit="m",
            ge=1e-4,
            le=0.1,
        )
        angle_tolerance: Angle = port(2.0, "largest turn of the object at the end", ge=0.01, le=30)

    failures = {
        "NOT_ATTACHED": "the object is not attached to this arm, or was lost on the way; or none "
        "is named, and not one is held",
        "SLIPPED": "the object slid between the fingers",
        "DROPPED": "fingers or cup no longer hold the object",
        "UNREACHABLE": "no configuration of the arm puts the object there",
        "IN_COLLISION": "the arm or the object would touch something there",
        "NO_PLAN": "no way there free of collisions was found",
        "NOT_REACHED": "the object is farther away than the tolerance, or moved in the hand",
        "TRACKING_ERROR": "the arm was blocked or could not follow",
        "BUSY": "another leaf moves the arm",
    }
    example = "transport: {object: cube, to: {xyz: [0.4, -0.2, 0.5]}}"
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Plan with the object as part of the arm, carry it, look where it is."""
        arm, name = self.arm, self.ports.object or self._only_one()
        held = arm.world.attachments.find(arm.name, name)
        if held is None:
            raise Failure("NOT_ATTACHED", f"object {name!r} is not attached to {arm.name}")
        object_in_tool = arm.robot.tool.inverse @ held.relative
        goal = self.ports.to.pose_from(arm.commanded_tool_pose @ object_in_tool)
        tool_goal = goal @ object_in_tool.inverse
        configurations = arm.kinematics.solutions(tool_goal, arm.setpoint.q)
        going = arm.travel(configurations, self.ports.speed, planner=self.ports.planner)
        self.metrics |= yield from held_through(arm, going)
        if held.by_gripper and arm.grip_pace < 1.0:
            self.metrics["grip_pace"] = arm.grip_pace
        self._note_weight(name)
        self._verify(name, goal)

    def _only_one(self) -> str:
        """What the arm holds, where nobody says which thing is meant."""
        held = self.arm.held
        if len(held) != 1:
            which = f"{', '.join(held)}: name one" if held else "nothing that it could carry"
            raise Failure("NOT_ATTACHED", f"{self.arm.name} holds {which}", held=len(held))
        return held[0]

    def _note_weight(self, name: str) -> None:
        """What the arm has found the object to weigh, where nobody has told it."""
        for load in self.arm.payload:
            if load.object == name and load.mass is not None and not load.is_told:
                self.metrics |= {"weighed_kg": load.mass, "weighed_doubt_kg": load.mass_doubt}

    def _verify(self, name: str, goal: Pose) -> None:
        if name not in self.arm.held:
            raise Failure("NOT_ATTACHED", f"object {name!r} was lost on the way")
        held = self.arm.world.attachments.find(self.arm.name, name)
        spec, true = self.arm.world.objects[name], self.arm.world.object_pose(name)
        if held is not None:
            believed = self.arm.tool_pose @ self.arm.robot.tool.inverse @ held.relative
            self.metrics["believed_error_m"] = believed.distance(goal)
            self.metrics["believed_turned_rad"] = believed.angle(goal)
        # By the truth, for the score: no sensor of the arm tells how far it moved in the hand.
        away, turn = true.distance(goal), KnownShape(spec.shape, spec.size).angle(true, goal)
        self.metrics |= {"object_error_m": away, "object_turned_rad": turn}
        if away > self.ports.tolerance or turn > self.ports.angle_tolerance:
            raise Failure(
                "NOT_REACHED",
                f"{name!r} is {1000 * away:.2f} mm and {degrees(turn):.2f}° from its goal",
                object_error_m=away,
                object_turned_rad=turn,
            )
