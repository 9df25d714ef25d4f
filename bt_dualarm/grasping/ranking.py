"""Ranking of grasps: by margin, by what is around, and by how the arm gets there."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from bt_dualarm.core.pose import Matrix, Pose
from bt_dualarm.grasping.candidates import cup_grasps, jaw_grasps
from bt_dualarm.grasping.grasp import CupMeasures, Grasp, JawMeasures, Load
from bt_dualarm.grasping.solids import Box, Solid

# Which grasp first: by margin, by what is around, and by how the arm gets there.


ENOUGH_ROOM = 0.02
"""Clearance in m beyond which more of it counts for nothing."""

_ENOUGH_MARGIN = 4.0
_TOUCHING = 1e-4  # m, that rounding takes
_AROUND = 8  # points of a ring about the palm
_POINTS = 4  # along the longest edge of a finger


@dataclass(frozen=True, eq=False)
class Obstacle:
    """Something that stands around.

    Attributes:
        solid: Shape of it, in its own frame.
        pose: Pose in the world.
    """

    solid: Solid
    pose: Pose


@dataclass(frozen=True, eq=False)
class RankedGrasp:
    """A grasp where the object lies.

    Attributes:
        grasp: Grasp on the object.
        tool: Pose of the tool in the world.
        clearance: Least distance in m of the open fingers from what stands around.
        cost: What it is ranked by, the less the better.
    """

    grasp: Grasp
    tool: Pose
    clearance: float
    cost: float


def ranked(
    grasps: Sequence[Grasp],
    lies: Pose,
    jaw: JawMeasures | None,
    obstacles: Sequence[Obstacle],
    reach: Callable[[Pose], float],
) -> tuple[RankedGrasp, ...]:
    """Grasps that have room and may be reached, the best first.

    Margin up to four times the load, clearance up to `ENOUGH_ROOM` and the effort of the arm count
    alike; more of the first two is worth nothing.

    Args:
        grasps: Grasps on the object.
        lies: Pose of the object in the world.
        jaw: Measures of a parallel gripper; None of a cup, which asks for no room beside it.
        obstacles: What stands around, the object itself not among it.
        reach: Effort of the arm to get to a tool pose in the world, from 0 to 1; infinite where it
            does not get there.
    """
    found = []
    for grasp, room in zip(grasps, _rooms(grasps, lies, jaw, obstacles), strict=True):
        if room < -_TOUCHING:
            continue
        tool = lies @ grasp.tool
        effort = reach(tool)
        if math.isinf(effort):
            continue
        lacks_margin = 1.0 - min(grasp.margin - 1.0, _ENOUGH_MARGIN - 1.0) / (_ENOUGH_MARGIN - 1.0)
        lacks_room = 1.0 - min(max(room, 0.0), ENOUGH_ROOM) / ENOUGH_ROOM
        found.append(RankedGrasp(grasp, tool, room, lacks_margin + lacks_room + effort))
    return tuple(sorted(found, key=lambda one: one.cost))


def finger_points(jaw: JawMeasures, opening: float) -> Matrix:
    """Points all over the surfaces of both fingers, in the tool frame, of shape (n, 3), m.

    Args:
        jaw: Measures of the gripper.
        opening: Distance of the pads in m.
    """
    steps = np.linspace(-0.5, 0.5, _POINTS)
    x = steps * jaw.pad_width
    y = 0.5 * opening + np.array([0.0, jaw.thickness])
    z = np.linspace(-jaw.palm, jaw.tip, 2 * _POINTS)
    one = np.array(np.meshgrid(x, y, z)).reshape(3, -1).T
    return np.vstack((one, one * np.array([1.0, -1.0, 1.0])))


def palm_points(jaw: JawMeasures) -> Matrix:
    """Points around the palm, at its face and behind it, in the tool frame, of shape (n, 3), m."""
    angles = np.arange(_AROUND) * 2.0 * np.pi / _AROUND
    ring = jaw.palm_radius * np.column_stack((np.cos(angles), np.sin(angles)))
    heights = -jaw.palm - np.array((0.0, 0.5, 1.0)) * jaw.palm_radius
    return np.array([(x, y, z) for z in heights for x, y in ring])


def _rooms(
    grasps: Sequence[Grasp], lies: Pose, jaw: JawMeasures | None, obstacles: Sequence[Obstacle]
) -> list[float]:
    """Least distance in m of palm and fingers, open or shut on the object, from what is around.

    Of one that has no room at all any distance that says so.
    """
    rooms = np.full(len(grasps), math.inf)
    if jaw is None or not grasps:
        return rooms.tolist()
    from bt_dualarm.grasping.grasp_kernels import narrow

    tools = np.array([(*one.tool.position, *one.tool.quaternion) for one in grasps])
    widths = np.array([(jaw.widest_opening, one.width) for one in grasps])
    points = _moving_points(jaw)
    for one in obstacles:
        pose = (lies.inverse @ one.pose).matrix
        narrow(*one.solid.form, pose, tools, widths, points, -_TOUCHING, rooms)
    return rooms.tolist()


def _moving_points(jaw: JawMeasures) -> Matrix:
    """Points of the closed gripper, and which way each moves as it opens, of shape (n, 4)."""
    fingers = finger_points(jaw, 0.0)
    palm = palm_points(jaw)
    ways = np.repeat((1.0, -1.0, 0.0), (len(fingers) // 2, len(fingers) // 2, len(palm)))
    return np.column_stack((np.vstack((fingers, palm)), ways))


# The kernels of this room, called once with what they are given later.


def warm_up_grasping() -> None:
    """Have candidates of fingers and of a cup, and the room around them, worked out once."""
    box = Box(np.full(3, 0.02))
    under = Obstacle(Box(np.full(3, 0.1)), Pose.from_rpy((0, 0, -0.13)))
    load = Load(0.1, np.array((0.0, 0.0, -9.81)), 8.0, np.zeros(3))
    jaw = JawMeasures(0.0, 0.085, 0.03, 0.022, 0.056, 0.015, 0.016, 20.0, 235.0, 0.8)
    ranked(jaw_grasps(box, jaw, load, 0.8), Pose.identity(), jaw, [under], lambda _: 0.0)
    cup_grasps(box, CupMeasures(0.01, 1e-3, 60.0, 0.5), load)
