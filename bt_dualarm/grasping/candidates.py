"""Grasp candidates on a solid, and their ranking.

`jaw_grasps` closes a parallel gripper along every antipodal pair, from several directions of
approach; `cup_grasps` places a suction cup at both ends of the pairs, where the surface is flat.
Both keep only grasps that hold the load, and sort them by force. They are then ranked by force
margin, clearance from obstacles, and effort of the arm.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import singledispatch

import numpy as np

from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.grasping.grasp import (
    Box,
    Capsule,
    CompoundSolid,
    CupMeasures,
    Cylinder,
    Grasp,
    JawMeasures,
    Load,
    MeshSolid,
    Solid,
    pad_contact,
    shaken,
    suction_force,
)

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
"""Half length above which pads have room next to the middle of an edge, m."""

SHARES = (0.0, 0.5, -0.5)
"""Where along a long solid grasps are tried, as fractions of half its length."""

_WALL_GAP_M = 2e-3
"""Distance of a wall's flat segments from the round outside of an object, and the error of pads."""

_SLENDER = 3
"""Length of a cup and its tube, in radii, if that is not given."""

_WIDE = 2.5
"""Radius of flange and wrist in those of a cup whose length is not given."""

_WRIST_M = 0.05
"""Radius of flange and wrist, m."""

_WRIST_BALLS = 7
"""Number of balls that stand for flange and wrist."""

_MOST_FACES = 24
"""Largest number of faces of a mesh on whose middle a cup is tried."""

_MOST_EDGES = 24
"""Largest number of edges of a mesh on which a gripper may close."""

_SAMPLES = 48
"""Number of surface points that are sampled on a mesh."""

_SAME_AXIS = math.cos(math.radians(5.0))
"""Cosine of the largest angle between two axes that count as one."""


def jaw_grasps(
    solid: Solid,
    jaw: JawMeasures,
    load: Load,
    friction: float,
    seed: int = 0,
    shares: Sequence[float] = SHARES,
    point: Vector | None = None,
    *,
    on_edges: bool = False,
    between: bool = False,
) -> tuple[Grasp, ...]:
    """Grasps of a parallel gripper, smallest force first.

    Args:
        solid: Solid to grasp, in its own frame.
        jaw: Dimensions of the gripper.
        load: Load on the grip.
        friction: Coefficient of friction between the pads and the solid.
        seed: Seed for sampling meshes.
        shares: Where along a long solid the pads close, as fractions of half its length.
        point: Point in the solid's frame at which the pads close instead, of shape (3,), m.
        on_edges: Whether the pads close on edges of meshes, instead of on their faces.
        between: Whether the approaches are those halfway between the usual ones, which are 45°
            apart.
    """
    if isinstance(solid, CompoundSolid):
        found: list[Grasp] = []
        for part, pose, others in _pieces(solid):
            grasps = jaw_grasps(
                part, jaw, _load_on(load, pose), friction, seed, shares, _in(pose, point),
                on_edges=on_edges, between=between,
            )  # fmt: skip
            if others:
                found += _beside(grasps, pose, jaw, [solid.surfaces[index] for index in others])
            else:
                found += _on_walls(solid, grasps, pose, jaw)
        return _sorted(found)
    length = float(np.linalg.norm(load.gravity))
    down = load.gravity / length if length > 0.0 else np.array([0.0, 0.0, -1.0])
    pairs = (
        edge_pairs(solid, down)
        if on_edges
        else _pairs(solid, down, np.random.default_rng(seed), shares, point)
    )
    if between:
        from bt_dualarm.grasping.grasp_kernels import APPROACHES

        pairs = (_turned(pair, math.pi / APPROACHES) for pair in pairs)
    lines = np.array([
        np.concatenate((pair.center, pair.axis, pair.around)) for pair in pairs
    ]).reshape(-1, 9)  # fmt: skip
    rows = _closed(solid, jaw, load, friction, lines)
    return _sorted(grasp for row in rows for grasp in _both_sides(row, jaw))


