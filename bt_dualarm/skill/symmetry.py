"""Rotations and poses in which an object looks the same."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import scipy

from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.perception.known_shape import KnownShape
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ObjectSpec

_ROUND = 24  # rotations of a round object to try, in a whole turn
_SAME_EDGE_M = 1e-6  # difference of the edges of a square
_UPRIGHT = math.cos(math.radians(5.0))  # cosine of an axis about which rotations keep pads level


def true_error(world: World, name: str, pose: Pose) -> tuple[float, float]:
    """Distance, m, and angle, rad, of an object's true pose from another one, up to its symmetry.

    For the score only: no sensor measures how an object lies in a gripper, or where it is left.
    """
    return KnownShape.of(world.objects[name]).away(world.object_pose(name), pose)


def poses_alike(spec: ObjectSpec, goal: Pose) -> list[tuple[float, Pose]]:
    """Poses in which an object looks as at a goal, with their rotation from it, rad.

    The goal itself is the first, then the smallest rotation. Round objects are rotated about their
    axis; spheres, prisms, boxes, and compounds and meshes with a symmetry about the vertical. What
    has a marker is not rotated.

    Args:
        spec: The object.
        goal: Its pose in the world.
    """
    shape = KnownShape.of(spec)
    axis, turns = _turns_into_itself(spec, shape, goal)
    center = goal.apply(np.array(shape.center))
    return [
        (angle, goal if angle == 0.0 else _turned(goal, axis, angle, center)) for angle in turns
    ]


def goals_alike(world: World, name: str, goal: Pose) -> list[tuple[float, Pose]]:
    """Poses in which an object looks as at a goal, for an arm that holds it.

    Those of `poses_alike`, then the same ones turned over: a can that a hand holds at its lower end
    is set down on its other end. Only boxes, prisms, cylinders and capsules are turned over, on
    which nothing stands and of which nothing moves on joints.

    Args:
        world: World of the arm.
        name: Name of the object.
        goal: Its pose in the world.

    Returns:
        The poses with their rotation from the goal, rad; the goal itself is the first.
    """
    spec = world.declared_objects[name]
    alike = poses_alike(spec, goal)
    if spec.marker or spec.shape not in _TURNED_OVER or spec.moved or world.passengers_of(name):
        return alike
    upright = np.abs(goal.rotation_matrix[2])
    vertical = 2 if spec.shape != "box" else int(upright.argmax())
    if spec.shape in ("box", "prism") and upright[vertical] < _UPRIGHT:
        return alike
    level = goal.rotation_matrix[:, vertical - 2]
    over = _turned(goal, level, np.pi, goal.apply(np.array(KnownShape.of(spec).center)))
    return [*alike, *((np.pi, pose) for _, pose in poses_alike(spec, over))]


_TURNED_OVER = ("box", "prism", "cylinder", "capsule")


def _turns_into_itself(
    spec: ObjectSpec, shape: KnownShape, goal: Pose
) -> tuple[Vector, list[float]]:
    """Axis in the world, of shape (3,), and rotations about it, rad, the smallest first."""
    up = np.array((0.0, 0.0, 1.0))
    if spec.marker:
        return up, [0.0]
    if spec.shape == "box":
        return up, _turns_of_box(goal, spec.size)
    if spec.shape == "prism":
        upright = abs(float(goal.rotation_matrix[2, 2])) >= _UPRIGHT
        return up, _turns(shape.fold) if upright else [0.0]
    if spec.shape == "sphere":
        return up, _turns(_ROUND)
    if shape.concave and shape.spins is None:
        upright = np.abs(goal.rotation_matrix[2])
        vertical = int(upright.argmax())
        return up, _turns(_fold(shape, vertical)) if upright[vertical] >= _UPRIGHT else [0.0]
    if shape.spins is None:
        return up, [0.0]
    axis = goal.turn(shape.spins)
    # An upright object is turned about the vertical itself, which keeps pads level.
    return up if abs(float(axis[2])) >= _UPRIGHT else axis, _turns(_ROUND)


def turns_alike(spec: ObjectSpec) -> list[Pose]:
    """Rotations in an object's frame about its axis after which it looks the same.

    The identity comes first, then the smallest rotation. A box turns about the axis across which it
    is square, otherwise by half a turn about its longest one; a compound or mesh about the axis of
    most rotations. What has a marker does not turn.
    """
    shape = KnownShape.of(spec)
    axis = np.array((0.0, 0.0, 1.0))
    turns = [0.0]
    if spec.marker:
        pass
    elif spec.shape == "box":
        edges = np.array(spec.size)
        unequal = [abs(edges[i - 2] - edges[i - 1]) for i in range(3)]
        is_square = min(unequal) < _SAME_EDGE_M
        # Of a cube, the upright axis.
        along = 2 - int(np.argmin(unequal[::-1])) if is_square else int(np.argmax(edges))
        axis = np.eye(3)[along]
        turns = _turns(4 if is_square else 2)
    elif spec.shape == "prism":
        turns = _turns(shape.fold)
    elif shape.spins is not None:
        axis = np.asarray(shape.spins, dtype=float)
        turns = _turns(_ROUND)
    elif shape.concave:
        along = max((2, 1, 0), key=lambda axis: _fold(shape, axis))
        axis = np.eye(3)[along]
        turns = _turns(_fold(shape, along))
    center = np.array(shape.center)
    rotations = [scipy.spatial.transform.Rotation.from_rotvec(turn * axis) for turn in turns]
    return [Pose.from_rotation(center - one.apply(center), one) for one in rotations]


def _fold(shape: KnownShape, axis: int) -> int:
    """Number of rotations about an axis that are worth trying: a wheel may have any number."""
    fold = shape.folds[axis]
    return max(count for count in range(1, min(fold, _ROUND) + 1) if fold % count == 0)


def _turns(count: int) -> list[float]:
    """Multiples of a fraction of a turn, rad, the smallest first: alternately to both sides."""
    steps = np.arange(1, count // 2 + 1) * (2.0 * np.pi / count)
    both = np.column_stack((steps, -steps)).ravel()
    return [0.0, *both[: count - 1].tolist()]


def _turns_of_box(goal: Pose, size: Sequence[float]) -> list[float]:
    """Rotations about the vertical, rad, that take a box with a vertical axis into itself."""
    upright = np.abs(goal.rotation_matrix[2])
    axis = int(upright.argmax())
    if upright[axis] < _UPRIGHT:
        return [0.0]
    one, other = (edge for i, edge in enumerate(size) if i != axis)
    quarter = abs(one - other) < _SAME_EDGE_M
    return [0.0, *((np.pi / 2, -np.pi / 2) if quarter else ()), np.pi]


def _turned(pose: Pose, axis: Vector, angle: float, center: Vector) -> Pose:
    """Pose rotated by an angle, rad, about a line of the world through a center, of shape (3,)."""
    if axis[2] == 1.0:
        turn = Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, angle))
    else:
        turn = Pose.from_rotation(
            np.zeros(3), scipy.spatial.transform.Rotation.from_rotvec(angle * axis)
        )
    turned = turn @ Pose(pose.position - center, pose.quaternion)
    return Pose(center + turned.position, turned.quaternion)
