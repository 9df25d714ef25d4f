"""Candidates of a suction cup on a solid: places that are flat enough for its rim."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from bt_dualarm.motion.grasping.antipodal import pinches, square_to
from bt_dualarm.motion.grasping.grasp import Grasp
from bt_dualarm.motion.grasping.gripper_measures import CupMeasures, Load
from bt_dualarm.motion.grasping.holding_force import suction_force
from bt_dualarm.motion.grasping.pads import pressed
from bt_dualarm.motion.grasping.solids import Solid
from bt_dualarm.pose import Matrix, Pose, Vector

TURNS = 4
"""Ways to turn the tool about the normal of a face, of a whole turn."""

_RIM = 16
_SMOOTH = math.radians(3.0)
_SPOT = np.array([1e-4, 1e-4])  # m: where a normal is looked at


def cup_grasps(solid: Solid, cup: CupMeasures, load: Load, seed: int = 0) -> tuple[Grasp, ...]:
    """All candidates, firmest first.

    Args:
        solid: Solid that is to be taken, in its own frame.
        cup: Measures of the cup.
        load: What the grip has to bear.
        seed: Seed of what is sampled, of meshes.
    """
    found = []
    for place, normal in _places(solid, load.gravity, seed):
        if not seals(solid, cup, place, normal):
            continue
        force = suction_force(load, place, normal, cup)
        if force > cup.most_force:
            continue
        margin = cup.most_force / max(force, 1e-9)
        found += [Grasp(tool, 0.0, force, margin) for tool in _tools(place, normal)]
    return tuple(sorted(found, key=lambda grasp: grasp.force))


def seals(solid: Solid, cup: CupMeasures, place: Vector, normal: Vector) -> bool:
    """Whether the whole rim meets the solid, and none of it lower than it bends.

    Args:
        solid: Solid below the cup.
        cup: Measures of the cup.
        place: Middle of the rim, of shape (3,), m.
        normal: Direction from the solid to the cup, of unit length, of shape (3,).
    """
    return bool(solid.distance(_rim(cup, place, normal)).max() <= 0.0)


def _rim(cup: CupMeasures, place: Vector, normal: Vector) -> Matrix:
    """Points of the rim pressed down as far as it bends, of shape (n, 3), m."""
    first = square_to(normal, np.array([1.0, 0.0, 0.0]))
    angles = np.arange(_RIM) * 2.0 * np.pi / _RIM
    ring = np.outer(np.cos(angles), first) + np.outer(np.sin(angles), np.cross(normal, first))
    rim: Matrix = place - cup.bends * normal + cup.radius * ring
    return rim


def _places(solid: Solid, gravity: Vector, seed: int) -> Iterator[tuple[Vector, Vector]]:
    """Places on the surface with their normals, each of shape (3,): both ends of its pinches."""
    length = float(np.linalg.norm(gravity))
    down = gravity / length if length > 0.0 else np.array([0.0, 0.0, -1.0])
    for pinch in pinches(solid, down, np.random.default_rng(seed)):
        for normal in (pinch.axis, -pinch.axis):
            spot = pressed(solid, pinch.center, normal, pinch.around, _SPOT)
            if spot is not None and spot.slope < _SMOOTH:
                yield spot.middle, normal


def _tools(place: Vector, normal: Vector) -> Iterator[Pose]:
    """Tool frames whose z axis leads into the surface."""
    x = square_to(normal, np.array([1.0, 0.0, 0.0]))
    matrix = np.eye(4)
    matrix[:3] = np.column_stack((x, np.cross(-normal, x), -normal, place))
    first = Pose.from_matrix(matrix)
    for turn in np.arange(TURNS) * 2.0 * np.pi / TURNS:
        yield first @ Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, float(turn)))
