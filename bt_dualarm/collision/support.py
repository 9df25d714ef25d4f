"""Stability of a placed object: what supports it at a pose, and whether it tips, slides or rolls.

`support_below` lowers an object onto the geoms below it without a simulation. `bearing_ahead` finds
the first surface along a line of sight that could support something.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final

import mujoco
import numpy as np
import scipy

from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.sim.object_body import ObjectBody, body_of, half_extents

if TYPE_CHECKING:
    from bt_dualarm.sim.world import World


MARGIN_M: Final = 0.003
"""Distance of the center of mass from the edge of the support, m: an arm places objects to 1 mm,
and positions in a tree file are known to another. The edge is found by rays, up to a fifteenth of
the object's width too far inside."""

_RAYS: Final = 16
"""Rays along each axis of the footprint; even, so that none hits a sphere's lowest point."""

_FEWEST_RAYS: Final = 32
"""Rays that must hit the lower side; otherwise they are cast along the object's own axes."""

_INSET: Final = 1e-4
"""Distance of the outermost rays from the outline, m: on it, a ray may miss the object."""

_NEAR_M: Final = 0.005
"""Distance from the lowest point of a round object within which the support must be level, m."""

_LEVEL: Final = math.tan(math.radians(0.3))
"""Largest slope on which rolling friction holds a ball."""

_BULGE_M: Final = 5e-5
"""Largest rise of the support within `_NEAR_M`, m: that of a ball of 0.25 m radius."""

_UPRIGHT: Final = 0.5
"""Minimum cosine of the tilt of a standing cylinder's axis."""

_FLAT: Final = math.radians(5.0)
"""Largest slope of a surface that supports a flat object, rad."""

_STEEPEST: Final = 0.8
"""Largest slope as a fraction of the friction coefficient."""


_STILL_RAD_S: Final = 0.02
"""Largest measured speed of the joints of an arm that holds something still, rad/s."""


@dataclass(frozen=True)
class Support:
    """Support of a lowered object.

    Attributes:
        below: Distance by which it is lowered until contact, m; negative if it touches higher up.
        tilt: Largest angle by which it tips until it rests, rad, if its center of mass is up to
            `MARGIN_M` from the declared one.
        slope: Slope of the supporting surface, rad.
        friction: Coefficient of friction between the two.
        rolls: Whether it would roll away: a round object on a surface that slopes or bulges.
        topples: Whether it would roll over even on a level surface, because its center of mass is
            not in a stable position above its round lower side.
        carrier: Object in another arm's hand that is part of the support; empty if there is none.
        heading: Direction of the horizontal axes of what it stands on, rad, up to quarter turns.
        bodies: Names of the bodies it rests on.
    """

    below: float
    tilt: float
    slope: float
    friction: float
    rolls: bool
    topples: bool = False
    carrier: str = ""
    heading: float = 0.0
    bodies: frozenset[str] = frozenset()

    @property
    def slides(self) -> bool:
        """Whether friction does not hold it on the slope with a reserve of a fifth."""
        return math.tan(self.slope) > _STEEPEST * self.friction


