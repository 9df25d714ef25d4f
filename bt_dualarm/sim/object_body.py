"""Bodies of objects: convex parts, mass properties, extents, and what can be grasped of them.

Contacts, cameras, distances and plans work with convex shapes. A hollow or compound object is a
rigid body of several: boxes, cylinders, capsules, spheres and ellipsoids as declared, everything
else as hulls of corner points.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Final, Literal, TypeAlias

import mujoco
import numpy as np
import scipy

from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.grasping.grasp import Box, CompoundSolid, Cylinder, MeshSolid, Solid
from bt_dualarm.grasping.grasp import solid_of as simple_solid
from bt_dualarm.robots.meshes import OBJECT_LOSS, object_hulls
from bt_dualarm.robots.mjspec import GEOM_TYPES, half_sizes
from bt_dualarm.spec.colors import rgba_of
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.shapes import (
    DEFAULT_BOARDS,
    DEFAULT_SIDES,
    PartShape,
    PartSpec,
    wall_of,
)

Primitive: TypeAlias = Literal["box", "cylinder", "capsule", "sphere", "ellipsoid"]
PartKind: TypeAlias = Literal[Primitive, "hull"]

SIMPLE: Final = ("box", "cylinder", "capsule", "sphere")
"""Shapes that are one of MuJoCo's primitives."""

_SEGMENTS: Final = (8, 10, 12, 16, 20, 24, 32)
"""Numbers of segments of a round wall of which the smallest that its thickness allows is chosen."""

_CORNER: Final = 0.3
"""Fraction of a wall's thickness by which its segments may be thinner where they meet."""

_CHORDS: Final = 3
"""Number of flat faces on the outside of each segment."""

_FOOT: Final = 0.4
"""Radius of the flat foot of a bowl as a fraction of that of its rim."""

_RINGS: Final = 3
_BOWL_SEGMENTS: Final = 12
"""Number of segments of a bowl along its profile, and around its axis."""

_RIM_GRASPS: Final = 4
"""Number of segments of a round wall at which a grasp of the rim is searched."""

_BALL: Final = (20, 11)
"""Number of corners of a ball around its axis, and of circles of them, poles included."""

_COARSE: Final = (14, 8)

BALL_LOSS: Final = 0.025
"""Bound of the depth of the polyhedron's faces below the unit ball: 1 - cos²(9°)."""


@dataclass(frozen=True, eq=False)
class BodyPart:
    """A convex part of a body.

    Attributes:
        name: Name of the declared part that it belongs to; empty if the object has no parts.
        kind: A primitive, or ``hull``.
        size: Size of a primitive as in a tree file, m; of a hull empty.
        pose: Pose in the body's frame.
        corners: Corners of a hull in its own frame, of shape (n, 3), m; of a primitive empty.
        density: Density relative to the other parts.
        rgba: Color, None for that of the object.
        mesh: Key that equal hulls share.
    """

    name: str
    kind: PartKind
    size: tuple[float, ...]
    pose: Pose
    corners: Matrix
    density: float = 1.0
    rgba: tuple[float, float, float, float] | None = None
    mesh: str = ""

    @cached_property
    def solid(self) -> Solid:
        """The part as a solid in its own frame."""
        if self.kind == "hull":
            return MeshSolid.hull_of(self.corners)
        if self.kind == "ellipsoid":  # for grasps only: the error is less than pads yield
            return MeshSolid.hull_of(0.5 * np.array(self.size) * unit_ball(_COARSE))
        return simple_solid(self.kind, self.size)

    @property
    def middle(self) -> Vector:
        """Center of its corners, or of the primitive, in the body's frame, of shape (3,), m."""
        if self.kind == "hull":
            middle: Vector = self.pose.apply(self.corners.mean(axis=0))
            return middle
        return self.pose.position

    @cached_property
    def weight(self) -> float:
        """Volume times relative density, m³."""
        return self.density * _volume(self)

    def ray(self, start: Vector, direction: Vector) -> float:
        """Distance along a ray, both of shape (3,) in the body's frame, to the part, m.

        Infinite if it misses.
        """
        begin = self.pose.inverse.apply(start)
        along = direction @ self.pose.rotation_matrix
        if self.kind != "hull":
            kind = GEOM_TYPES[self.kind]
            size = np.array(half_sizes(self.kind, self.size))
            length = mujoco.mju_rayGeom(np.zeros(3), _AXES, size, begin, along, kind, None)
            return length if length >= 0.0 else math.inf
        enters, leaves = self._crossing(begin, along)
        if enters > leaves or leaves < 0.0:
            return math.inf
        return max(enters, 0.0)

    def way_out(self, start: Vector, direction: Vector) -> float:
        """Distance along a ray to where it leaves the part for good, m; -inf if it misses."""
        far = 1e3
        length = self.ray(start + far * direction, -direction)
        return far - length if math.isfinite(length) else -math.inf

    def _crossing(self, start: Vector, direction: Vector) -> tuple[float, float]:
        """Distances at which a line enters and leaves the hull, m."""
        planes = self._planes
        speed = planes[:, :3] @ direction
        height = -(planes[:, :3] @ start + planes[:, 3])
        if (height[np.abs(speed) < 1e-12] < 0.0).any():
            return math.inf, -math.inf
        entering = speed < -1e-12
        leaving = speed > 1e-12
        enters = float((height[entering] / speed[entering]).max(initial=-np.inf))
        return enters, float((height[leaving] / speed[leaving]).min(initial=np.inf))

    @cached_property
    def _planes(self) -> Matrix:
        """Outward normals and offsets of a hull's faces, of shape (n, 4)."""
        planes: Matrix = scipy.spatial.ConvexHull(self.corners).equations
        return planes