def _turned(pair: AntipodalPair, angle: float) -> AntipodalPair:
    """A pair whose first direction of approach is turned about its axis, rad."""
    other = np.asarray(np.cross(pair.axis, pair.around), dtype=float)
    return replace(pair, around=math.cos(angle) * pair.around + math.sin(angle) * other)


def _sorted(grasps: Iterable[Grasp]) -> tuple[Grasp, ...]:
    """Grasps, the one with the minimum force first."""
    return tuple(sorted(grasps, key=lambda grasp: grasp.force))


def _pieces(solid: CompoundSolid) -> Iterator[tuple[Solid, Pose, list[int]]]:
    """Solids of a compound that can be grasped, with pose and the indices of all other parts.

    An envelope contains all parts, so that nothing is in the way of fingers around it.
    """
    for envelope, pose in solid.envelopes:
        yield envelope, pose, []
    for index in solid.graspable:
        part, pose = solid.parts[index]
        yield part, pose, [other for other in range(len(solid.parts)) if other != index]


def _load_on(load: Load, pose: Pose) -> Load:
    """A load on a compound, in the frame of a part at this pose."""
    gravity = load.gravity @ pose.rotation_matrix
    return replace(load, gravity=gravity, center=pose.inverse.apply(load.center))


def _in(pose: Pose, point: Vector | None) -> Vector | None:
    """A point of a compound in the frame of a part at this pose."""
    return None if point is None else pose.inverse.apply(point)


def _on_walls(
    solid: CompoundSolid, grasps: Sequence[Grasp], pose: Pose, jaw: JawMeasures
) -> list[Grasp]:
    """Grasps of an envelope, in the frame of the compound, whose pads meet a part of it.

    An envelope has a surface even where a bin or cup is open.
    """
    moved = [replace(grasp, tool=pose @ grasp.tool) for grasp in grasps]
    if not moved:
        return []
    pads = np.array([
        one.tool.apply(np.array([[0.0, side * one.width, jaw.pad_center] for side in (-0.5, 0.5)]))
        for one in moved
    ])  # fmt: skip
    gaps = solid.distance(pads.reshape(-1, 3)).reshape(-1, 2).max(axis=1)
    return [one for one, gap in zip(moved, gaps, strict=True) if gap <= _WALL_GAP_M]


def _beside(
    grasps: Sequence[Grasp], pose: Pose, jaw: JawMeasures, others: Sequence[Matrix]
) -> Iterator[Grasp]:
    """Grasps of a part, in the frame of the compound, that the other parts leave room for.

    No point of their surfaces may be where the fingers close, or where the palm is.
    """
    # One row per coordinate: a bowl has thousands of points, which are checked for each grasp.
    points = np.ascontiguousarray(np.vstack((np.zeros((0, 3)), *others)).T)
    wide = 0.5 * jaw.pad_width
    for grasp in grasps:
        tool = pose @ grasp.tool
        here = tool.inverse
        x, y, z = here.rotation_matrix @ points + here.position[:, None]
        if ((z < -jaw.palm) & (x * x + y * y < jaw.palm_radius**2)).any():
            continue
        beside = np.abs(y)
        before = (np.abs(x) < wide - TOUCHING) & (z > -jaw.palm)
        before &= beside > 0.5 * grasp.width + TOUCHING
        before &= beside < 0.5 * jaw.widest_opening + jaw.thickness
        ahead = float(z[before].min(initial=math.inf)) - jaw.tip
        if ahead >= -TOUCHING:
            yield replace(grasp, tool=tool, ahead=ahead)


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
    """Smallest distance between antipodal points of a solid, m: the minimum opening around it."""
    if isinstance(solid, CompoundSolid):
        return min(least_width(part, seed) for part, _, _ in _pieces(solid))
    down = np.array([0.0, 0.0, -1.0])
    rng = np.random.default_rng(seed)
    return min(
        solid.reach(pair.axis) + solid.reach(-pair.axis)
        for pair in antipodal_pairs(solid, down, rng)
    )


