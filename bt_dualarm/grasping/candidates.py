"""Grasp candidates: antipodal points for fingers, flat places for suction cups."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import singledispatch

import numpy as np

from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.grasping.grasp import (
    CupMeasures,
    Grasp,
    JawMeasures,
    Load,
    pad_contact,
    shaken,
    suction_force,
)
from bt_dualarm.grasping.solids import Box, Capsule, Cylinder, MeshSolid, Solid

# Pairs of opposite points: where two fingers may close on a solid.


AZIMUTHS = 6
"""Directions around an axis of revolution, of half a turn: the other half is the same pair."""

_PITCHES = np.deg2rad([0.0, 30.0, -30.0, 60.0, -60.0])
_LARGE = 0.02  # m: half of an edge that has room for pads beside its middle
_SAMPLES = 48  # of a mesh


@dataclass(frozen=True, eq=False)
class AntipodalPair:
    """A line on which two pads close.

    Attributes:
        center: Place between the pads, of shape (3,), m.
        axis: Direction of the line, of unit length, of shape (3,).
        around: Direction square to it from which approaches are turned, likewise.
    """

    center: Vector
    axis: Vector
    around: Vector


@singledispatch
def antipodal_pairs(
    solid: Solid,
    down: Vector,  # noqa: ARG001 - of the functions below, that stand for this one
    rng: np.random.Generator,  # noqa: ARG001 - as above
) -> Iterator[AntipodalPair]:
    """Lines along which a solid's surface is opposite itself, in its own frame.

    Args:
        solid: Solid that is to be taken.
        down: Direction of gravity, of unit length, of shape (3,): of what has no sides of its own,
            lines that lie level come first.
        rng: Generator for what is sampled, of meshes.

    Raises:
        TypeError: Nothing is known of this kind of solid.
    """
    raise TypeError(f"no pinches are known of a {type(solid).__name__}")


@antipodal_pairs.register
def _(solid: Box, down: Vector, rng: np.random.Generator) -> Iterator[AntipodalPair]:  # noqa: ARG001 - as above
    axes = np.eye(3)
    for i in range(3):
        for j in ((i + 1) % 3, (i + 2) % 3):
            shares = (0.0, 0.5, -0.5) if solid.half[j] > _LARGE else (0.0,)
            for share in shares:
                if share or j == (i + 1) % 3:  # the middle once
                    yield AntipodalPair(share * solid.half[j] * axes[j], axes[i], axes[(i + 1) % 3])


@antipodal_pairs.register
def _(solid: Cylinder, down: Vector, rng: np.random.Generator) -> Iterator[AntipodalPair]:  # noqa: ARG001 - as above
    axis = np.array([0.0, 0.0, 1.0])
    yield from _diameters(axis, down, solid.half_length)
    for around in _half_turn(axis, down):
        yield AntipodalPair(np.zeros(3), axis, around)


@antipodal_pairs.register
def _(solid: Capsule, down: Vector, rng: np.random.Generator) -> Iterator[AntipodalPair]:  # noqa: ARG001 - as above
    if solid.half_length > 0.0:
        axis = np.array([0.0, 0.0, 1.0])
        yield from _diameters(axis, down, solid.half_length)
        yield AntipodalPair(np.zeros(3), axis, square_to(axis, down))
        return
    yield AntipodalPair(np.zeros(3), down, square_to(down, np.array([1.0, 0.0, 0.0])))
    for level in _half_turn(down, np.array([1.0, 0.0, 0.0])):
        for pitch in _PITCHES:
            axis = np.cos(pitch) * level + np.sin(pitch) * down
            yield AntipodalPair(np.zeros(3), axis, square_to(axis, down))


@antipodal_pairs.register
def _(solid: MeshSolid, down: Vector, rng: np.random.Generator) -> Iterator[AntipodalPair]:
    """Sampled points, each with what lies opposite: Chen and Burdick, ICRA 1993."""
    points, normals = solid.sample(_SAMPLES, rng)
    for point, normal in zip(points, normals, strict=True):
        found = solid.farthest_hit(point, -normal)
        if found is not None:
            yield AntipodalPair(0.5 * (point + found[0]), normal, square_to(normal, down))


def square_to(axis: Vector, wanted: Vector) -> Vector:
    """The unit vector square to ``axis`` that is nearest to one wanted; any if none is nearest."""
    across = wanted - (wanted @ axis) * axis
    if np.linalg.norm(across) < 1e-6:
        across = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
    unit: Vector = across / np.linalg.norm(across)
    return unit


def _diameters(axis: Vector, down: Vector, half_length: float) -> Iterator[AntipodalPair]:
    """Lines through an axis of revolution, level ones first."""
    shares = (0.0, 0.5, -0.5) if half_length > _LARGE else (0.0,)
    level = np.asarray(np.cross(axis, down), dtype=float)
    for across in _half_turn(axis, level):
        for share in shares:
            yield AntipodalPair(share * half_length * axis, across, axis)


def _half_turn(axis: Vector, wanted: Vector) -> Iterator[Vector]:
    """Directions around an axis over half a turn, that nearest to one wanted first."""
    first = square_to(axis, wanted)
    second = np.cross(axis, first)
    for angle in np.arange(AZIMUTHS) * np.pi / AZIMUTHS:
        yield np.cos(angle) * first + np.sin(angle) * second


# Candidates of a parallel gripper on a solid: pinches, turned about, that its fingers allow.


CLEAR = 0.002
"""Distance in m that open pads, and the palm, keep from what they come around."""

_EACH = 32  # grasps of a pinch at most


def jaw_grasps(
    solid: Solid, jaw: JawMeasures, load: Load, friction: float, seed: int = 0
) -> tuple[Grasp, ...]:
    """All candidates, firmest first.

    Args:
        solid: Solid that is to be taken, in its own frame.
        jaw: Measures of the gripper.
        load: What the grip has to bear.
        friction: Coefficient of friction between the pads and the solid.
        seed: Seed of what is sampled, of meshes.
    """
    length = float(np.linalg.norm(load.gravity))
    down = load.gravity / length if length > 0.0 else np.array([0.0, 0.0, -1.0])
    lines = np.array([
        np.concatenate((one.center, one.axis, one.around))
        for one in antipodal_pairs(solid, down, np.random.default_rng(seed))
    ]).reshape(-1, 9)  # fmt: skip
    rows = _shut(solid, jaw, load, friction, lines)
    found = [grasp for row in rows for grasp in _both_ways(row, jaw)]
    return tuple(sorted(found, key=lambda grasp: grasp.force))


def _shut(solid: Solid, jaw: JawMeasures, load: Load, friction: float, lines: Matrix) -> Matrix:
    """Where the pads hold it, one row each: as `shut_along` enters them."""
    from bt_dualarm.grasping.grasp_kernels import shut_along

    deep = jaw.palm + jaw.pad_center - CLEAR
    room = 0.5 * jaw.widest_opening - CLEAR
    least = jaw.least_opening + CLEAR
    measures = np.array((jaw.pad_length, jaw.pad_width, deep, least, room, jaw.most_force))
    found = np.empty((_EACH * len(lines), 11))
    center = np.ascontiguousarray(load.center, dtype=float)
    count = shut_along(*solid.form, lines, measures, shaken(load), center, float(friction), found)
    return found[:count]


def _both_ways(row: Vector, jaw: JawMeasures) -> Iterator[Grasp]:
    """The grasps of one row: either finger may be on either side."""
    axis = row[3:6].tolist()
    approach = row[6:9].tolist()
    width, force = row[9:].tolist()
    margin = jaw.most_force / max(force, 1e-9)
    (a, b, c) = axis
    (d, e, f) = approach
    x = (b * f - c * e, c * d - a * f, a * e - b * d)
    rows = list(zip(x, axis, approach, strict=True))
    tool = Pose.from_axes(row[:3] - jaw.pad_center * row[6:9], rows)
    w, i, j, k = tool.quaternion.tolist()
    sign = -1.0 if k > 0.0 else 1.0  # so that w is not negative
    yield Grasp(tool, width, force, margin)
    yield Grasp(Pose(tool.position, sign * np.array((-k, j, -i, w))), width, force, margin)


def least_width(solid: Solid, seed: int = 0) -> float:
    """Least distance in m between opposite points of a solid: what a gripper has to open to."""
    down = np.array([0.0, 0.0, -1.0])
    rng = np.random.default_rng(seed)
    return min(
        solid.reach(pinch.axis) + solid.reach(-pinch.axis)
        for pinch in antipodal_pairs(solid, down, rng)
    )


# Candidates of a suction cup on a solid: places that are flat enough for its rim.


TURNS = 4
"""Ways to turn the tool about the normal of a face, of a whole turn."""

_RIM = 16
_SMOOTH = math.radians(3.0)
_NORMAL_SPOT = np.array([1e-4, 1e-4])  # m: where a normal is looked at


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
    for pinch in antipodal_pairs(solid, down, np.random.default_rng(seed)):
        for normal in (pinch.axis, -pinch.axis):
            spot = pad_contact(solid, pinch.center, normal, pinch.around, _NORMAL_SPOT)
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