_AXES: Final = np.eye(3).ravel()


_ON_AXIS_M: Final = 1e-6  # distance of a center from an axis on which it is
_ON_AXIS: Final = 1e-9  # 1 less the cosine of the angle between axes that are parallel


Folds: TypeAlias = tuple[int, int, int]
"""Numbers of rotations about axes along x, y and z that change nothing: 1 if only a whole turn."""


@dataclass(frozen=True, eq=False)
class ObjectBody:
    """Body of an object in its own frame.

    Attributes:
        shape: Declared shape.
        parts: Its convex parts.
        envelopes: Solids, with poses, whose outside is that of the body.
        graspable: Indices of the parts on which grasps are searched.
    """

    shape: str
    parts: tuple[BodyPart, ...]
    envelopes: tuple[tuple[Solid, Pose], ...] = ()
    graspable: tuple[int, ...] = ()

    @property
    def is_simple(self) -> bool:
        """Whether it is one primitive about its origin."""
        return self.shape in SIMPLE

    @property
    def is_axisymmetric(self) -> bool:
        """Whether its z axis is an axis of revolution."""
        return self.shape in ("cylinder", "capsule", "tube", "cup", "bowl")

    @property
    def is_coaxial(self) -> bool:
        """Whether all parts are round about its z axis, as those of a bottle."""
        return all(
            part.kind in ("cylinder", "capsule", "sphere")
            and float(np.hypot(*part.pose.position[:2])) < _ON_AXIS_M
            and (part.kind == "sphere" or abs(part.pose.rotation_matrix[2, 2]) > 1.0 - _ON_AXIS)
            for part in self.parts
        )

    @cached_property
    def solid(self) -> Solid:
        """The body as a solid."""
        if len(self.parts) == 1 and self.shape != "compound":
            return self.parts[0].solid
        return self._union(self.envelopes, self.graspable)

    def _union(
        self, envelopes: tuple[tuple[Solid, Pose], ...], graspable: tuple[int, ...]
    ) -> CompoundSolid:
        parts = tuple((part.solid, part.pose) for part in self.parts)
        return CompoundSolid(parts, envelopes, graspable, self._surfaces)

    @cached_property
    def _surfaces(self) -> tuple[Matrix, ...]:
        return tuple(part.pose.apply(_surface(_outline(part))) for part in self.parts)

    def part(self, name: str) -> CompoundSolid | None:
        """Solid of which only the declared part of this name can be grasped; None if none has it.

        It is a solid of the whole body nevertheless: the other parts are in the way of a gripper.
        """
        its = tuple(index for index, part in enumerate(self.parts) if part.name == name)
        if not its:
            return None
        return self.held_at(tuple(index for index in its if index in self.graspable) or its)

    def held_at(self, indices: tuple[int, ...]) -> CompoundSolid:
        """Solid of the whole body of which only some of its convex parts can be grasped."""
        return self._union((), indices)

    @cached_property
    def corners(self) -> Matrix:
        """Points whose convex hull is that of the body, of shape (n, 3), m.

        Round primitives are represented by polygons and rings within their surface.
        """
        points = self._outlines
        found: Matrix = points[scipy.spatial.ConvexHull(points).vertices]
        return found

    @property
    def radius(self) -> float:
        """Largest distance of one of the `corners` from the origin of the frame, m.

        Without their hull: to load SciPy for it takes a fifth of the time of a check.
        """
        return float(np.linalg.norm(self._outlines, axis=1).max())

    @cached_property
    def _outlines(self) -> Matrix:
        return np.vstack([part.pose.apply(_outline(part)) for part in self.parts])

    @cached_property
    def folds(self) -> Folds:
        """As `hull_folds`, of rotations that bring every part into the place of one alike.

        Of a mesh those into itself, whatever the convex parts into which it was divided.
        """
        placed = [part.pose.apply(_outline(part)) - self.middle for part in self.parts]

        def fits(axis: int, fold: int) -> bool:
            turn = _part_of_turn(axis, fold)
            if self.shape == "mesh":
                away = self.solid.distance(np.vstack(placed) @ turn.T + self.middle)
                return bool(np.abs(away).max() < self._alike_m)
            return all(any(_same(one @ turn.T, other) for other in placed) for one in placed)

        first, second, third = (
            max(fold for fold in _divisors(most) if fold == 1 or fits(axis, fold))
            for axis, most in enumerate(self.hull_folds)
        )
        return first, second, third

    @cached_property
    def hull_folds(self) -> Folds:
        """Numbers of rotations, in a whole turn, of the convex hull into itself.

        About the lines through its `middle` that are parallel to the x, y and z axis.
        """
        corners = self.corners - self.middle
        planes = scipy.spatial.ConvexHull(corners).equations

        def holds(points: Matrix) -> bool:
            # By its planes, as of corners on one plane a hull may have any.
            return bool((points @ planes[:, :3].T + planes[:, 3]).max() < self._alike_m)

        def most(axis: int) -> int:
            from_axis = np.delete(corners, axis, axis=1)
            farthest = corners[[int((from_axis**2).sum(axis=1).argmax())]]
            for fold in range(_MOST_FOLDS, 1, -1):
                turn = _part_of_turn(axis, fold)
                # Most rotations take the corner farthest from the axis out of the hull.
                if holds(farthest @ turn.T) and holds(corners @ turn.T):
                    return fold
            return 1

        return most(0), most(1), most(2)

    @cached_property
    def middle(self) -> Vector:
        """Center of its shape, of shape (3,), m: its frame unless that may be anywhere.

        Of compounds and meshes the centroid of the convex hull, which its rotations into itself
        keep.
        """
        if self.shape not in ("compound", "mesh"):
            return np.zeros(3)
        middle = _moments(self.corners)[0]
        return np.where(np.abs(middle) < self._alike_m, 0.0, middle)

    @property
    def _alike_m(self) -> float:
        """Distance up to which surfaces count as the same, m."""
        if self.shape != "mesh":
            return _ALIKE_M
        return OBJECT_LOSS * float(np.ptp(self.corners, axis=0).max())

    @cached_property
    def center(self) -> Vector:
        """Center of mass, of shape (3,), m."""
        weights = np.array([part.weight for part in self.parts])
        centers = np.array([part.pose.apply(_centroid(part)) for part in self.parts])
        center: Vector = weights @ centers / weights.sum()
        return center

    @cached_property
    def inertia(self) -> Matrix:
        """Inertia about the center of mass in the body's axes for 1 kg, of shape (3, 3), m²."""
        total = sum(part.weight for part in self.parts)
        inertia = np.zeros((3, 3))
        for part in self.parts:
            turn = part.pose.rotation_matrix
            away = part.pose.apply(_centroid(part)) - self.center
            shifted = away @ away * np.eye(3) - np.outer(away, away)  # parallel-axis theorem
            inertia += part.weight / total * (turn @ _inertia(part) @ turn.T + shifted)
        return inertia

    @cached_property
    def principal(self) -> tuple[Pose, Vector]:
        """Pose of the principal axes about the center of mass, and moments for 1 kg, (3,), m²."""
        moments, axes = np.linalg.eigh(self.inertia)
        if np.linalg.det(axes) < 0.0:
            axes = axes * (1.0, 1.0, -1.0)
        return Pose.from_axes(self.center, axes.tolist()), np.asarray(moments, dtype=float)

    def extents(self, turn: Matrix) -> tuple[Vector, Vector]:
        """Lowest and highest coordinates along the axes of the world, each of shape (3,), m.

        Args:
            turn: Rotation matrix of the body in the world, of shape (3, 3).
        """
        high = np.array([self.solid.reach(turn[i]) for i in range(3)])
        low = -np.array([self.solid.reach(-turn[i]) for i in range(3)])
        return low, high

    def ray(self, start: Vector, direction: Vector) -> float:
        """Distance along a ray in the body's frame to its first part, m; infinite if it misses."""
        return min(part.ray(start, direction) for part in self.parts)

    def way_out(self, direction: Vector) -> float:
        """Distance from the center of mass along a unit vector to where it leaves the body, m.

        That of the support plane, if the ray meets no part, as it may in something hollow.
        """
        out = max(part.way_out(self.center, direction) for part in self.parts)
        if math.isfinite(out) and out > 0.0:
            return out
        return self.solid.reach(direction) - float(self.center @ direction)

    def edge(self, direction: Vector) -> Vector | None:
        """Point on the edge of something open along a unit vector, of shape (3,), m.

        It is in the middle of the nearest wall: of a tray seen from above a point of its rim. None
        if a ray from the center of mass meets the body.
        """

        def height(start: Vector) -> float:
            return max(part.way_out(start, direction) for part in self.parts)

        if height(self.center) > 0.0:
            return None
        x = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
        x /= np.linalg.norm(x)
        walls: list[tuple[float, Vector]] = []
        for turn in np.arange(_WALL_TURNS) * (2.0 * math.pi / _WALL_TURNS):
            sideways = math.cos(turn) * x + math.sin(turn) * np.cross(direction, x)
            widest = self.solid.reach(sideways) - float(self.center @ sideways)
            # Walls are usually outside: there the steps are smaller.
            rows = widest * (1.0 - np.linspace(1.0, 0.01, _WALL_STEPS) ** 2)
            heights = np.array([height(self.center + row * sideways) for row in rows])
            highest = float(heights.max())
            if highest > 0.0:
                top = np.flatnonzero(heights > highest - _LEVEL_M)
                ends = np.flatnonzero(np.diff(top) > 1)
                last = int(top[ends[0]] if ends.size else top[-1])
                middle = 0.5 * float(rows[top[0]] + rows[last])
                walls.append((middle, self.center + middle * sideways + highest * direction))
        return min(walls, key=lambda wall: round(wall[0], 4))[1] if walls else None


