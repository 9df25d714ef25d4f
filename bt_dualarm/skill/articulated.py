"""Parts that move on a joint, such as doors and drawers, as a skill moves them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.spec.joints import PartJoint, moved_name
from bt_dualarm.trajectory.path_timing import point_to_point
from bt_dualarm.trajectory.trajectory import Trajectory

_SPACING_M: Final = 0.005
_SPACING_RAD: Final = 0.03
"""Largest distances between two samples of a path: inverse kinematics stays on one branch."""


@dataclass(frozen=True, eq=False)
class JointPath:
    """Path of what a joint moves.

    Attributes:
        name: Name of the object that the joint moves.
        positions: Positions of the joint, first to last, rad or m.
        moves: Displacements in the world from the pose at the first position: the pose of a tool
            that holds the part is each of them times the present one.
    """

    name: str
    positions: tuple[float, ...]
    moves: tuple[Pose, ...]

    def refuse_contact(
        self, arm: Arm, rows: Matrix, free: Sequence[int] = (), room: float = 0.0
    ) -> None:
        """Check configurations of an arm that moves the part along the path.

        Objects are where the arm knows them to be. What stands on or in the part moves along and is
        no obstacle, nor is what the arm does not know.

        Args:
            arm: The arm.
            rows: Its configurations, one for each position, of shape (n, dof), rad.
            free: Geoms that may be touched.
            room: Distance that the arm keeps from everything else, m.

        Raises:
            Failure: ``IN_COLLISION`` of the first configuration that touches something;
                ``NOT_THERE``.
        """
        arm.world.objects.require(self.name)
        known = {name: arm.known.where(name) for name in arm.world.objects}
        unknown = frozenset(name for name, one in known.items() if one is None)
        checker = arm.checker(arm.known.standing_on(self.name) | unknown)
        for name, one in known.items():
            if one is not None and arm.world.objects[name].is_free and name not in arm.held:
                checker.move_object(name, one.pose)
        if room > 0.0:
            checker.keep_clear(room)
        its = list(free)
        checker.least[its, :] = checker.least[:, its] = -np.inf
        for q, position in zip(rows, self.positions, strict=True):
            checker.move_joint(self.name, position)
            contact = checker.contact(q)
            if contact is not None:
                raise contact.failure()


class MovedPart:
    """What a joint of an object moves, as one arm knows it.

    Args:
        arm: Arm that moves it.
        owner: Name of the object with the joint.
        joint: Name of the joint.

    Attributes:
        name: Name of the object that the joint moves.
        spec: The joint.

    Raises:
        Failure: ``NOT_THERE`` or ``INVALID_TARGET``: there is no such object or joint.
    """

    def __init__(self, arm: Arm, owner: str, joint: str) -> None:
        self._arm = arm
        self._owner = owner
        self.name = moved_name(owner, joint)
        world = arm.world
        world.objects.require(owner)
        hung = world.objects[self.name].joint if self.name in world.objects else None
        if hung is None:
            raise Failure("INVALID_TARGET", f"object {owner!r} has no joint {joint!r}")
        self.spec: PartJoint = hung.spec

    @property
    def position(self) -> float:
        """Position of the joint in rad or m, by its sensor or by where the arm holds the part.

        Raises:
            Failure: ``UNKNOWN_POSE``.
        """
        return self._arm.known.joint_position(self.name)

    def target(self, given: float) -> float:
        """Position in rad or m of one as in a file, in degrees or m.

        Raises:
            Failure: ``INVALID_TARGET`` if it is not in the range of the joint.
        """
        low, high = self.spec.range
        if not low <= given <= high:
            unit = "°" if self.spec.type == "hinge" else " m"
            raise Failure(
                "INVALID_TARGET",
                f"{given:g}{unit} is not in the range of {self.name}: {low:g} to {high:g}{unit}",
                asked=given,
                least=low,
                most=high,
            )
        return self.spec.si(given)

    def path(self, goal: float) -> JointPath:
        """Path of the part from where it is now.

        Args:
            goal: Position of the joint at its end, rad or m.

        Raises:
            Failure: ``UNKNOWN_POSE``.
        """
        here = self.position
        frame = self._arm.known.pose(self._owner).pose
        before = (frame @ self.spec.displacement(here)).inverse
        count = max(math.ceil(abs(goal - here) / self._spacing), 8)
        places = np.linspace(here, goal, count + 1).tolist()
        moves = tuple(frame @ self.spec.displacement(place) @ before for place in places)
        return JointPath(self.name, tuple(places), moves)

    @property
    def owner_moved_m(self) -> float | None:
        """Distance in m, at the tool, by which the object has moved, not its joint.

        The pose of the hand that holds the part and the sensor of the joint tell both apart. None
        for an object that is fixed, and without a hand on it.
        """
        arm = self._arm
        held = arm.world.attachments.find(arm.name, self.name)
        if arm.world.objects[self._owner].fixed or held is None:
            return None
        tool = arm.tool_pose
        felt = tool @ arm.robot.tool.inverse @ held.relative
        there = arm.known.pose(self.name).pose
        return (felt @ there.inverse @ tool).distance(tool)

    def forget_if_moved(self, least: float) -> float | None:
        """Let the arm forget where the object is if it has moved.

        Args:
            least: Distance in m up to which it counts as not moved.

        Returns:
            As `owner_moved_m`.
        """
        arm = self._arm
        moved = self.owner_moved_m
        if moved is not None and moved > least:
            # Where it is now is uncertain: the part may have slid in the hand as well.
            why = f"it moved by {1e3 * moved:.0f} mm while {arm.name} moved {self.name!r}"
            arm.known.forget(self._owner, why)
        return moved

    @property
    def _spacing(self) -> float:
        return _SPACING_RAD if self.spec.type == "hinge" else _SPACING_M


_EASE_S: Final = 0.04
"""Time constant with which a soft arm gives way to what its fingertips feel, s."""


class HandForce:
    """Force of a held part on the fingers, to which a soft arm gives way.

    An arm that follows the path of a joint presses sideways on the part, by the friction of its own
    joints and the errors of its model. Fingertip sensors measure that force; without them it is
    unknown, and nothing is done about it.

    Args:
        arm: Arm that holds the part.
    """

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self._last = arm.time

    @property
    def measured(self) -> Vector | None:
        """Force on the tool in the world, of shape (3,), N; None without fingertip sensors."""
        arm = self._arm
        return arm.gripper.load if arm.name in arm.world.grippers else None

    def ease(self, along: Vector | None = None) -> None:
        """Give way to the force, once per tick.

        Args:
            along: Unit vector in the world of the motion, of shape (3,): the arm does not give way
                in this direction. None to give way in all.
        """
        now = self._arm.time
        share = min((now - self._last) / _EASE_S, 0.5)
        self._last = now
        force = self.measured
        if force is None:
            return
        if along is not None:
            force = force - (force @ along) * along
        self._arm.yield_to(share * force)

    def soften(self) -> Iterator[None]:
        """Become soft at rest, and give way until little force is left; once per tick.

        Raises:
            Failure: ``BUSY`` when another leaf moves the arm.
        """
        arm = self._arm
        arm.begin(Trajectory.rest(arm.setpoint.q, arm.period), may_touch=True, compliant=True)
        arm.controller.compliance.soften(_FRICTION_RAD_S)
        yield from self.relax()

    def relax(self) -> Iterator[None]:
        """Give way, as a soft arm, until little force is left; once per tick."""
        self._last = began = self._arm.time
        while self._arm.time - began < _CALM_S:
            yield None
            self._arm.check()
            self.ease()

    def rest(self, hold: Callable[[], None] | None = None) -> Iterator[None]:
        """Let the set-point come to where the arm is; once per tick.

        The arm stays soft until its next motion: a stiff one would press with 60 N for each 0.1 mm
        of the servo's error.

        Args:
            hold: Called once per tick instead of `ease`.

        Raises:
            Failure: ``BUSY`` when another leaf moves the arm.
        """
        arm = self._arm
        hold = self.ease if hold is None else hold
        limits = arm.robot.limits
        for _ in range(_RESTS):
            here = np.clip(arm.q, limits.lower, limits.upper)
            motion = point_to_point(arm.setpoint.q, here, limits, arm.period)
            running = arm.begin(motion, may_touch=True, compliant=True)
            began = arm.time
            while not running.done or arm.time - began < _REST_S:
                yield None
                arm.check()
                hold()


_FRICTION_RAD_S: Final = 0.1
"""Velocity over which the arm's dry friction is fed forward: at a smaller one, a UR10 that breaks
away presses on a handle with 50 N."""

_RESTS: Final = 2
_REST_S: Final = 0.15
"""Motions of the set-point to where the arm is, which moves meanwhile; least time of each, s."""

_CALM_S: Final = 0.4
"""Time in which an arm gives way at rest, s."""
