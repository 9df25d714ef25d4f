"""Pick a held object with another grasp."""

from __future__ import annotations

from collections.abc import Generator, Iterator

from bt_dualarm import (
    CarriedPose,
    Failure,
    ObjectName,
    SettingDown,
    SettingDownPorts,
    Skill,
    Taking,
    TakingPorts,
    WantedGrasp,
    grasps_on,
    port,
    refuse_too_frail,
    true_error,
)

_TOLERANCE_M = 0.004  # tolerance of the placing height
_WITHIN_M = 0.01  # error of its pose after placing, and of its pose in the gripper at the end


class Regrasp(Skill):
    """Place what the gripper holds and pick it with another grasp."""

    class Ports(TakingPorts):
        object: ObjectName | None = port(None, "object to pick; by default what the gripper holds")
        at: CarriedPose | None = port(
            None,
            "pose at which it is placed, without an orientation as by `place`; by default where it "
            "was picked",
        )

    failures = {
        "NOT_HELD": "the gripper holds nothing, and no object is named",
        **SettingDown.failures,
        **Taking.failures,
        "OUT_OF_REACH": "no other grasp is collision-free, as requested, and reachable",
    }
    example = "regrasp: {object: cube}"
    begins_anywhere = True
    needs = ("scipy.spatial", "bt_dualarm.skill.preload_grasping")
    needs_gripper = True
    takes_hold = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Check that another grasp exists; place; pick again; verify."""
        arm = self.arm
        name = self.ports.object or next(iter(arm.gripper.held), None)
        if name is None:
            raise Failure("NOT_HELD", f"{arm.name} has nothing in its gripper")
        arm.refuse_shared()
        refuse_too_frail(arm, repr(name), self.ports.most_force)
        wanted = yield from self._place(name)
        taking = Taking(arm, self.ports, wanted, False, self.metrics)
        ranked = yield from taking.through(grasps_on(arm, wanted))
        self._verify(name)
        if wanted.unlike is not None:
            self.metrics["turned_rad"] = ranked.grasp.tool.angle(wanted.unlike)

    def _verify(self, name: str) -> None:
        """Check the true pose in the gripper against the estimate, as a referee."""
        arm = self.arm
        held = arm.world.attachments.find(arm.name, name)
        if held is None:
            raise Failure("DROPPED", f"{name!r} is no longer held")
        estimate = arm.tool_pose @ arm.robot.tool.inverse @ held.relative
        error, _ = true_error(arm.world, name, estimate)
        self.metrics["held_error_m"] = error
        if error > _WITHIN_M:
            arm.gripper.let_go(name)
            raise Failure(
                "NOT_GRASPED",
                f"{name!r} is {1e3 * error:.1f} mm from its intended pose in the gripper",
                held_error_m=error,
            )

    def _place(self, name: str) -> Generator[float | None, None, WantedGrasp]:
        """Place the object if it is held; returns what to pick, and which grasp to avoid."""
        arm = self.arm
        ports = self.ports
        held = arm.world.attachments.find(arm.name, name)
        if held is None or not held.by_gripper:
            return WantedGrasp.named(arm, name, ports, None)
        in_tool = arm.robot.tool.inverse @ held.relative
        now = arm.commanded_tool_pose @ in_tool
        goal = held.lay or now
        if ports.at is not None:
            goal = ports.at.pose_from(now)
        is_free = ports.at is not None and not ports.at.is_oriented
        ports_of_placing = SettingDownPorts(speed=ports.speed, tolerance=_TOLERANCE_M)
        setting_down = SettingDown(arm, ports_of_placing, held, self.metrics, any_heading=is_free)
        if is_free:
            goal = setting_down.level(goal)
        unlike = None if ports.approach is not None else in_tool.inverse
        grasps_on(
            arm, WantedGrasp.named(arm, name, ports, goal, unlike)
        )  # refuses before anything moves
        object_pose = yield from setting_down.through(goal)
        yield from setting_down.stays_at(setting_down.goal, _WITHIN_M)
        return WantedGrasp.named(arm, name, ports, object_pose, unlike)