_WALL_TURNS: Final = 4
"""Number of directions in which the walls of something open are searched."""

_WALL_STEPS: Final = 60
"""Number of steps in each of them."""

_LEVEL_M: Final = 5e-4
"""Difference in height of points on the edge of a wall, m."""


def body_of(obj: ObjectSpec) -> ObjectBody:
    """Body of a declared object; computed once for equal shapes."""
    parts = tuple(
        (
            name,
            part.shape,
            part.size,
            part.wall,
            _count(part),
            part.density,
            part.color,
            *_key(part),
        )
        for name, part in obj.parts.items()
    )
    if obj.shape == "mesh":
        state = obj.mesh_path.stat()
        return _mesh_body(obj.mesh_path, obj.scale, state.st_mtime_ns, state.st_size)
    return _body(obj.shape, obj.size, obj.wall, _count(obj), parts)


def body_of_part(part: PartSpec) -> ObjectBody:
    """Body of a part of a compound alone, in the frame of the part."""
    return _body(part.shape, part.size, part.wall, _count(part), ())


@lru_cache(maxsize=64)
def _mesh_body(path: Path, scale: float, changed: int, size: int) -> ObjectBody:
    """Body of a mesh, read again after its file has changed."""
    parts = tuple(
        _hull(corners, f"{path} {scale} {changed} {size} {number}")
        for number, corners in enumerate(object_hulls(path, scale))
    )
    return ObjectBody("mesh", parts, (), tuple(range(len(parts))))


