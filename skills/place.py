"""Set down what the gripper holds, by touch, and let go of it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bt_dualarm import (
    CarriedPose,
    Failure,
    ObjectName,
    PortModel,
    Pose,
    SettingDown,
    SettingDownPorts,
    SightedThings,
    SightPorts,
    Skill,
    camera_now,
    gazes,
    look_at,
    own_camera,
    port,
    still_picture,
)


class _What(PortModel):
    object: ObjectName | None = port(None, "object to set down; by default what the gripper holds")
    at: CarriedPose = port(..., "pose of the object then; turned as now if only xyz")
    look: bool = port(
        False, "whether the arm's own camera looks afterwards whether it stands there"
    )


_LOOK_M = 0.3  # from which it looks
_LEAN = np.radians(45.0)  # by which it may look from another side than it does when it lets go
_PICTURES = 6
_SIGMAS = 3.0


class Place(Skill):
    """Set an object that the gripper holds down where it is to stand, let go, go away."""

    class Ports(SettingDownPorts, _What):
        pass

    failures = {
        "NOT_HELD": "the gripper does not hold the object",
        **SettingDown.failures,
        "NO_CAMERA": "`look` is asked for, and the arm has no camera of its own",
        "INVALID_TARGET": "`look` is asked for, and the object has no color that can be found",
        "NOT_SEEN": "the camera does not see it at its goal",
    }
    example = "place: {object: cube, at: {xyz: [0.35, -0.45, 0.425]}}"
    needs = ("scipy.interpolate", "scipy.spatial")
    needs_gripper = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Plan all of it before moving; lower until it touches; open; go back; see it stay."""
        arm = self.arm
        name = self.ports.object or next(iter(arm.gripper.held), "")
        held = arm.world.attachments.find(arm.name, name)
        if held is None or not held.by_gripper:
            what = repr(name) if name else "anything"
            raise Failure("NOT_HELD", f"{arm.name} does not hold {what}")
        in_tool = arm.robot.tool.inverse @ held.relative
        goal = self.ports.at.pose_from(arm.commanded_tool_pose @ in_tool)
        looked_for = self._looked_for(name)
        setting_down = SettingDown(arm, self.ports, held, self.metrics)
        yield from setting_down.through(goal)
        if looked_for is not None:
            yield from self._look(looked_for, goal)
        yield from setting_down.stays_at(goal)

    def _looked_for(self, name: str) -> SightedThings | None:
        """What the camera is to find, if it is to look; before anything moves."""
        if not self.ports.look:
            return None
        own_camera(self.arm)
        return SightPorts(object=name).sighted(self.arm)

    def _look(self, looked_for: SightedThings, goal: Pose) -> Iterator[float | None]:
        """Look at the goal by the arm's own camera, and find the object there.

        Raises:
            Failure: ``NOT_SEEN``, or ``NOT_PLACED`` where it is seen elsewhere.
        """
        arm, camera = self.arm, camera_now(self.arm)
        distance = max(_LOOK_M, 5.0 * looked_for.shape.extent)
        sight = camera.rotation_matrix[:, 2]
        places = gazes(goal.position, distance, sight, _LEAN, camera)
        if (yield from look_at(arm, places, self.ports.speed)) is None:
            raise Failure("NOT_SEEN", "there is no way to a place that looks at the goal")
        picture = yield from still_picture(arm, _PICTURES)
        if picture is not None:
            looked_for.take(picture)
        if not looked_for.things:
            raise Failure("NOT_SEEN", f"it is not seen at its goal; {looked_for.others}")
        away, sigma = min(
            (float(np.linalg.norm(one.position - goal.position)), one.best.sigma_m)
            for one in looked_for.things
        )
        self.metrics |= {"seen_error_m": away, "sigma_m": sigma}
        if away > self.ports.tolerance + _SIGMAS * sigma:
            raise Failure(
                "NOT_PLACED",
                f"the camera sees it {1e3 * away:.1f} mm from its goal",
                seen_error_m=away,
                sigma_m=sigma,
            )