def cup_grasps(
    solid: Solid, cup: CupMeasures, load: Load, seed: int = 0, point: Vector | None = None
) -> tuple[Grasp, ...]:
    """Grasps of a suction cup, smallest force first.

    Args:
        solid: Solid to grasp, in its own frame.
        cup: Dimensions of the cup.
        load: Load on the grip.
        seed: Seed for sampling meshes.
        point: Point in the solid's frame over which the cup is placed, of shape (3,), m.
    """
    if isinstance(solid, CompoundSolid):
        # An envelope may be open where it seems to have a face; the floor of a bin, between whose
        # walls no fingers fit, is one.
        tried = range(len(solid.parts)) if solid.envelopes else solid.graspable
        return _sorted(
            replace(grasp, tool=pose @ grasp.tool)
            for index in tried
            for part, pose in (solid.parts[index],)
            for grasp in cup_grasps(part, cup, _load_on(load, pose), seed, _in(pose, point))
            if _is_open(pose @ grasp.tool, cup, [*solid.parts[:index], *solid.parts[index + 1 :]])
        )
    if _is_narrow(solid, cup):
        return ()
    found = []
    for place, normal in _places(solid, load.gravity, seed, point):
        if not seals(solid, cup, place, normal):
            continue
        force = suction_force(load, place, normal, cup)
        if force > cup.most_force:
            continue
        margin = cup.most_force / max(force, 1e-9)
        found += [Grasp(tool, 0.0, force, margin) for tool in _tools(place, normal)]
    return _sorted(found)


def _is_narrow(solid: Solid, cup: CupMeasures) -> bool:
    """Whether a box around a solid has no side as wide as a cup: such are the walls of a mug."""
    widths = sorted(solid.reach(axis) + solid.reach(-axis) for axis in np.eye(3))
    return bool(widths[1] < 2.0 * (cup.radius - cup.bends))


def _is_open(tool: Pose, cup: CupMeasures, others: Sequence[tuple[Solid, Pose]]) -> bool:
    """Whether the other parts of a compound leave room for a cup and for what is behind it."""
    behind, radii = _cup_balls(cup)
    points = tool.apply(behind)
    return all(
        bool((other.distance(pose.inverse.apply(points)) >= radii).all()) for other, pose in others
    )


def _cup_balls(cup: CupMeasures) -> tuple[Matrix, Vector]:
    """Balls that stand for a cup, its tube, flange and wrist: centers (n, 3), radii (n,), m."""
    length = cup.length or _SLENDER * cup.radius
    wide = _WRIST_M if cup.length else _WIDE * cup.radius
    tube = _tube_balls(cup)
    depths = np.concatenate(
        (
            cup.radius * np.arange(1, tube + 1),
            length + wide / _WIDE * np.arange(1, _WRIST_BALLS + 1),
        )
    )
    centers = np.outer(depths, (0.0, 0.0, -1.0))
    return centers, np.repeat((cup.radius, wide), (tube, _WRIST_BALLS))


def _tube_balls(cup: CupMeasures) -> int:
    """Number of the first balls, which stand for a cup and its tube."""
    return max(round(cup.length / cup.radius), 1) if cup.length else _SLENDER


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


def _places(
    solid: Solid, gravity: Vector, seed: int, point: Vector | None
) -> Iterator[tuple[Vector, Vector]]:
    """Flat spots of the surface and their normals, each of shape (3,): ends of antipodal pairs.

    Of a mesh, whose pairs are sampled, also the centers of its largest faces: hardly a sample is
    where a cup fits on a face that is little wider than it is.
    """
    length = float(np.linalg.norm(gravity))
    down = gravity / length if length > 0.0 else np.array([0.0, 0.0, -1.0])
    if isinstance(solid, MeshSolid) and point is None:
        for center, normal in zip(*(rows[:_MOST_FACES] for rows in solid.faces), strict=True):
            spot = pad_contact(solid, center, normal, square_to(normal, down), _NORMAL_SPOT)
            if spot is not None and spot.slope < _SMOOTH:
                yield spot.middle, normal
    for pair in _pairs(solid, down, np.random.default_rng(seed), SHARES, point):
        for normal in (pair.axis, -pair.axis):
            spot = pad_contact(solid, pair.center, normal, pair.around, _NORMAL_SPOT)
            if spot is not None and spot.slope < _SMOOTH:
                yield spot.middle, normal


