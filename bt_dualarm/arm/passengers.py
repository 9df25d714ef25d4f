"""What rides on a held object: how steeply and fast it can be carried, and whether it stayed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from bt_dualarm.arm.time_scale import largest_scale, link_motion
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.planning.path_constraints import Cone, PathConstraint
from bt_dualarm.robots.robot import Robot
from bt_dualarm.sim.grippers import Attachment
from bt_dualarm.sim.object_body import ObjectBody, body_of
from bt_dualarm.sim.passengers import Passenger
from bt_dualarm.sim.world import World
from bt_dualarm.trajectory.set_points import at_scale
from bt_dualarm.trajectory.trajectory import Trajectory

STEADY: Final = 0.6
"""Fraction of the slope on which a passenger would slide or tip up to which it is carried."""

_WALLED: Final = 0.35
"""Tangent of the slope up to which what walls surround is carried, however round it is."""

_SOLE_M: Final = 3e-4
_SOLE_SLOPE: Final = math.tan(math.radians(5.0))
"""Height above its lowest point, m, and slope from there, up to which a passenger's surface counts
as its sole: a carrier may have leaned as it was grasped."""

_DIRECTIONS: Final = 16
"""Number of horizontal directions in which a passenger may tip."""

_UP: Final = np.array((0.0, 0.0, 1.0))
_GRAVITY: Final = np.array((0.0, 0.0, -9.81))


def steepest(world: World, obj: str, one: Passenger) -> float:
    """Tangent of the slope up to which a passenger is carried on a held object.

    On a slope it slides if the tangent exceeds its coefficient of friction, and tips if that
    exceeds the distance of its center of mass from the edge of its sole, as a fraction of the
    center's height. An acceleration across acts like a slope.

    Args:
        world: World that both are in.
        obj: Name of the held object.
        one: The passenger.
    """
    spec = world.objects[one.object]
    carrier = body_of(world.objects[obj])
    # MuJoCo takes the larger coefficient of a pair; it may stand on another passenger.
    under = [world.objects[name].friction for name in (obj, *_others(world, obj, one))]
    slides = max(spec.friction, min(under))
    body = body_of(spec)
    center = one.relative.apply(body.center)
    across = _across(one.up)
    tips = _tips(body, one, center, across)
    limit = STEADY * min(slides, tips)
    if all(math.isfinite(carrier.ray(center, direction)) for direction in across[::2]):
        limit = max(limit, _WALLED)
    return limit


def stands_at(world: World, obj: str, pose: Pose) -> bool:
    """Whether all that rides on a held object stays where it is with the object at a pose.

    Args:
        world: World that both are in.
        obj: Name of the held object.
        pose: Pose of the object in the world, at rest.
    """
    return all(_stands(world, obj, one, pose) for one in world.passengers_of(obj))


def _stands(world: World, obj: str, one: Passenger, pose: Pose) -> bool:
    """Whether a passenger stays where it is on a held object at a pose in the world."""
    return _tilt(pose, one) <= math.atan(steepest(world, obj, one))


def _others(world: World, obj: str, one: Passenger) -> Iterator[str]:
    return (each.object for each in world.passengers_of(obj) if each.object != one.object)


def _tilt(pose: Pose, one: Passenger) -> float:
    """Angle by which a held object at a pose in the world tilts a passenger, rad."""
    return math.acos(min(max(float(pose.turn(one.up) @ _UP), -1.0), 1.0))


def _across(up: Vector) -> Vector:
    """Unit vectors at right angles to ``up``, of shape (n, 3)."""
    first = np.cross(up, np.eye(3)[int(np.argmin(np.abs(up)))])
    first /= np.linalg.norm(first)
    second = np.cross(up, first)
    angles = np.arange(_DIRECTIONS) * 2.0 * np.pi / _DIRECTIONS
    directions: Vector = np.outer(np.cos(angles), first) + np.outer(np.sin(angles), second)
    return directions


def _tips(body: ObjectBody, one: Passenger, center: Vector, across: Vector) -> float:
    """Tangent of the least slope on which a passenger tips, in whichever direction."""
    points = one.relative.apply(body.corners)
    heights = points @ one.up
    lowest = int(heights.argmin())
    above = heights - heights[lowest]
    aside = np.linalg.norm(points - points[lowest] - above[:, None] * one.up, axis=1)
    sole = points[above <= _SOLE_M + _SOLE_SLOPE * aside]
    room = float(((sole - center) @ across.T).max(axis=0).min())
    return max(room, 0.0) / max(float(center @ one.up) - float(heights[lowest]), 1e-6)


def riding_speed_scale(motion: Trajectory, world: World, arm: str) -> float:
    """Largest uniform time scale of a motion, up to 1, at which passengers stay where they are.

    Parts of the motion that tilt them farther than they can stand, as to pour them out, do not
    count: no speed would keep them.

    Args:
        motion: Motion from rest to rest.
        world: World that the arm is in.
        arm: Name of the arm.
    """
    scale = 1.0
    for held in world.attachments:
        upon = world.passengers_of(held.object) if held.arm == arm else ()
        for one in upon:
            scale = min(scale, _scale(motion, world, held, one))
    return scale


def _scale(motion: Trajectory, world: World, held: Attachment, one: Passenger) -> float:
    place = held.relative.apply(one.relative.apply(body_of(world.objects[one.object]).center))
    moved = link_motion(motion, world.nominal[held.arm], place)
    up = moved.turns @ held.relative.turn(one.up)
    slope = steepest(world, held.object, one)

    def stays(scale: float, samples: slice | np.ndarray) -> np.ndarray:
        felt = _GRAVITY - scale**2 * moved.accelerations[samples]
        down = -np.einsum("ni,ni->n", felt, up[samples])
        sideways = np.linalg.norm(felt + down[:, None] * up[samples], axis=1)
        kept: np.ndarray = (down > 0.0) & (sideways <= slope * down)
        return kept

    bearable = stays(0.0, slice(None))
    return largest_scale(lambda scale: bool(stays(scale, bearable).all()))


def poured_out(motion: Trajectory, world: World, arm: str) -> frozenset[str]:
    """Names of the passengers that a motion tilts farther than they can stand, as to pour them out.

    Args:
        motion: Motion of the arm.
        world: World that the arm is in.
        arm: Name of the arm.
    """
    found = set[str]()
    for held in world.attachments:
        upon = world.passengers_of(held.object) if held.arm == arm else ()
        if not upon:
            continue
        turns = link_motion(motion, world.nominal[arm], held.relative.position).turns
        for one in upon:
            up = turns @ held.relative.turn(one.up)
            if up[:, 2].min() < math.cos(math.atan(steepest(world, held.object, one))):
                found.add(one.object)
    return frozenset(found)


def slowed_for_passengers(motion: Trajectory, world: World, arm: str) -> Trajectory:
    """A motion at the speed at which passengers stay, see `riding_speed_scale`."""
    scale = riding_speed_scale(motion, world, arm)
    return motion if scale >= 1.0 else at_scale(motion, scale)


def kept_upright(
    world: World, robot: Robot, kinematics: Kinematics, arm: str, ends: Sequence[Vector]
) -> PathConstraint | None:
    """Constraint of a planned motion that keeps what rides on a held object standing.

    None without passengers, and if they would not stand at one of the ends: whoever requests that
    wants to pour them out.

    Args:
        world: World that the arm is in.
        robot: Its robot.
        kinematics: Its kinematics.
        arm: Name of the arm.
        ends: Configurations at both ends, each of shape (dof,), rad.
    """
    for held in world.attachments:
        upon = world.passengers_of(held.object) if held.arm == arm else ()
        if not upon:
            continue
        most = math.atan(min(steepest(world, held.object, one) for one in upon))
        cone = Cone("upright", upon[0].up, most, _UP)
        in_tool = robot.tool.inverse @ held.relative
        constraint = PathConstraint(robot, kinematics.base, in_tool, (cone,))
        if not any(constraint.of_tool(kinematics.forward(q)) for q in ends):
            return constraint
    return None


class PassengerCheck:
    """Whether what rides on an object still does so later; for the score only.

    What the goals tilt farther than it can stand, as to pour it out, is not checked.

    Args:
        world: World that it is in.
        obj: Name of the object.
        goals: Poses of the object in the world to which it will be carried.
    """

    def __init__(self, world: World, obj: str, goals: Sequence[Pose]) -> None:
        self._world = world
        self._object = obj
        self._names = [
            one.object
            for one in world.passengers_of(obj)
            if all(_stands(world, obj, one, goal) for goal in goals)
        ]

    def refuse_spilled(self) -> None:
        """Check that all are still on the object, where an arm has not taken them away.

        Raises:
            Failure: ``SPILLED``.
        """
        world = self._world
        if not self._names or self._object not in world.objects:
            return
        left = {one.object for one in world.passengers_of(self._object, self._names)}
        lost = [
            name
            for name in self._names
            if name not in left and name in world.objects and not world.attachments.holders(name)
        ]
        if lost:
            raise Failure(
                "SPILLED",
                f"{' and '.join(lost)} {'is' if len(lost) == 1 else 'are'} no longer on "
                f"{self._object!r}",
                spilled=len(lost),
            )


def passengers_to(world: World, arm: str, now: Pose, then: Pose) -> list[PassengerCheck]:
    """Checks of what rides on the objects that an arm holds, for a motion that is to keep it there.

    Args:
        world: World that the arm is in.
        arm: Name of the arm that will move.
        now: Pose of its tool in the world.
        then: The same at the end.

    Raises:
        Failure: ``SPILLED``, if something would not stay there with the tool at that pose.
    """
    found = list[PassengerCheck]()
    for held in world.attachments:
        upon = world.passengers_of(held.object) if held.arm == arm else ()
        if not upon:
            continue
        in_tool = world.robots[arm].tool.inverse @ held.relative
        object_pose = then @ in_tool
        stands_now = stands_at(world, held.object, now @ in_tool)
        if stands_now and not stands_at(world, held.object, object_pose):
            raise Failure(
                "SPILLED",
                f"{' and '.join(one.object for one in upon)} would fall off {held.object!r} there: "
                "set it down first",
            )
        found.append(PassengerCheck(world, held.object, [object_pose]))
    return found