def _count(shaped: ObjectSpec | PartSpec) -> int | None:
    """Number of sides or boards, of a shape that has them."""
    return shaped.sides or shaped.boards


def _key(part: PartSpec) -> tuple[tuple[float, ...], tuple[float, ...]]:
    pose = part.pose.pose
    return tuple(pose.position.tolist()), tuple(pose.quaternion.tolist())


@lru_cache(maxsize=512)
def _body(
    shape: str,
    size: tuple[float, ...],
    wall: float | None,
    sides: int | None,
    declared: tuple[tuple[object, ...], ...],
) -> ObjectBody:
    if shape not in ("compound", "mesh"):
        parts = tuple(_parts_of(shape, size, wall, sides))  # type: ignore[arg-type]  # no compound
        return ObjectBody(shape, parts, *_grasped(shape, size, parts))
    found: list[BodyPart] = []
    envelopes: list[tuple[Solid, Pose]] = []
    graspable: list[int] = []
    for name, kind, its_size, its_wall, its_sides, density, color, place, turn in declared:
        pose = Pose(np.array(place), np.array(turn))
        rgba = None if color is None else rgba_of(color)  # type: ignore[arg-type]  # as declared
        own = _parts_of(kind, its_size, its_wall, its_sides)  # type: ignore[arg-type]  # likewise
        moved = tuple(
            BodyPart(
                str(name), one.kind, one.size, pose @ one.pose, one.corners,
                float(density), rgba, one.mesh,  # type: ignore[arg-type]  # likewise
            )
            for one in own
        )  # fmt: skip
        # Another part may be in the way of fingers around a whole part: only its walls are tried.
        graspable += [len(found) + index for index in _grasped(str(kind), size, moved)[1]]
        found += moved
    return ObjectBody(shape, tuple(found), tuple(envelopes), tuple(graspable))


