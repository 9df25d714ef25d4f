"""Place what the gripper holds: lower it until contact and release it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bt_dualarm import (
    CarriedPose,
    Failure,
    KnownShape,
    ObjectName,
    PassengerCheck,
    PortModel,
    Pose,
    Released,
    SettingDown,
    SettingDownPorts,
    SightedObjects,
    SightPorts,
    Skill,
    camera_now,
    gazes,
    look_at,
    own_camera,
    port,
    still_picture,
)

_LOOK_M = 0.3  # distance of the camera from the goal
_LEAN = np.radians(45.0)  # largest rotation of the line of sight from that at the release
_LEANS = np.radians(3.0)  # angle from upright above which the current orientation is remarkable
_REFUSALS = frozenset({"NOT_SUPPORTED", "IN_COLLISION", "UNREACHABLE"})
_PICTURES = 6  # images that are averaged
_SIGMAS = 3.0  # allowed in addition, in standard deviations of the estimate


class _ObjectPorts(PortModel):
    object: ObjectName | None = port(None, "object to place; by default what the gripper holds")
    at: CarriedPose = port(
        ...,
        "goal pose of the object; by default with its current orientation, upright if it would "
        "tip over in that, on the side with which it has this height above what is below, and "
        "rotated about the vertical if it cannot be set down otherwise",
    )
    look: bool = port(False, "whether the wrist camera then verifies the object's pose")


class Place(Skill):
    """Place a held object: lower it until contact, release it, retreat, verify its pose."""

    class Ports(SettingDownPorts, _ObjectPorts):
        pass

    failures = {
        "NOT_HELD": "the gripper does not hold the object",
        **SettingDown.failures,
        "SPILLED": "what stood on the object fell off",
        "NO_CAMERA": "`look` is set, but the arm has no camera that moves with it",
        "INVALID_TARGET": "`look` is set, but the object has no color that can be detected",
        "NOT_SEEN": "the camera does not detect the object at its goal",
    }
    example = "place: {object: cube, at: {xyz: [0.35, -0.45, 0.425]}}"
    begins_anywhere = True
    needs = ("scipy.spatial",)
    needs_gripper = True
    needs_held = True
    lets_go = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Plan everything before moving; lower until contact; open; retreat; verify."""
        arm = self.arm
        name = self.ports.object or next(iter(arm.gripper.held), "")
        held = arm.world.attachments.find(arm.name, name)
        released: Released | None = None
        if held is not None and held.by_gripper:
            object_pose = arm.commanded_tool_pose @ (arm.robot.tool.inverse @ held.relative)
        else:
            released = self._released(name)
            held = released.held
            name = held.object
            object_pose = released.pose
        arm.refuse_shared()
        goal = self.ports.at.pose_from(object_pose)
        looked_for = self._looked_for(name)
        is_free = not self.ports.at.is_oriented
        setting_down = SettingDown(arm, self.ports, held, self.metrics, any_heading=is_free)
        if is_free:
            goal = setting_down.level(goal)
        passengers = PassengerCheck(arm.world, name, [goal])
        try:
            if released is not None:
                yield from setting_down.resume(released)
            else:
                yield from setting_down.through(goal)
                goal = setting_down.goal
        except Failure as failure:
            leans = np.arccos(min(1.0, np.abs(goal.rotation_matrix[2]).max()))
            if failure.code not in _REFUSALS or not is_free or leans < _LEANS:
                raise
            raise Failure(
                failure.code,
                f"{failure.reason}; as `at` has no orientation, it would keep its current one, "
                f"{np.degrees(leans):.0f}° from upright",
                **failure.numbers,
            ) from None
        try:
            if looked_for is not None:
                yield from self._look(looked_for, goal)
            yield from setting_down.stays_at(goal)
        except Failure:
            arm.known.released = None  # there is nothing more to do
            raise
        arm.known.released = None
        passengers.refuse_spilled()

    def _released(self, name: str) -> Released:
        """What an earlier run has released at the goal before it was halted, or could not retreat.

        Args:
            name: Name of the object; empty if any counts.

        Raises:
            Failure: ``NOT_HELD``: there is no such object.
        """
        arm = self.arm
        released = arm.known.released
        if released is not None and not arm.gripper.held:
            obj = released.held.object
            if name in ("", obj) and obj in arm.world.objects:
                goal = self.ports.at.pose_from(released.pose)
                shape = KnownShape.of(arm.world.objects[obj])
                away, turned = shape.away(released.pose, goal)
                if away <= self.ports.tolerance and turned <= self.ports.angle_tolerance:
                    return released
        what = repr(name) if name else "anything"
        raise Failure("NOT_HELD", f"{arm.name} does not hold {what}")

    def _looked_for(self, name: str) -> SightedObjects | None:
        """Detector of the object, if the camera has to check; made before anything moves."""
        if not self.ports.look:
            return None
        own_camera(self.arm)
        return SightPorts(object=name).sighted(self.arm)

    def _look(self, looked_for: SightedObjects, goal: Pose) -> Iterator[float | None]:
        """Check with the wrist camera that the object is at its goal.

        Raises:
            Failure: ``NOT_SEEN``, or ``NOT_PLACED`` if it is detected elsewhere.
        """
        arm = self.arm
        camera = camera_now(arm)
        distance = max(_LOOK_M, 5.0 * looked_for.shape.extent)
        sight = camera.rotation_matrix[:, 2]
        middle = goal.apply(np.array(looked_for.shape.center))
        poses = gazes(middle, distance, sight, _LEAN, camera)
        if (yield from look_at(arm, poses, self.ports.speed, at=middle)) is None:
            raise Failure("NOT_SEEN", "no camera pose that sees the goal is reachable")
        picture = yield from still_picture(arm, _PICTURES)
        if picture is not None:
            looked_for.take(picture)
        if not looked_for.objects:
            raise Failure("NOT_SEEN", f"it was not detected at its goal; {looked_for.others}")
        error, sigma = min(
            (float(np.linalg.norm(one.position - middle)), one.best.sigma_m)
            for one in looked_for.objects
        )
        self.metrics |= {"seen_error_m": error, "sigma_m": sigma}
        if error > self.ports.tolerance + _SIGMAS * sigma:
            raise Failure(
                "NOT_PLACED",
                f"the camera sees it {1e3 * error:.1f} mm from its goal",
                seen_error_m=error,
                sigma_m=sigma,
            )