def _tools(place: Vector, normal: Vector) -> Iterator[Pose]:
    """Tool frames with the z axis into the surface, turned about it."""
    x = square_to(normal, np.array([1.0, 0.0, 0.0]))
    first = Pose.from_axes(place, np.column_stack((x, np.cross(-normal, x), -normal)).tolist())
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
    shares: Sequence[float] = SHARES,  # noqa: ARG001 - as above
) -> Iterator[AntipodalPair]:
    """Lines through opposite, parallel parts of a solid's surface, in its own frame.

    Args:
        solid: Solid to grasp.
        down: Unit vector of gravity, of shape (3,): on round solids, level lines come first.
        rng: Generator for sampling meshes.
        shares: Where along a long solid the lines are, as fractions of half its length.

    Raises:
        TypeError: The kind of solid is not supported.
    """
    raise TypeError(f"no antipodal pairs are known for a {type(solid).__name__}")


@antipodal_pairs.register
def _(
    solid: Box,
    down: Vector,  # noqa: ARG001 - as above
    rng: np.random.Generator,  # noqa: ARG001 - as above
    shares: Sequence[float] = SHARES,
) -> Iterator[AntipodalPair]:
    axes = np.eye(3)
    for i in range(3):
        for j in ((i + 1) % 3, (i + 2) % 3):
            for share in shares if solid.half[j] > _LARGE else (0.0,):
                if share or j == (i + 1) % 3:  # the middle only once
                    yield AntipodalPair(share * solid.half[j] * axes[j], axes[i], axes[(i + 1) % 3])


@antipodal_pairs.register
def _(
    solid: Cylinder,
    down: Vector,
    rng: np.random.Generator,  # noqa: ARG001 - as above
    shares: Sequence[float] = SHARES,
) -> Iterator[AntipodalPair]:
    axis = np.array([0.0, 0.0, 1.0])
    yield from _diameters(axis, down, solid.half_length, shares)
    for around in _half_turn(axis, down):
        yield AntipodalPair(np.zeros(3), axis, around)


@antipodal_pairs.register
def _(
    solid: Capsule,
    down: Vector,
    rng: np.random.Generator,  # noqa: ARG001 - as above
    shares: Sequence[float] = SHARES,
) -> Iterator[AntipodalPair]:
    if solid.half_length > 0.0:
        axis = np.array([0.0, 0.0, 1.0])
        yield from _diameters(axis, down, solid.half_length, shares)
        yield AntipodalPair(np.zeros(3), axis, square_to(axis, down))
        return
    # A sphere: any line through its center, the vertical one first.
    yield AntipodalPair(np.zeros(3), down, square_to(down, np.array([1.0, 0.0, 0.0])))
    for level in _half_turn(down, np.array([1.0, 0.0, 0.0])):
        for pitch in _PITCHES:
            axis = np.cos(pitch) * level + np.sin(pitch) * down
            yield AntipodalPair(np.zeros(3), axis, square_to(axis, down))


@antipodal_pairs.register
def _(
    solid: MeshSolid,
    down: Vector,
    rng: np.random.Generator,
    shares: Sequence[float] = SHARES,  # noqa: ARG001 - as above
) -> Iterator[AntipodalPair]:
    """Sampled points with their opposites: I. M. Chen, J. W. Burdick, ICRA 1993."""
    points, normals = solid.sample(_SAMPLES, rng)
    for point, normal in zip(points, normals, strict=True):
        found = solid.farthest_hit(point, -normal)
        if found is not None:
            yield AntipodalPair(0.5 * (point + found[0]), normal, square_to(normal, down))


