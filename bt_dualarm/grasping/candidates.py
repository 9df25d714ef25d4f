"""Grasp candidates on a solid: antipodal pairs for two fingers, flat spots for a suction cup.

`jaw_grasps` closes a parallel gripper along every antipodal pair, from several directions of
approach; `cup_grasps` places a cup at both ends of the pairs. Both keep only grasps that hold the
load, and sort them by force.
"""

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

CLEAR = 0.002
"""Clearance of the palm and of open pads from the object, m."""

_EACH = 32
"""Largest number of grasps per antipodal pair: eight approaches at four depths."""

TURNS = 4
"""Number of orientations of a cup about the surface normal, in a whole turn."""

_RIM = 16
"""Number of points of a cup's rim."""

_SMOOTH = math.radians(3.0)
"""Largest slope of the surface at the center of a cup, rad."""

_NORMAL_SPOT = np.array([1e-4, 1e-4])
"""Size of the spot whose normal is evaluated, m."""

AZIMUTHS = 6
"""Number of directions around an axis of revolution in half a turn; the other half repeats them."""

_PITCHES = np.deg2rad([0.0, 30.0, -30.0, 60.0, -60.0])
"""Inclinations of the pairs of a sphere, rad; level ones first."""

_LARGE = 0.02
"""Half length above which pads have room beside the middle of an edge, m."""

_SAMPLES = 48
"""Number of surface points that are sampled on a mesh."""


def jaw_grasps(
    solid: Solid, jaw: JawMeasures, load: Load, friction: float, seed: int = 0
) -> tuple[Grasp, ...]:
    """Grasps of a parallel gripper, least force first.

    Args:
        solid: Solid to grasp, in its own frame.
        jaw: Dimensions of the gripper.
        load: Load on the grip.
        friction: Coefficient of friction between the pads and the solid.
        seed: Seed for sampling meshes.
    """
    length = float(np.linalg.norm(load.gravity))
    down = load.gravity / length if length > 0.0 else np.array([0.0, 0.0, -1.0])
    lines = np.array([
        np.concatenate((pair.center, pair.axis, pair.around))
        for pair in antipodal_pairs(solid, down, np.random.default_rng(seed))
    ]).reshape(-1, 9)  # fmt: skip
    rows = _closed(solid, jaw, load, friction, lines)
    found = [grasp for row in rows for grasp in _both_sides(row, jaw)]
    return tuple(sorted(found, key=lambda grasp: grasp.force))


def _closed(solid: Solid, jaw: JawMeasures, load: Load, friction: float, lines: Matrix) -> Matrix:
    """Positions in which the pads hold the solid, one per row, as `close_along` writes them."""
    from bt_dualarm.grasping.grasp_kernels import close_along

    deep = jaw.palm + jaw.pad_center - CLEAR
    room = 0.5 * jaw.widest_opening - CLEAR
    least = jaw.least_opening + CLEAR
    measures = np.array((jaw.pad_length, jaw.pad_width, deep, least, room, jaw.most_force))
    found = np.empty((_EACH * len(lines), 11))
    center = np.ascontiguousarray(load.center, dtype=float)
    count = close_along(*solid.form, lines, measures, shaken(load), center, float(friction), found)
    return found[:count]


def _both_sides(row: Vector, jaw: JawMeasures) -> Iterator[Grasp]:
    """Both grasps of one row: either finger may be on either side."""
    axis = row[3:6].tolist()
    approach = row[6:9].tolist()
    width, force = row[9:].tolist()
    margin = jaw.most_force / max(force, 1e-9)
    # A parallel gripper closes along its y axis, and approaches along z: x = y x z.
    a, b, c = axis
    d, e, f = approach
    x = (b * f - c * e, c * d - a * f, a * e - b * d)
    rows = list(zip(x, axis, approach, strict=True))
    tool = Pose.from_axes(row[:3] - jaw.pad_center * row[6:9], rows)
    w, i, j, k = tool.quaternion.tolist()
    # Half a turn about the approach, the quaternion times (0, 0, 0, 1); signed so that w >= 0.
    sign = -1.0 if k > 0.0 else 1.0
    yield Grasp(tool, width, force, margin)
    yield Grasp(Pose(tool.position, sign * np.array((-k, j, -i, w))), width, force, margin)


def least_width(solid: Solid, seed: int = 0) -> float:
    """Smallest distance between antipodal points of a solid, m: the least opening around it."""
    down = np.array([0.0, 0.0, -1.0])
    rng = np.random.default_rng(seed)
    return min(
        solid.reach(pair.axis) + solid.reach(-pair.axis)
        for pair in antipodal_pairs(solid, down, rng)
    )