def support_below(
    world: World, name: str, pose: Pose, above: float, below: float
) -> Support | None:
    """Support of an object at a pose, by the sensed state of the world.

    Arms and what they carry support nothing, except for what another arm holds still.

    The object is lowered without turning: the gaps between its lower side and the geoms below are
    measured along vertical rays. It comes to rest on the facet of their lower convex hull that is
    below its center of mass, and tips by the slope of that facet.

    Args:
        world: World in its current state; never changed.
        name: Name of the object; its current pose does not count.
        pose: Pose of the object in the world.
        above: Distance above the pose from which it is lowered, m.
        below: Distance below the pose to which it is lowered, m.

    Returns:
        The support; None if there is none within these distances.
    """
    drop = np.array((0.0, 0.0, above))
    lower = _lower_side(world, name, pose)
    rays = _Rays(world, name, lower)
    hits = [rays.down(point + drop) for point in lower]
    gaps = np.array([hit.length for hit in hits]) - above
    nearest = float(gaps.min())
    if not -above < nearest <= below:
        return None
    # Rays into a void are cut off: the hull needs finite gaps, and a facet that deep is steeper
    # than 45 degrees in any case.
    gaps = np.minimum(gaps, nearest + max(float(np.ptp(lower[:, :2])), below))
    spec = world.objects[name]
    body = body_of(spec)
    flat = np.column_stack((lower[:, :2] - pose.apply(body.center)[:2], gaps))
    hull = _LowerHull(flat)
    around = np.arange(8) * (math.pi / 4.0)
    # An object thinner than the margin could not keep it from its own edges.
    room = 0.4 * float(np.ptp(flat[:, :2], axis=0).min())
    ring = min(MARGIN_M, room) * np.column_stack((np.cos(around), np.sin(around)))
    tilt: float = max(hull.tilt(at) for at in (np.zeros(2), *ring))
    corners = [hits[i] for i in hull.corners(np.zeros(2))]
    bearing = [hit for hit in corners if hit.geom >= 0]
    carrier = next(filter(None, (rays.carrier_of(hit.geom) for hit in bearing)), "")
    slope = max((hit.slope for hit in bearing), default=0.0)
    heading = _heading(world, bearing[0].geom) if bearing else 0.0
    model = world.model
    bodies = frozenset(model.body(model.geom_bodyid[hit.geom]).name for hit in bearing)
    support = partial(Support, carrier=carrier, heading=heading, bodies=bodies)
    coefficients = [float(model.geom_friction[hit.geom, 0]) for hit in bearing]
    # MuJoCo combines the friction of two geoms by their maximum.
    friction = max(spec.friction, min(coefficients, default=0.0))
    axis = pose.rotation_matrix[:, 2]
    if spec.shape == "capsule" and abs(axis[2]) > _UPRIGHT:
        unstable = tilt > _LEVEL
        return support(nearest, tilt, slope, friction, rolls=unstable, topples=unstable)
    is_ball = spec.shape in ("sphere", "ellipsoid")
    is_round = is_ball or (body.is_axisymmetric and abs(axis[2]) <= _UPRIGHT)
    if not is_round:
        return support(nearest, tilt, slope, friction, rolls=False)
    # A lying cylinder, capsule or tube rolls across its axis, a sphere in any direction.
    along = axis[:2] / max(math.hypot(axis[0], axis[1]), 1e-9)
    across = [np.array((-along[1], along[0]))]
    if is_ball:
        across = [np.array((1.0, 0.0)), np.array((0.0, 1.0))]
    lowest = lower[int(np.argmin(gaps))]
    level = all(rays.is_level(lowest + drop, direction) for direction in across)
    if level and is_ball:
        rocks = spec.shape == "ellipsoid" and _off_balance(spec.size, pose.rotation_matrix)
        return support(nearest, 0.0, 0.0, friction, rolls=rocks, topples=rocks)
    if level:
        ends = (-min(MARGIN_M, room) * along, min(MARGIN_M, room) * along)
        tilt = max(abs(float(hull.gradient(at) @ along)) for at in ends)
        return support(nearest, math.atan(tilt), slope, friction, rolls=False)
    # Between two objects it lies as in a trough.
    return support(nearest, tilt, slope, friction, rolls=tilt > math.radians(1.0))


def _heading(world: World, geom: int) -> float:
    """Direction of the most horizontal axis of the body of a geom, rad."""
    axes = world.sensed.xmat[world.model.geom_bodyid[geom]].reshape(3, 3)[:2]
    lying = int(np.argmax(np.hypot(*axes)))
    return math.atan2(axes[1, lying], axes[0, lying])


def bearing_ahead(
    world: World, start: Vector, toward: Vector, passes: Collection[str]
) -> float | None:
    """Distance along a line of sight to a surface that could support an object.

    Arms and their payloads support nothing, and do not block the line.

    Args:
        world: World in its current state; never changed.
        start: Beginning of the line in the world, of shape (3,), m.
        toward: Unit vector of its direction in the world, of shape (3,).
        passes: Names of objects that do not block the line.

    Returns:
        Distance in m; None if the line hits nothing, or first something that is not level.
    """
    solid = (world.model.geom_contype != 0) | (world.model.geom_conaffinity != 0)
    left_out = _arm_geoms(world).union(
        *(world.object_geoms(name) for name in passes if name in world.objects)
    )
    hit = _first_hit(world, set(np.flatnonzero(solid).tolist()) - left_out, start, toward)
    return hit.length if math.isfinite(hit.length) and hit.slope <= _FLAT else None


@dataclass(frozen=True)
class _Hit:
    """End of a ray.

    Attributes:
        length: Length of the ray, m; infinite if it hits nothing.
        geom: Id of the geom, -1 for none.
        slope: Slope of its surface, rad.
    """

    length: float
    geom: int
    slope: float


