"""Places where two pads can shut on a solid, and the room that a gripper has there: compiled."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.motion.pinching.pad_kernels import hold, pinch
from bt_dualarm.motion.pinching.solid_kernels import cross, distance, dot, reach
from bt_dualarm.pose import Matrix, Vector

_ROLLS: Final = 8  # approaches around the line of a pinch, of a whole turn
_HIGHER: Final = (0.0, 0.004, 0.008, 0.016)
"""Metres by which a candidate stays behind the deepest one: where tips need room below."""


@kernel
def shut_along(
    kind: int, numbers: Matrix, pinches: Matrix, jaw: Vector, forces: Matrix, center: Vector,
    friction: float, found: Matrix,
) -> int:  # fmt: skip
    """Enter where pads that shut along pinches hold a solid; how many such places there are.

    Args:
        kind: Kind of the solid, as `Form.kind`.
        numbers: Its numbers, as `Form.numbers`.
        pinches: Center, axis, and direction of the first approach of each, of shape (n, 9).
        jaw: Length and width of a pad, room from the pads' middle to the palm, least width that is
            held, room of an open pad from the middle (m), most force (N), of shape (6,).
        forces: Loads at the centre of mass, of shape (m, 3), N.
        center: The centre of mass, of shape (3,), m.
        friction: Coefficient of friction between pads and solid.
        found: Middle of the pads, their axis, the approach, width and least force of each, of
            shape (n * 32, 11), to be filled; less deep ones after deeper ones.
    """
    count = 0
    for row in pinches:
        other = cross(row[3:6], row[6:9])
        for roll in range(_ROLLS):
            angle = roll * 2.0 * math.pi / _ROLLS
            approach = math.cos(angle) * row[6:9] + math.sin(angle) * other
            behind = reach(kind, numbers, -approach) + dot(row, approach)
            for higher in _HIGHER:
                entry = found[count]
                entry[:3] = row[:3] - (max(0.0, behind - jaw[2]) + higher) * approach
                entry[3:6], entry[6:9] = row[3:6], approach
                if not _held(kind, numbers, jaw, forces, center, friction, entry):
                    break
                count += 1 if entry[10] <= jaw[5] else 0
    return count


@kernel
def _held(
    kind: int, numbers: Matrix, jaw: Vector, forces: Matrix, center: Vector, friction: float,
    entry: Vector,
) -> bool:  # fmt: skip
    """Whether pads come around the solid and shut on it; enter their middle, width and force.

    Arguments as of `shut_along`; ``entry`` is a row of ``found``, of shape (11,).
    """
    between = np.empty(6)
    middle, axis, approach = entry[:3], entry[3:6], entry[6:9]
    if not hold(kind, numbers, middle, axis, approach, jaw[:2], between):
        return False
    width = between[3]
    if width < jaw[3]:
        return False
    at = dot(between, axis)
    beyond = max(reach(kind, numbers, axis) - at, reach(kind, numbers, -axis) + at)
    if beyond > jaw[4]:
        return False
    left = math.tan(math.atan(friction) - between[5])
    needed = pinch(forces, center - between[:3], axis, width, between[4], left)
    entry[9], entry[10] = width, needed.max()
    entry[:3] += dot(between[:3] - middle, axis) * axis
    return True


@kernel
def narrow(
    kind: int, numbers: Matrix, pose: Matrix, tools: Matrix, widths: Matrix, points: Matrix,
    least: float, rooms: Vector,
) -> None:  # fmt: skip
    """Lessen the room of grippers, of shape (n,), to their least distance in m from one solid.

    Args:
        kind: Kind of the solid, as `Form.kind`.
        numbers: Its numbers, as `Form.numbers`.
        pose: Pose of it in the world, of shape (4, 4).
        tools: Position and quaternion wxyz of each tool in the world, of shape (n, 7).
        widths: Openings at which each gripper is looked at, of shape (n, k), m.
        points: Points of a closed gripper in the tool frame, and by which share of half the
            opening each moves along y, of shape (m, 4), m.
        least: Room in m below which nobody asks how much less it is.
        rooms: Room of each gripper, changed.
    """
    around, turn = _radius(points, widths.max()), np.empty((3, 3))
    for one in range(len(tools)):
        if rooms[one] < least:
            continue
        place = _into(pose, tools[one], turn)
        if distance(kind, numbers, place[0], place[1], place[2]) - around < rooms[one]:
            for opening in widths[one]:
                room = _room(kind, numbers, place, turn, opening, points, least)
                rooms[one] = min(rooms[one], room)


@kernel
def _room(
    kind: int, numbers: Matrix, place: Vector, turn: Matrix, opening: float, points: Matrix,
    least: float,
) -> float:  # fmt: skip
    """Least distance in m of a gripper from a solid, in whose frame it is; as of `narrow`."""
    room = np.inf
    for point in points:
        x, y, z = point[0], point[1] + 0.5 * opening * point[3], point[2]
        a = place[0] + turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z
        b = place[1] + turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z
        c = place[2] + turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z
        room = min(room, distance(kind, numbers, a, b, c))
        if room < least:
            break
    return room


@kernel
def _radius(points: Matrix, widest: float) -> float:
    """Distance in m from the tool frame to the farthest point of an open gripper."""
    farthest = 0.0
    for point in points:
        y = abs(point[1]) + 0.5 * widest * abs(point[3])
        farthest = max(farthest, math.sqrt(point[0] ** 2 + y * y + point[2] ** 2))
    return farthest


@kernel
def _into(pose: Matrix, tool: Vector, turn: Matrix) -> Vector:
    """Place of a tool in a frame, of shape (3,), m; enters its axes there, of shape (3, 3)."""
    w, x, y, z = tool[3], tool[4], tool[5], tool[6]
    axes = np.array((
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)),
        (2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)),
        (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)),
    ))  # fmt: skip
    place = np.zeros(3)
    for i in range(3):
        for k in range(3):
            place[i] += pose[k, i] * (tool[k] - pose[k, 3])
            turn[i, k] = 0.0
            for j in range(3):
                turn[i, k] += pose[j, i] * axes[j, k]
    return place