def _grasped(
    shape: str, size: tuple[float, ...], parts: Sequence[BodyPart]
) -> tuple[tuple[tuple[Solid, Pose], ...], tuple[int, ...]]:
    """Envelopes of a shape, and indices of the parts on which grasps are searched."""
    here = Pose.identity()
    if shape in ("bin", "tray"):
        half = 0.5 * np.array(size) if size else None
        # The floor is between the walls, where no finger fits around it.
        return ((Box(half), here),) if half is not None else (), tuple(range(1, len(parts)))
    if shape in ("tube", "cup"):
        around = ((Cylinder(size[0], 0.5 * size[1]), here),) if size else ()
        return around, _spread(parts)
    if shape == "bowl":
        rim = range(len(parts) - _BOWL_SEGMENTS, len(parts))
        return (), tuple(rim)[:: _BOWL_SEGMENTS // _RIM_GRASPS]
    return (), tuple(range(len(parts)))


def _spread(parts: Sequence[BodyPart]) -> tuple[int, ...]:
    """Indices of some segments of a round wall, evenly around its axis."""
    walls = [index for index, part in enumerate(parts) if part.kind == "hull"]
    return tuple(walls[:: max(len(walls) // _RIM_GRASPS, 1)][:_RIM_GRASPS])


def half_extents(shape: str, size: Sequence[float], turn: Matrix) -> Vector:
    """Half of the extents of a primitive along the axes of the world, of shape (3,), m.

    Args:
        shape: Name of the shape.
        size: Its size as in a tree file, m.
        turn: Rotation matrix of the shape in the world, of shape (3, 3).
    """
    if shape == "box":
        edges: Vector = np.abs(turn) @ (0.5 * np.array(size))
        return edges
    if shape == "sphere":
        return np.full(3, size[0])
    radius, length = size
    # The axis contributes its projection; the radius that of a disk across it, or of a sphere.
    along = np.abs(turn[:, 2])
    round_off = np.ones(3) if shape == "capsule" else np.sqrt(np.maximum(1.0 - along**2, 0.0))
    extents: Vector = 0.5 * length * along + radius * round_off
    return extents


# Shapes as convex parts


def _parts_of(
    shape: PartShape, size: tuple[float, ...], wall: float | None, sides: int | None
) -> Iterator[BodyPart]:
    """Convex parts of a shape; ``sides`` are the boards of a shelf."""
    thick = wall_of(shape, wall)
    if shape in ("box", "cylinder", "capsule", "sphere", "ellipsoid"):
        yield _primitive(shape, size)
    elif shape == "prism":
        around = _circle(size[0], np.arange(sides or DEFAULT_SIDES) / (sides or DEFAULT_SIDES))
        yield _hull(_between(around, around, -0.5 * size[1], 0.5 * size[1]), f"prism{size}{sides}")
    elif shape in ("bin", "tray"):
        yield from _open_box(size, thick)
    elif shape == "table":
        yield from _table(size, thick)
    elif shape == "shelf":
        yield from _shelf(size, thick, sides or DEFAULT_BOARDS)
    elif shape == "tube":
        yield from _round_wall(size[0], -0.5 * size[1], 0.5 * size[1], thick)
    elif shape == "cup":
        radius, height = size
        low = -0.5 * height
        floor = (radius - 0.5 * thick, thick)  # half into the wall, so that no gap remains
        yield _primitive("cylinder", floor, (0.0, 0.0, low + 0.5 * thick))
        yield from _round_wall(radius, low, 0.5 * height, thick)
    else:
        yield from _bowl(size, thick)


def _primitive(
    kind: Primitive,
    size: tuple[float, ...],
    place: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> BodyPart:
    return BodyPart("", kind, size, Pose.from_rpy(place), np.zeros((0, 3)))


def _hull(corners: Matrix, mesh: str, turn: float = 0.0) -> BodyPart:
    """Hull of corners in the frame of the shape, turned about its z axis by an angle in rad."""
    return BodyPart("", "hull", (), Pose.from_rpy((0, 0, 0), (0, 0, turn)), corners, mesh=mesh)


def _open_box(size: tuple[float, ...], wall: float) -> Iterator[BodyPart]:
    """Floor and four walls of a box without lid, which touch one another without overlap."""
    x, y, z = size
    up = z - wall
    lifted = 0.5 * wall
    yield _primitive("box", (x, y, wall), (0.0, 0.0, 0.5 * (wall - z)))
    for side in (-1.0, 1.0):
        yield _primitive("box", (wall, y, up), (0.5 * side * (x - wall), 0.0, lifted))
    for side in (-1.0, 1.0):
        between = (x - 2.0 * wall, wall, up)
        yield _primitive("box", between, (0.0, 0.5 * side * (y - wall), lifted))


def _table(size: tuple[float, ...], top: float) -> Iterator[BodyPart]:
    """A top and four square legs at its corners."""
    x, y, z = size
    yield _primitive("box", (x, y, top), (0.0, 0.0, 0.5 * (z - top)))
    leg = min(_LEG_M, 0.2 * x, 0.2 * y)
    for i in (-0.5, 0.5):
        for k in (-0.5, 0.5):
            place = (i * (x - leg), k * (y - leg), -0.5 * top)
            yield _primitive("box", (leg, leg, z - top), place)


_LEG_M: Final = 0.05
"""Largest width of a table's legs, m."""


def _shelf(size: tuple[float, ...], thick: float, boards: int) -> Iterator[BodyPart]:
    """Two sides, a back at +y, and boards from the bottom to the top."""
    x, y, z = size
    for side in (-0.5, 0.5):
        yield _primitive("box", (thick, y, z), (side * (x - thick), 0.0, 0.0))
    inside = x - 2.0 * thick
    yield _primitive("box", (inside, thick, z), (0.0, 0.5 * (y - thick), 0.0))
    for number in range(boards):
        height = (number / (boards - 1) - 0.5) * (z - thick)
        yield _primitive("box", (inside, y - thick, thick), (0.0, -0.5 * thick, height))


def _round_wall(radius: float, low: float, high: float, wall: float) -> Iterator[BodyPart]:
    """Segments of a round wall: the hole has the exact radius at the middle of their inner faces.

    The outer corners lie on the radius, so that the faces between them are within it by less than
    1 % (8 segments: 0.9 %).
    """
    within = radius - wall
    count = next(
        (
            number
            for number in _SEGMENTS
            if within / math.cos(math.pi / number) <= radius - _CORNER * wall
        ),
        _SEGMENTS[-1],
    )
    inner = _circle(within / math.cos(math.pi / count), np.array((-0.5, 0.5)) / count)
    outer = _circle(radius, np.linspace(-0.5, 0.5, _CHORDS + 1) / count)
    section = np.vstack((inner, outer))
    corners = _between(section, section, low, high)
    for index in range(count):
        yield _hull(corners, f"wall{radius, low, high, wall}", 2.0 * math.pi * index / count)


def _bowl(size: tuple[float, ...], wall: float) -> Iterator[BodyPart]:
    """A foot, and rings of segments from there to the rim; the profile is a quarter of an ellipse.

    Its tangent is level at the foot and vertical at the rim. The inner profile is offset by the
    wall's thickness.
    """
    radius, height = size
    foot = _FOOT * radius
    thick = (foot, wall)
    yield _primitive("cylinder", thick, (0.0, 0.0, 0.5 * (wall - height)))
    angles = np.linspace(0.0, 0.5 * math.pi, _RINGS + 1)
    wide = radius - foot
    outer = np.column_stack(
        (foot + wide * np.sin(angles), -0.5 * height + height * (1.0 - np.cos(angles)))
    )
    normal = np.column_stack((-height * np.sin(angles), wide * np.cos(angles)))
    inner = outer + wall * normal / np.linalg.norm(normal, axis=1)[:, None]
    share = np.array((-0.5, 0.5)) / _BOWL_SEGMENTS
    fine = np.array((-0.5, 0.0, 0.5)) / _BOWL_SEGMENTS
    for ring in range(_RINGS):
        rows = []
        for (r, z), at in ((outer[ring], fine), (outer[ring + 1], fine)):
            rows.append(np.column_stack((_circle(r, at), np.full(len(at), z))))
        for r, z in (inner[ring], inner[ring + 1]):
            rows.append(np.column_stack((_circle(r, share), np.full(2, z))))
        corners = np.vstack(rows)
        for index in range(_BOWL_SEGMENTS):
            turn = 2.0 * math.pi * index / _BOWL_SEGMENTS
            yield _hull(corners, f"bowl{radius, height, wall, ring}", turn)


def _circle(radius: float, turns: Vector) -> Matrix:
    """Points of a circle at shares of a whole turn, of shape (n,); of shape (n, 2), m."""
    angles = 2.0 * math.pi * turns
    return radius * np.column_stack((np.cos(angles), np.sin(angles)))


def _between(bottom: Matrix, top: Matrix, low: float, high: float) -> Matrix:
    """Corners of a prism with these sections, of shape (n, 2) each; of shape (2 n, 3), m."""
    lower = np.column_stack((bottom, np.full(len(bottom), low)))
    return np.vstack((lower, np.column_stack((top, np.full(len(top), high)))))


def unit_ball(corners: tuple[int, int] = _BALL) -> Matrix:
    """Corners of a polyhedron on the unit ball, of shape (n, 3).

    By default its faces are inside of the ball by at most `BALL_LOSS`.

    Args:
        corners: Numbers of corners around its axis, and of circles of them.
    """
    around, circles = corners
    points = [np.array(((0.0, 0.0, 1.0), (0.0, 0.0, -1.0)))]
    for number in range(1, circles - 1):
        polar = math.pi * number / (circles - 1)
        ring = _circle(math.sin(polar), (np.arange(around) + 0.5 * (number % 2)) / around)
        points.append(np.column_stack((ring, np.full(around, math.cos(polar)))))
    return np.vstack(points)


# Mass properties of one part


def _volume(part: BodyPart) -> float:
    size = part.size
    if part.kind == "box":
        return math.prod(size)
    if part.kind == "cylinder":
        return math.pi * size[0] ** 2 * size[1]
    if part.kind == "capsule":
        return math.pi * size[0] ** 2 * (size[1] + 4.0 / 3.0 * size[0])
    if part.kind == "sphere":
        return 4.0 / 3.0 * math.pi * size[0] ** 3
    if part.kind == "ellipsoid":
        return math.pi / 6.0 * math.prod(size)
    return float(scipy.spatial.ConvexHull(part.corners).volume)


def _centroid(part: BodyPart) -> Vector:
    """Center of mass in the part's frame, of shape (3,), m."""
    return _moments(part.corners)[0] if part.kind == "hull" else np.zeros(3)


def _inertia(part: BodyPart) -> Matrix:
    """Inertia about the part's center of mass in its axes for 1 kg, of shape (3, 3), m²."""
    if part.kind == "hull":
        return _moments(part.corners)[1]
    return np.diag(primitive_inertia(part.kind, part.size))


def primitive_inertia(kind: str, size: tuple[float, ...]) -> Vector:
    """Moments of inertia of a uniform primitive about its axes, for 1 kg, of shape (3,), m²."""
    if kind == "box":
        x, y, z = np.square(size)
        return np.array([y + z, z + x, x + y]) / 12
    if kind == "ellipsoid":
        x, y, z = np.square(size)
        return np.array([y + z, z + x, x + y]) / 20
    if kind == "cylinder":
        radius, length = np.square(size)
        return np.array([3 * radius + length, 3 * radius + length, 6 * radius]) / 12
    if kind == "capsule":
        radius, length = size
        # Shares of the mass: cylinder and both half balls. A half ball's center of mass is 3/8 of
        # the radius from its flat face, which gives the mixed term of the parallel-axis theorem.
        cylinder = length / (length + 4.0 / 3.0 * radius)
        ball = 1.0 - cylinder
        along = (0.5 * cylinder + 0.4 * ball) * radius**2
        across = cylinder * (length**2 / 12 + radius**2 / 4)
        across += ball * (0.4 * radius**2 + length**2 / 4 + 0.375 * length * radius)
        return np.array([across, across, along])
    return np.full(3, 0.4 * size[0] ** 2)


def _moments(corners: Matrix) -> tuple[Vector, Matrix]:
    """Center of mass, (3,), m, and inertia about it for 1 kg, (3, 3), m², of a uniform hull.

    Sums over tetrahedra from an inner point: F. Tonon, Explicit exact formulas for the 3-D
    tetrahedron inertia tensor, Journal of Mathematics and Statistics 1(1), 2005.
    """
    hull = scipy.spatial.ConvexHull(corners)
    apex = corners[hull.vertices].mean(axis=0)
    faces = corners[hull.simplices] - apex
    volumes = np.abs(np.linalg.det(faces)) / 6.0
    total = volumes.sum()
    sums = faces.sum(axis=1)
    center = volumes @ sums / 4.0 / total
    # Second moments of a tetrahedron with one corner at the origin: (sum of outer products of the
    # corners plus the outer product of their sum) times volume / 20.
    second = np.einsum("n,nki,nkj->ij", volumes, faces, faces)
    second += np.einsum("n,ni,nj->ij", volumes, sums, sums)
    second = second / 20.0 / total - np.outer(center, center)
    inertia: Matrix = np.trace(second) * np.eye(3) - second
    return apex + center, inertia


def _outline(part: BodyPart) -> Matrix:
    """Points in the part's frame whose hull is the part, round ones as polygons, (n, 3), m."""
    if part.kind == "hull":
        return part.corners
    if part.kind == "box":
        signs = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
        corners: Matrix = signs * np.array(part.size)
        return corners
    if part.kind == "cylinder":
        ring = _circle(part.size[0], np.arange(_RING) / _RING)
        return _between(ring, ring, -0.5 * part.size[1], 0.5 * part.size[1])
    if part.kind == "ellipsoid":
        return 0.5 * np.array(part.size) * unit_ball()
    ball = part.size[0] * unit_ball()
    if part.kind == "sphere":
        return ball
    end = np.array((0.0, 0.0, 0.5 * part.size[1]))
    return np.vstack((ball + end, ball - end))


_RING: Final = 36

_ALIKE_M: Final = 1e-4
"""Distance of corners up to which two parts are in the same place, m."""


_MOST_FOLDS: Final = 72
"""Largest number of rotations about an axis that is looked for: that of a fine mesh of a tube."""


def _part_of_turn(axis: int, fold: int) -> Matrix:
    """Rotation about one of the three axes by a fraction of a turn, of shape (3, 3)."""
    turn = 2.0 * math.pi / fold
    return Pose.from_rpy((0.0, 0.0, 0.0), turn * np.eye(3)[axis]).rotation_matrix


def _divisors(number: int) -> list[int]:
    return [one for one in range(1, number + 1) if number % one == 0]


def _same(first: Matrix, second: Matrix) -> bool:
    """Whether two sets of points, of shape (n, 3), m, are the same."""
    if first.shape != second.shape:
        return False
    away = scipy.spatial.KDTree(second).query(first)[0]
    return bool(away.max() < _ALIKE_M)


_APART_M: Final = 0.005
_MOST_POINTS: Final = 40
"""Distance of points on the surface of a part, m, and largest number of them along an edge."""


def _surface(corners: Matrix) -> Matrix:
    """Points on the surface of a hull, its edges included, of shape (n, 3), m."""
    found = []
    for triangle in corners[scipy.spatial.ConvexHull(corners).simplices]:
        sides = np.linalg.norm(triangle - np.roll(triangle, 1, axis=0), axis=1)
        counts = np.minimum((sides / _APART_M).astype(int) + 1, _MOST_POINTS)
        # Rows parallel to the shortest side: those of slender triangles have few points.
        a, b, c = np.roll(triangle, -int(sides.argmin()) - 1, axis=0)
        for share in np.arange(counts.max() + 1) / counts.max():
            along = np.linspace(0.0, share, math.ceil(share * counts.min()) + 1)
            found.append(a + share * (b - a) + along[:, None] * (c - b))
    points: Matrix = np.unique(np.vstack(found).round(9), axis=0)
    return points