def cup_grasps(solid: Solid, cup: CupMeasures, load: Load, seed: int = 0) -> tuple[Grasp, ...]:
    """Grasps of a suction cup, least force first.

    Args:
        solid: Solid to grasp, in its own frame.
        cup: Dimensions of the cup.
        load: Load on the grip.
        seed: Seed for sampling meshes.
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
    """Whether the whole rim touches the solid, with its compliance.

    Args:
        solid: Solid below the cup.
        cup: Dimensions of the cup.
        place: Center of the rim, of shape (3,), m.
        normal: Unit vector from the solid to the cup, of shape (3,).
    """
    # Pressed down as far as it adapts, every point of the rim must be inside the solid.
    first = square_to(normal, np.array([1.0, 0.0, 0.0]))
    angles = np.arange(_RIM) * 2.0 * np.pi / _RIM
    ring = np.outer(np.cos(angles), first) + np.outer(np.sin(angles), np.cross(normal, first))
    rim = place - cup.bends * normal + cup.radius * ring
    return bool(solid.distance(rim).max() <= 0.0)


def _places(solid: Solid, gravity: Vector, seed: int) -> Iterator[tuple[Vector, Vector]]:
    """Flat spots of the surface and their normals, each of shape (3,): ends of antipodal pairs."""
    length = float(np.linalg.norm(gravity))
    down = gravity / length if length > 0.0 else np.array([0.0, 0.0, -1.0])
    for pair in antipodal_pairs(solid, down, np.random.default_rng(seed)):
        for normal in (pair.axis, -pair.axis):
            spot = pad_contact(solid, pair.center, normal, pair.around, _NORMAL_SPOT)
            if spot is not None and spot.slope < _SMOOTH:
                yield spot.middle, normal


def _tools(place: Vector, normal: Vector) -> Iterator[Pose]:
    """Tool frames with the z axis into the surface, turned about it."""
    x = square_to(normal, np.array([1.0, 0.0, 0.0]))
    matrix = np.eye(4)
    matrix[:3] = np.column_stack((x, np.cross(-normal, x), -normal, place))
    first = Pose.from_matrix(matrix)
    for turn in np.arange(TURNS) * 2.0 * np.pi / TURNS:
        yield first @ Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, float(turn)))


@dataclass(frozen=True, eq=False)
class AntipodalPair:
    """Line along which two pads close.

    Attributes:
        center: Point between the pads, of shape (3,), m.
        axis: Unit vector of the line, of shape (3,).
        around: Unit vector perpendicular to the line: the first direction of approach, of shape
            (3,).
    """

    center: Vector
    axis: Vector
    around: Vector


@singledispatch
def antipodal_pairs(
    solid: Solid,
    down: Vector,  # noqa: ARG001 - used by the implementations below
    rng: np.random.Generator,  # noqa: ARG001 - as above
) -> Iterator[AntipodalPair]:
    """Lines through opposite, parallel parts of a solid's surface, in its own frame.

    Args:
        solid: Solid to grasp.
        down: Unit vector of gravity, of shape (3,): on round solids, level lines come first.
        rng: Generator for sampling meshes.

    Raises:
        TypeError: The kind of solid is not supported.
    """
    raise TypeError(f"no antipodal pairs are known for a {type(solid).__name__}")


@antipodal_pairs.register
def _(solid: Box, down: Vector, rng: np.random.Generator) -> Iterator[AntipodalPair]:  # noqa: ARG001 - as above
    axes = np.eye(3)
    for i in range(3):
        for j in ((i + 1) % 3, (i + 2) % 3):
            shares = (0.0, 0.5, -0.5) if solid.half[j] > _LARGE else (0.0,)
            for share in shares:
                if share or j == (i + 1) % 3:  # the middle only once
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
    # A sphere: any line through its center, the vertical one first.
    yield AntipodalPair(np.zeros(3), down, square_to(down, np.array([1.0, 0.0, 0.0])))
    for level in _half_turn(down, np.array([1.0, 0.0, 0.0])):
        for pitch in _PITCHES:
            axis = np.cos(pitch) * level + np.sin(pitch) * down
            yield AntipodalPair(np.zeros(3), axis, square_to(axis, down))


@antipodal_pairs.register
def _(solid: MeshSolid, down: Vector, rng: np.random.Generator) -> Iterator[AntipodalPair]:
    """Sampled points with their opposites: I. M. Chen, J. W. Burdick, ICRA 1993."""
    points, normals = solid.sample(_SAMPLES, rng)
    for point, normal in zip(points, normals, strict=True):
        found = solid.farthest_hit(point, -normal)
        if found is not None:
            yield AntipodalPair(0.5 * (point + found[0]), normal, square_to(normal, down))


def square_to(axis: Vector, direction: Vector) -> Vector:
    """Unit vector perpendicular to an axis and nearest to a direction; any if they are parallel."""
    across = direction - (direction @ axis) * axis
    if np.linalg.norm(across) < 1e-6:
        # The coordinate axis that is least parallel to it keeps the product from vanishing.
        across = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
    unit: Vector = across / np.linalg.norm(across)
    return unit


def _diameters(axis: Vector, down: Vector, half_length: float) -> Iterator[AntipodalPair]:
    """Lines through an axis of revolution, at its middle and beside it, level ones first."""
    shares = (0.0, 0.5, -0.5) if half_length > _LARGE else (0.0,)
    level = np.asarray(np.cross(axis, down), dtype=float)
    for across in _half_turn(axis, level):
        for share in shares:
            yield AntipodalPair(share * half_length * axis, across, axis)


def _half_turn(axis: Vector, direction: Vector) -> Iterator[Vector]:
    """Unit vectors around an axis over half a turn, the one nearest to a direction first."""
    first = square_to(axis, direction)
    second = np.cross(axis, first)
    for angle in np.arange(AZIMUTHS) * np.pi / AZIMUTHS:
        yield np.cos(angle) * first + np.sin(angle) * second