def edge_pairs(solid: Solid, down: Vector) -> Iterator[AntipodalPair]:
    """Lines through the middles of a mesh's sharp edges, halfway between the faces beside them.

    A hexagonal prism that lies on a side has no other surfaces between which level pads could
    close. There are none for other solids, whose opposite faces are parallel.

    Args:
        solid: Solid to grasp.
        down: Unit vector of gravity, of shape (3,).
    """
    if not isinstance(solid, MeshSolid):
        return
    middles, outward = solid.edges
    for middle, axis in zip(middles[:_MOST_EDGES], outward[:_MOST_EDGES], strict=True):
        found = solid.farthest_hit(middle, -axis)
        if found is not None:
            yield AntipodalPair(0.5 * (middle + found[0]), axis, square_to(axis, down))


def _pairs(
    solid: Solid,
    down: Vector,
    rng: np.random.Generator,
    shares: Sequence[float],
    point: Vector | None,
) -> Iterator[AntipodalPair]:
    """Antipodal pairs as `antipodal_pairs`, or those whose lines pass nearest to a point."""
    if point is None:
        yield from antipodal_pairs(solid, down, rng, shares)
        return
    if isinstance(solid, MeshSolid):
        # Sampled lines may pass far beside the point; those through it have the same directions.
        yield from _through(solid, point, antipodal_pairs(solid, down, rng))
        return
    along = np.array([0.0, 0.0, 1.0])
    for pair in antipodal_pairs(solid, down, rng, (0.0,)):
        shift = point - pair.center
        shift -= (shift @ pair.axis) * pair.axis
        if isinstance(solid, Capsule) and solid.half_length == 0.0:
            shift = np.zeros(3)  # every line through a sphere passes through its center
        elif isinstance(solid, Cylinder | Capsule) and abs(float(pair.axis @ along)) < 0.5:
            shift = (shift @ along) * along  # so does every diameter through the axis
        elif isinstance(solid, Capsule):
            shift = np.zeros(3)
        yield replace(pair, center=pair.center + shift)
        if isinstance(solid, Box):
            yield replace(
                pair,
                center=pair.center + shift,
                around=np.asarray(np.cross(pair.axis, pair.around), float),
            )


def _through(
    solid: MeshSolid, point: Vector, pairs: Iterable[AntipodalPair]
) -> Iterator[AntipodalPair]:
    """Pairs, and for each axis among them the line through a point."""
    axes = list[Vector]()
    for pair in pairs:
        yield pair
        if any(abs(float(pair.axis @ axis)) > _SAME_AXIS for axis in axes):
            continue
        axes.append(pair.axis)
        ends = [solid.farthest_hit(point, side * pair.axis) for side in (1.0, -1.0)]
        if ends[0] is not None and ends[1] is not None:
            yield replace(pair, center=0.5 * (ends[0][0] + ends[1][0]))


def square_to(axis: Vector, direction: Vector) -> Vector:
    """Unit vector perpendicular to an axis and nearest to a direction; any if they are parallel."""
    across = direction - (direction @ axis) * axis
    if np.linalg.norm(across) < 1e-6:
        # The coordinate axis that is least parallel to it keeps the product from vanishing.
        across = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
    unit: Vector = across / np.linalg.norm(across)
    return unit


def _diameters(
    axis: Vector, down: Vector, half_length: float, shares: Sequence[float]
) -> Iterator[AntipodalPair]:
    """Lines through an axis of revolution, at its middle and beside it, level ones first."""
    shares = shares if half_length > _LARGE else (0.0,)
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


ENOUGH_ROOM = 0.02
"""Clearance above which more of it does not improve a grasp, m."""

_ENOUGH_AHEAD = 0.005
"""Distance of the fingertips from what is before them, above which more of it does not improve a
grasp, m: an arm that is off by millimeters presses on the floor of a tray, and its fingers do not
close."""

_ENOUGH_MARGIN = 4.0
"""Force margin above which more of it does not improve a grasp."""

