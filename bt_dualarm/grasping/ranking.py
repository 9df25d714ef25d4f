"""Ranking of grasps by force margin, clearance from obstacles, and effort of the arm."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from bt_dualarm.core.pose import Matrix, Pose
from bt_dualarm.grasping.candidates import cup_grasps, jaw_grasps
from bt_dualarm.grasping.grasp import CupMeasures, Grasp, JawMeasures, Load
from bt_dualarm.grasping.solids import Box, Solid

ENOUGH_ROOM = 0.02
"""Clearance above which more of it does not improve a grasp, m."""

_ENOUGH_MARGIN = 4.0
"""Force margin above which more of it does not improve a grasp."""

_TOUCHING = 1e-4
"""Penetration that counts as rounding, m."""

_AROUND = 8
"""Number of points of a ring around the palm."""

_POINTS = 4
"""Number of points along the width of a finger; twice as many along its length."""


@dataclass(frozen=True, eq=False)
class Obstacle:
    """Obstacle near an object to grasp.

    Attributes:
        solid: Shape in its own frame.
        pose: Pose in the world.
    """

    solid: Solid
    pose: Pose


@dataclass(frozen=True, eq=False)
class RankedGrasp:
    """Grasp of an object at its pose in the world.

    Attributes:
        grasp: Grasp on the object.
        tool: Pose of the tool in the world.
        clearance: Smallest distance of the gripper from the obstacles, m.
        cost: Cost by which grasps are ranked, lowest first.
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
    """Grasps that are free of collisions and within reach, best first.

    Margin up to four times the load, clearance up to `ENOUGH_ROOM`, and the effort of the arm have
    equal weights.

    Args:
        grasps: Grasps on the object.
        lies: Pose of the object in the world.
        jaw: Dimensions of a parallel gripper; None for a cup, which needs no clearance beside it.
        obstacles: Obstacles, without the object itself.
        reach: Effort of the arm to get to a tool pose in the world, in [0, 1]; infinite if it
            cannot.
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
    return tuple(sorted(found, key=lambda candidate: candidate.cost))


def _rooms(
    grasps: Sequence[Grasp], lies: Pose, jaw: JawMeasures | None, obstacles: Sequence[Obstacle]
) -> list[float]:
    """Clearance of palm and fingers, open or closed on the object, from the obstacles, m.

    Of grasps in collision, any value below `-_TOUCHING`.
    """
    rooms = np.full(len(grasps), math.inf)
    if jaw is None or not grasps:
        return rooms.tolist()
    from bt_dualarm.grasping.grasp_kernels import lower_clearances

    # In the object's frame, where the grasps are given: only the obstacles need a transform.
    tools = np.array([(*grasp.tool.position, *grasp.tool.quaternion) for grasp in grasps])
    widths = np.array([(jaw.widest_opening, grasp.width) for grasp in grasps])
    points = _moving_points(jaw)
    for obstacle in obstacles:
        pose = (lies.inverse @ obstacle.pose).matrix
        lower_clearances(*obstacle.solid.form, pose, tools, widths, points, -_TOUCHING, rooms)
    return rooms.tolist()


def _moving_points(jaw: JawMeasures) -> Matrix:
    """Points of the closed gripper, and the direction of each as it opens, of shape (n, 4)."""
    fingers = finger_points(jaw, 0.0)
    palm = palm_points(jaw)
    signs = np.repeat((1.0, -1.0, 0.0), (len(fingers) // 2, len(fingers) // 2, len(palm)))
    return np.column_stack((np.vstack((fingers, palm)), signs))


def finger_points(jaw: JawMeasures, opening: float) -> Matrix:
    """Points on the surfaces of both fingers in the tool frame, of shape (n, 3), m.

    Args:
        jaw: Dimensions of the gripper.
        opening: Distance of the pads, m.
    """
    steps = np.linspace(-0.5, 0.5, _POINTS)
    x = steps * jaw.pad_width
    y = 0.5 * opening + np.array([0.0, jaw.thickness])
    z = np.linspace(-jaw.palm, jaw.tip, 2 * _POINTS)
    finger = np.array(np.meshgrid(x, y, z)).reshape(3, -1).T
    return np.vstack((finger, finger * np.array([1.0, -1.0, 1.0])))


def palm_points(jaw: JawMeasures) -> Matrix:
    """Points around the palm, on its face and behind it, in the tool frame, of shape (n, 3), m."""
    angles = np.arange(_AROUND) * 2.0 * np.pi / _AROUND
    ring = jaw.palm_radius * np.column_stack((np.cos(angles), np.sin(angles)))
    heights = -jaw.palm - np.array((0.0, 0.5, 1.0)) * jaw.palm_radius
    return np.array([(x, y, z) for z in heights for x, y in ring])


def warm_up_grasping() -> None:
    """Compile all kernels of grasping, on a cube above a support."""
    box = Box(np.full(3, 0.02))
    under = Obstacle(Box(np.full(3, 0.1)), Pose.from_rpy((0, 0, -0.13)))
    load = Load(0.1, np.array((0.0, 0.0, -9.81)), 8.0, np.zeros(3))
    jaw = JawMeasures(0.0, 0.085, 0.03, 0.022, 0.056, 0.015, 0.016, 20.0, 235.0, 0.8)
    ranked(jaw_grasps(box, jaw, load, 0.8), Pose.identity(), jaw, [under], lambda _: 0.0)
    cup_grasps(box, CupMeasures(0.01, 1e-3, 60.0, 0.5), load)
