"""Place what the gripper holds: lower it until contact and release it."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator

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
    Vector,
    camera_now,
    gazes,
    least_hidden,
    look_at,
    own_camera,
    port,
    still_picture,
)

_LOOK_M = 0.3  # distance of the camera from the goal
_SHARES = (1.0, 0.8, 0.65)  # of that distance, at which the camera may also be
_LEAN = np.radians(45.0)  # largest rotation of the line of sight from that at the release
_DOWN = np.array((0.0, 0.0, -1.0))  # the line of sight if it cannot look from there
_LEANS = np.radians(3.0)  # angle from upright above which the current orientation is remarkable
_REFUSALS = frozenset({"NOT_SUPPORTED", "IN_COLLISION", "UNREACHABLE"})
_PICTURES = 6  # images that are averaged
_SIDES = 4  # views from which it is looked for
_OTHER_SIDE = np.cos(np.radians(20.0))  # of the angle between the lines of sight of two of them
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
        if self.ports.look:
            own_camera(arm)
            self._looked_for(name)  # refuses what has no color, before anything moves
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
            if self.ports.look:
                yield from self._look(name, goal)
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

    def _looked_for(self, name: str) -> SightedObjects:
        """Detector of the object."""
        return SightPorts(object=name).sighted(self.arm)

    def _look(self, name: str, goal: Pose) -> Iterator[float | None]:
        """Check with the wrist camera that the object is at its goal.

        An arm, or anything else, may hide a part of it, and what an image shows of it then looks
        like an object elsewhere. What one view does not show at the goal is looked at from other
        sides.

        Raises:
            Failure: ``NOT_SEEN``, or ``NOT_PLACED`` if it is detected elsewhere.
        """
        arm = self.arm
        sides: list[Vector] = []
        error = sigma = math.inf
        others = ""
        while len(sides) < _SIDES:
            looked_for = self._looked_for(name)
            camera = yield from self._go_to_look(name, looked_for.shape, goal, sides)
            if camera is None:
                break
            sides.append(camera.rotation_matrix[:, 2])
            picture = yield from still_picture(arm, _PICTURES)
            if picture is not None:
                looked_for.take(picture)
            others = others or looked_for.others
            middle = goal.apply(np.array(looked_for.shape.center))
            for one in looked_for.objects:
                away = float(np.linalg.norm(one.position - middle))
                if away < error:
                    error, sigma = away, one.best.sigma_m
            if error <= self.ports.tolerance + _SIGMAS * sigma < math.inf:
                break
        if not sides:
            raise Failure("NOT_SEEN", "no camera pose that sees the goal is reachable")
        if error == math.inf:
            raise Failure("NOT_SEEN", f"it was not detected at its goal; {others}")
        self.metrics |= {"seen_error_m": error, "sigma_m": sigma}
        if error > self.ports.tolerance + _SIGMAS * sigma:
            raise Failure(
                "NOT_PLACED",
                f"the camera sees it {1e3 * error:.1f} mm from its goal",
                seen_error_m=error,
                sigma_m=sigma,
            )

    def _go_to_look(
        self, name: str, shape: KnownShape, goal: Pose, sides: list[Vector]
    ) -> Generator[float | None, None, Pose | None]:
        """Move the camera to a viewpoint of the goal; returns its pose, None if there is none.

        Args:
            name: Name of the object.
            shape: Its shape.
            goal: Its goal.
            sides: Lines of sight from which it was viewed before, each of shape (3,).
        """
        arm = self.arm
        camera = camera_now(arm)
        center = goal @ Pose(np.array(shape.center), np.array((1.0, 0.0, 0.0, 0.0)))
        distance = max(_LOOK_M, 5.0 * shape.extent)
        poses = [
            pose
            for ahead in (sides[0] if sides else camera.rotation_matrix[:, 2], _DOWN)
            for share in _SHARES
            for pose in gazes(center.position, share * distance, ahead, _LEAN, camera)
            if all(pose.rotation_matrix[:, 2] @ side < _OTHER_SIDE for side in sides)
        ]
        poses = least_hidden(arm, poses, center, shape, name)
        try:
            return (yield from look_at(arm, poses, self.ports.speed, at=center.position))
        except Failure as failure:
            if not sides or failure.code != "NO_PLAN":
                raise
            return None
