"""Carry a held object to a pose."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from math import degrees

from bt_dualarm import (
    Angle,
    CarriedPose,
    Failure,
    Keep,
    KeptPath,
    ObjectName,
    PassengerCheck,
    Planner,
    PortModel,
    Pose,
    Skill,
    Speed,
    Vector,
    goals_alike,
    held_through,
    port,
    true_error,
)


class Transport(Skill):
    """Carry a held object to a pose, and verify that it arrived."""

    class Ports(PortModel):
        object: ObjectName | None = port(
            None, "object to carry; by default the one that the arm holds"
        )
        to: CarriedPose = port(
            ...,
            "goal pose of the object in the world; by default with its current orientation",
        )
        speed: Speed = port(0.5, "fraction of the arm's limits")
        planner: Planner = port("RRTConnect", "planner to use if the straight path is blocked")
        keep: Keep | None = port(None, "limits that the planner keeps along the whole path")
        tolerance: float = port(
            0.005,
            "largest position error of the object at the end",
            unit="m",
            ge=1e-4,
            le=0.1,
        )
        angle_tolerance: Angle = port(
            2.0, "largest angle error of the object at the end", ge=0.01, le=30
        )

    failures = {
        "NOT_ATTACHED": "the object is not held, or was lost on the path; or none is named, and "
        "the arm does not hold exactly one",
        "SLIPPED": "the object slid between the fingers",
        "DROPPED": "the gripper no longer holds the object",
        "UNREACHABLE": "no configuration of the arm puts the object there",
        "IN_COLLISION": "the arm or the object would touch something there",
        "NO_PLAN": "no collision-free path was found",
        "NOT_REACHED": "the object is beyond the tolerance, or moved in the gripper",
        "TRACKING_ERROR": "the arm was blocked or could not follow",
        "SPILLED": "what stood on the object fell off",
        "BUSY": "another leaf moves the arm",
        **KeptPath.failures,
    }
    example = "transport: {object: cube, to: {xyz: [0.4, -0.2, 0.5]}}"
    begins_anywhere = True
    needs_held = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Plan with the object and what stands on it, carry it, verify its pose."""
        arm = self.arm
        name = self.ports.object or self._only_held()
        held = arm.world.attachments.find(arm.name, name)
        if held is None:
            raise Failure("NOT_ATTACHED", f"object {name!r} is not attached to {arm.name}")
        object_in_tool = arm.robot.tool.inverse @ held.relative
        goal = self.ports.to.pose_from(arm.commanded_tool_pose @ object_in_tool)
        kept = None
        if self.ports.keep is not None:
            kept = KeptPath(arm, self.ports.keep, object_in_tool)
        goal, configurations = yield from self._free_goal(name, goal, object_in_tool, kept)
        passengers = PassengerCheck(arm.world, name, [goal])
        motion = arm.travel(
            configurations,
            self.ports.speed,
            planner=self.ports.planner,
            keep=None if kept is None else kept.constraint,
            turns=True,
        )
        if kept is not None:
            motion = kept.through(motion, self.metrics)
        self.metrics |= yield from held_through(arm, motion)
        if held.by_gripper and arm.grip_speed_scale < 1.0:
            self.metrics["grip_speed_scale"] = arm.grip_speed_scale
        self._report_mass(name)
        self._verify(name, goal)
        passengers.refuse_spilled()

    def _free_goal(
        self, name: str, goal: Pose, object_in_tool: Pose, kept: KeptPath | None
    ) -> Generator[None, None, tuple[Pose, list[Vector]]]:
        """The goal, with configurations in which the object is there.

        If there is none, or something other than an arm is in the way of all of them, a pose in
        which the object looks the same. Yields once for each of those that is tried.

        Raises:
            Failure: As `Arm.configurations` for the goal as requested, if it has none.
        """
        arm = self.arm
        tool_goal = goal @ object_in_tool.inverse
        if kept is not None:
            kept.refuse_ends(tool_goal)
        found: list[Vector] = []
        refusal: Failure | None = None
        try:
            found = arm.configurations(tool_goal)
        except Failure as failure:
            refusal = failure.with_traceback(None)  # would keep this frame alive
        else:
            if self._is_free(found) or self._may_leave(found[0]):
                return goal, found
        for turned, alike in goals_alike(arm.world, name, goal)[1:]:
            yield
            tool_goal = alike @ object_in_tool.inverse
            try:
                if kept is not None:
                    kept.refuse_ends(tool_goal)
                others = arm.configurations(tool_goal)
            except Failure:
                continue
            if self._is_free(others):
                self.metrics["spun_rad"] = turned
                return alike, others
        if refusal is not None:
            raise refusal
        return goal, found

    def _is_free(self, configurations: list[Vector]) -> bool:
        """Whether the arm touches nothing in one of several configurations."""
        checker = self.arm.checker()
        return any(checker.free(q) for q in configurations)

    def _may_leave(self, q: Vector) -> bool:
        """Whether it is an arm that is in the way of a configuration, and may leave."""
        arm = self.arm
        try:
            arm.refuse_collision(q)
        except Failure as failure:
            return arm.past_others(self.ports.speed).may_leave(failure)
        return True

    def _only_held(self) -> str:
        """The one object that the arm holds.

        Raises:
            Failure: ``NOT_ATTACHED``: it holds none, or several.
        """
        held = self.arm.held
        if len(held) != 1:
            which = f"{', '.join(held)}: name one" if held else "nothing to carry"
            raise Failure("NOT_ATTACHED", f"{self.arm.name} holds {which}", held=len(held))
        return held[0]

    def _report_mass(self, name: str) -> None:
        """Report the estimated mass of an object whose mass is not declared to the arm."""
        for load in self.arm.payload:
            if load.object == name and load.mass is not None and not load.mass_declared:
                self.metrics |= {"weighed_kg": load.mass, "weighed_doubt_kg": load.mass_doubt}

    def _verify(self, name: str, goal: Pose) -> None:
        if name not in self.arm.held:
            raise Failure("NOT_ATTACHED", f"object {name!r} was lost on the path")
        held = self.arm.world.attachments.find(self.arm.name, name)
        if held is not None:
            estimate = self.arm.tool_pose @ self.arm.robot.tool.inverse @ held.relative
            self.metrics["believed_error_m"] = estimate.distance(goal)
            self.metrics["believed_turned_rad"] = estimate.angle(goal)
        away, turn = true_error(self.arm.world, name, goal)
        self.metrics |= {"object_error_m": away, "object_turned_rad": turn}
        if away > self.ports.tolerance or turn > self.ports.angle_tolerance:
            raise Failure(
                "NOT_REACHED",
                f"{name!r} is {1000 * away:.2f} mm and {degrees(turn):.2f}° from its goal",
                object_error_m=away,
                object_turned_rad=turn,
            )