class _Rays:
    """Vertical rays onto the fixed geoms and free objects below an object.

    Args:
        world: World in its current state.
        name: Name of the object, which is left out.
        lower: Points near which the rays start, of shape (n, 3), m.
    """

    def __init__(self, world: World, name: str, lower: Matrix) -> None:
        model = world.model
        sensed = world.sensed
        self._world = world
        middle = lower[:, :2].mean(axis=0)
        wide = float(np.linalg.norm(lower[:, :2] - middle, axis=1).max()) + 2.0 * _NEAR_M
        # Geoms whose bounding sphere no ray can hit are left out; a plane has none.
        aside = np.linalg.norm(sensed.geom_xpos[:, :2] - middle, axis=1)
        plane = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
        near = plane | (aside <= wide + model.geom_rbound)
        self._carriers = _held_still(world, name)
        left_out = _arm_geoms(world).union(world.payload_geoms(name)) - self._carriers.keys()
        solid = near & ((model.geom_contype != 0) | (model.geom_conaffinity != 0))
        self._geoms = [geom for geom in np.flatnonzero(solid).tolist() if geom not in left_out]

    def down(self, point: Vector) -> _Hit:
        """First hit of a ray downward from a point of the world, of shape (3,)."""
        return _first_hit(self._world, self._geoms, point, np.array((0.0, 0.0, -1.0)))

    def carrier_of(self, geom: int) -> str:
        """Object in another arm's hand that a geom belongs to, or rides on; empty for none."""
        return self._carriers.get(geom, "")

    def is_level(self, point: Vector, direction: Vector) -> bool:
        """Whether the surface below a point neither slopes nor bulges along a direction, (2,)."""
        step = np.array((*(_NEAR_M * direction), 0.0))
        before, here, after = (self.down(point + side * step).length for side in (-1.0, 0.0, 1.0))
        if not (math.isfinite(before) and math.isfinite(after)):
            return False
        # Central differences; a ray is longer where the surface is lower.
        slope = abs(after - before) / (2.0 * _NEAR_M)
        return slope <= _LEVEL and 0.5 * (before + after) - here <= _BULGE_M


def _arm_geoms(world: World) -> set[int]:
    """Geoms of the arms and of their payloads."""
    found = set[int]()
    for name, body in world.arms.items():
        found |= set(body.geom_ids)
        for held in world.carried_by(name):
            found.update(world.object_geoms(held))
    return found


def _held_still(world: World, name: str) -> dict[int, str]:
    """Geoms of what arms hold still that do not hold an object, with the name of what is held."""
    found = dict[int, str]()
    for held in world.attachments:
        hardware = world.hardware.get(held.arm)
        if hardware is None or held.object == name or held.arm in world.attachments.holders(name):
            continue
        if float(np.abs(hardware.v).max()) <= _STILL_RAD_S:
            found |= dict.fromkeys(world.payload_geoms(held.object), held.object)
    return found


def _first_hit(world: World, geoms: Collection[int], point: Vector, toward: Vector) -> _Hit:
    """First hit of a ray from a point of the world, of shape (3,), among some geoms."""
    model = world.model
    data = world.sensed
    best = _Hit(math.inf, -1, 0.0)
    normal = np.zeros(3)
    for geom in geoms:
        center = data.geom_xpos[geom]
        kind = int(model.geom_type[geom])
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            length = mujoco.mj_rayMesh(model, data, geom, point, toward, normal)
        else:
            axes = data.geom_xmat[geom]
            size = model.geom_size[geom]
            length = mujoco.mju_rayGeom(center, axes, size, point, toward, kind, normal)
        if 0.0 <= length < best.length:
            upward = min(abs(float(normal[2])), 1.0)
            best = _Hit(float(length), geom, math.acos(upward))
    return best


class _LowerHull:
    """Lower convex hull of points.

    Args:
        points: Horizontal positions and heights, of shape (n, 3), m.
    """

    def __init__(self, points: Matrix) -> None:
        # An apex above all points: without it, the hull of a flat support has no volume.
        apex = (*points[:, :2].mean(axis=0), points[:, 2].max() + 1.0)
        hull = scipy.spatial.ConvexHull(np.vstack((points, apex)))
        is_lower = hull.equations[:, 2] < -1e-9
        equations = hull.equations[is_lower]
        # A facet is n . x + d = 0 with the outward normal n, hence z = -(n_x x + n_y y + d) / n_z.
        self._corners = hull.simplices[is_lower]
        self._gradients = -equations[:, :2] / equations[:, 2:3]
        self._heights = -equations[:, 3] / equations[:, 2]

    def _facet(self, at: Vector) -> int:
        # The hull is convex from below: its height is the maximum over the planes of its facets.
        return int(np.argmax(self._gradients @ at + self._heights))

    def gradient(self, at: Vector) -> Vector:
        """Slope along x and y of the facet at a position, both of shape (2,)."""
        gradient: Vector = self._gradients[self._facet(at)]
        return gradient

    def tilt(self, at: Vector) -> float:
        """Slope of the facet at a position of shape (2,), rad."""
        return math.atan(float(np.linalg.norm(self.gradient(at))))

    def corners(self, at: Vector) -> list[int]:
        """Indices of the points at the corners of the facet at a position of shape (2,)."""
        found: list[int] = self._corners[self._facet(at)].tolist()
        return found