TOUCHING = 1e-4
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
        name: Name of the body that it is part of.
    """

    solid: Solid
    pose: Pose
    name: str = ""


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
    object_pose: Pose,
    hand: JawMeasures | CupMeasures | None,
    obstacles: Sequence[Obstacle],
    reach: Callable[[Pose], float],
) -> tuple[RankedGrasp, ...]:
    """Grasps that are free of collisions and within reach, best first.

    Margin up to four times the load, clearance up to `ENOUGH_ROOM`, distance of the fingertips from
    the floor of a tray or bin up to `_ENOUGH_AHEAD`, and the effort of the arm have equal weights.

    Args:
        grasps: Grasps on the object.
        object_pose: Pose of the object in the world.
        hand: Dimensions of the gripper; None for a cup whose clearance does not count.
        obstacles: Obstacles, without the object itself.
        reach: Effort of the arm to get to a tool pose in the world, in [0, 1]; infinite if it
            cannot.
    """
    found = []
    (rooms,) = clearances(grasps, [object_pose], hand, obstacles).tolist()
    for grasp, room in zip(grasps, rooms, strict=True):
        if room < -TOUCHING:
            continue
        tool = object_pose @ grasp.tool
        effort = reach(tool)
        if math.isinf(effort):
            continue
        lacks_margin = 1.0 - min(grasp.margin - 1.0, _ENOUGH_MARGIN - 1.0) / (_ENOUGH_MARGIN - 1.0)
        lacks_room = 1.0 - min(max(room, 0.0), ENOUGH_ROOM) / ENOUGH_ROOM
        lacks_ahead = 1.0 - min(max(grasp.ahead, 0.0), _ENOUGH_AHEAD) / _ENOUGH_AHEAD
        cost = lacks_margin + lacks_room + lacks_ahead + effort
        found.append(RankedGrasp(grasp, tool, room, cost))
    return tuple(sorted(found, key=lambda candidate: candidate.cost))


def clearances(
    grasps: Sequence[Grasp],
    object_poses: Sequence[Pose],
    hand: JawMeasures | CupMeasures | None,
    obstacles: Sequence[Obstacle],
) -> Matrix:
    """Clearance of palm and fingers, open or closed on the object, from the obstacles, m.

    Of grasps in collision, any value below `-TOUCHING`. A cup has at least 0, as the balls that
    stand for it are wider than it is, unless an obstacle contains a point of its axis.

    Args:
        grasps: Grasps on the object.
        object_poses: Poses of the object in the world.
        hand: As for `ranked`.
        obstacles: As for `ranked`.

    Returns:
        Clearances of the grasps at each pose, of shape (poses, grasps).
    """
    rooms = np.full((len(object_poses), len(grasps)), math.inf)
    if hand is None or not grasps:
        return rooms
    if isinstance(hand, CupMeasures):
        centers, radii = _cup_balls(hand)
        tube = _tube_balls(hand)
        for row, object_pose in zip(rooms, object_poses, strict=True):
            points = np.vstack([(object_pose @ grasp.tool).apply(centers) for grasp in grasps])
            is_within = np.zeros(len(grasps), np.bool_)
            for obstacle in obstacles:
                away = obstacle.solid.distance(obstacle.pose.inverse.apply(points))
                away = away.reshape(len(grasps), -1)
                np.minimum(row, (away - radii).min(axis=1), out=row)
                is_within |= (away[:, :tube] < 0.0).any(axis=1)
            row[:] = np.where(is_within, -math.inf, np.maximum(row, 0.0))
        return rooms
    from bt_dualarm.grasping.grasp_kernels import lower_clearances

    # In the object's frame, where the grasps are given: only the obstacles need a transform.
    tools = np.array([(*grasp.tool.position, *grasp.tool.quaternion) for grasp in grasps])
    widths = np.array([(hand.widest_opening, grasp.width) for grasp in grasps])
    points = _moving_points(hand)
    for row, object_pose in zip(rooms, object_poses, strict=True):
        for obstacle in obstacles:
            pose = (object_pose.inverse @ obstacle.pose).matrix
            lower_clearances(*obstacle.solid.form, pose, tools, widths, points, -TOUCHING, row)
    return rooms


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
