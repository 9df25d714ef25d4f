"""Take an object in another way than it is held, or lies."""

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
)

_TOLERANCE_M = 0.004  # in height, where it is set down
_WITHIN_M = 0.01  # of where it is meant to stand then, and of where it is meant to be in the hand


class Regrasp(Skill):
    """Set down what the gripper holds, by touch, and take it in another way."""

    class Ports(TakingPorts):
        object: ObjectName | None = port(None, "object to take; by default what the gripper holds")
        at: CarriedPose | None = port(
            None, "pose at which it is set down; by default where it was taken"
        )

    failures = {
        "NOT_HELD": "the gripper holds nothing, and no object is named",
        **SettingDown.failures,
        **Taking.failures,
        "OUT_OF_REACH": "no other grasp has room, is as asked for, or can be reached",
    }
    example = "regrasp: {object: cube}"
    needs = ("scipy.interpolate", "scipy.spatial", "bt_dualarm.skill.grasps_prepared")
    needs_gripper = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """See that there is another grasp; set down; take anew; go nowhere else."""
        arm = self.arm
        name = self.ports.object or next(iter(arm.gripper.held), None)
        if name is None:
            raise Failure("NOT_HELD", f"{arm.name} holds nothing in its gripper")
        refuse_too_frail(arm, repr(name), self.ports.most_force)
        wanted = yield from self._put_down(name)
        taking = Taking(arm, self.ports, wanted, False, self.metrics)
        ranked = yield from taking.through(grasps_on(arm, wanted))
        self._verify(name)
        if wanted.unlike is not None:
            self.metrics["turned_rad"] = ranked.grasp.tool.angle(wanted.unlike)

    def _verify(self, name: str) -> None:
        """Look whether it truly is where the arm believes it to be in the hand, as a referee."""
        arm = self.arm
        held = arm.world.attachments.find(arm.name, name)
        if held is None or name not in arm.world.objects:
            raise Failure("DROPPED", f"{name!r} is no longer held")
        believed = arm.tool_pose @ arm.robot.tool.inverse @ held.relative
        away = arm.world.object_pose(name).distance(believed)
        self.metrics["held_error_m"] = away
        if away > _WITHIN_M:
            arm.gripper.let_go(name)
            raise Failure(
                "NOT_GRASPED",
                f"{name!r} is {1e3 * away:.1f} mm from where it was to be in the hand",
                held_error_m=away,
            )

    def _put_down(self, name: str) -> Generator[float | None, None, WantedGrasp]:
        """Where it is when it stands, and from what the new grasp has to differ."""
        arm, ports = self.arm, self.ports
        held = arm.world.attachments.find(arm.name, name)
        if held is None or not held.by_gripper:
            return WantedGrasp.named(arm, name, ports, None)
        in_tool = arm.robot.tool.inverse @ held.relative
        now = arm.commanded_tool_pose @ in_tool
        goal = held.lay or now
        if ports.at is not None:
            goal = ports.at.pose_from(now)
        unlike = None if ports.approach is not None else in_tool.inverse
        grasps_on(arm, WantedGrasp.named(arm, name, ports, goal, unlike))  # before anything moves
        how = SettingDownPorts(speed=ports.speed, tolerance=_TOLERANCE_M)
        setting_down = SettingDown(arm, how, held, self.metrics)
        lies = yield from setting_down.through(goal)
        yield from setting_down.stays_at(goal, _WITHIN_M)
        return WantedGrasp.named(arm, name, ports, lies, unlike)