def _lower_side(world: World, name: str, pose: Pose) -> Matrix:
    """Points on the lower side of an object at a pose, of shape (n, 3), in the world, m."""
    spec = world.objects[name]
    turn = pose.rotation_matrix
    shares = np.linspace(-1.0, 1.0, _RAYS)
    body = body_of(spec)
    if not body.is_simple:
        return _lower_side_of_parts(body, pose, shares)
    geom = world.object_geom(name)
    # Rays from below hit the lower side first, whatever the shape.
    kind = int(world.model.geom_type[geom])
    size = world.model.geom_size[geom]

    def struck(yaw: Matrix) -> list[Vector]:
        """Hits of a grid of rays along the horizontal axes of a frame."""
        half = half_extents(spec.shape, spec.size, yaw.T @ turn) - (_INSET, _INSET, 0.0)
        upward = np.array((0.0, 0.0, 1.0))
        deep = pose.position[2] - half[2] - 1.0
        found = []
        for along in half[0] * shares:
            for across in half[1] * shares:
                x, y = pose.position[:2] + along * yaw[:2, 0] + across * yaw[:2, 1]
                start = np.array((x, y, deep))
                length = mujoco.mju_rayGeom(
                    pose.position, turn.ravel(), size, start, upward, kind, None
                )
                if length >= 0.0:
                    found.append(start + length * upward)
        return found

    return _enough_hits(struck, turn)


def _enough_hits(struck: Callable[[Matrix], list[Vector]], turn: Matrix) -> Matrix:
    """Hits of a grid of rays, of shape (n, 3), m.

    Args:
        struck: Hits of a grid along the horizontal axes of a frame of shape (3, 3).
        turn: Rotation of the object, of shape (3, 3).
    """
    found = struck(np.eye(3))
    # Along the axes of the world, hardly any ray of the grid hits a long thin object.
    return np.array(found if len(found) >= _FEWEST_RAYS else struck(_yaw_of_longest(turn)))


def _yaw_of_longest(turn: Matrix) -> Matrix:
    """Rotation about the vertical to the object's most level axis, both of shape (3, 3)."""
    level = turn[:, int(np.argmin(np.abs(turn[2])))]
    angle = math.atan2(level[1], level[0])
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array(((cosine, -sine, 0.0), (sine, cosine, 0.0), (0.0, 0.0, 1.0)))


def _off_balance(size: tuple[float, ...], turn: Matrix) -> bool:
    """Whether an ellipsoid's lowest point is beside its center, so that it would start to roll."""
    half = 0.5 * np.array(size)
    down = -turn[2]  # in the frame of the ellipsoid
    lowest = turn @ (half**2 * down / np.linalg.norm(half * down))
    return float(math.hypot(lowest[0], lowest[1])) > 0.5 * MARGIN_M


def _lower_side_of_parts(body: ObjectBody, pose: Pose, shares: Vector) -> Matrix:
    """Like `_lower_side`, for a body of hulls or several parts."""
    turn = pose.rotation_matrix
    upward = turn[2]

    def struck(yaw: Matrix) -> list[Vector]:
        """Hits of a grid of rays along the horizontal axes of a frame."""
        low, high = body.extents(yaw.T @ turn)
        middle = 0.5 * (low + high)
        half = 0.5 * (high - low) - (_INSET, _INSET, 0.0)
        found = []
        for along in middle[0] + half[0] * shares:
            for across in middle[1] + half[1] * shares:
                x, y = along * yaw[:2, 0] + across * yaw[:2, 1]
                start = np.array((x, y, low[2] - 1.0))
                length = body.ray(start @ turn, upward)
                if math.isfinite(length):
                    found.append(pose.position + start + (0.0, 0.0, length))
        return found

    return _enough_hits(struck, turn)
