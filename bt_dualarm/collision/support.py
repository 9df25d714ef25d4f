"""Would an object stand where it is to be put? By the shapes that are declared below it."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import mujoco
import numpy as np
import scipy

from bt_dualarm.core.pose import Matrix, Pose, Vector

if TYPE_CHECKING:
    from bt_dualarm.sim.world import World


MARGIN_M: Final = 0.003
"""Distance in meters that the center of mass keeps from the edge of what bears it: an arm puts
things down to a millimeter, and a file knows what is where to another. The edge is found by rays,
up to a fifteenth of the object's width too far inside."""

_RAYS: Final = (
    16  # along each axis of the footprint; even, so that none meets a ball's lowest point
)
_INSET: Final = 1e-4  # m from the outline, where a ray may miss
_NEAR_M: Final = 0.005  # around the lowest point of what rolls
_LEVEL: Final = math.tan(math.radians(0.3))  # slope on which a ball stays by its rolling friction
_BULGE_M: Final = 5e-5  # in that distance: a ball of 0.25 m radius
_UPRIGHT: Final = 0.5  # cosine, of a cylinder that stands
_FLAT: Final = math.radians(5.0)  # slope of what something flat may lie on
_STEEPEST: Final = 0.8  # share of the slope that friction bears


@dataclass(frozen=True)
class Support:
    """What an object meets as it is lowered, and how it stands on that.

    Attributes:
        below: Distance in m that it is lowered until it touches; negative if it touches higher up.
        tilt: Most by which it would tip until it rests, in rad, wherever its center of mass is
            within `MARGIN_M` from the middle.
        slope: Slope of what bears it, rad.
        friction: Coefficient of friction between the two.
        rolls: Whether it would roll away: it is round, and what is below it slopes or bulges.
    """

    below: float
    tilt: float
    slope: float
    friction: float
    rolls: bool

    @property
    def slides(self) -> bool:
        """Whether friction does not hold it on the slope, with a fifth of it in hand."""
        return math.tan(self.slope) > _STEEPEST * self.friction


def support_below(
    world: World, thing: str, pose: Pose, above: float, below: float
) -> Support | None:
    """What would bear an object at a pose, by the shapes of the world as plans know it.

    Arms and what they hold bear nothing.

    The object is lowered without turning: the gaps between its lower side and what is below it are
    measured along vertical rays. It comes to rest on the facet of their lower convex hull that is
    below its center of mass, and tips by the slope of that facet.

    Args:
        world: World that is looked at now, and never changed.
        thing: Name of the object; where that is now does not count.
        pose: Pose in the world.
        above: Distance in m above the pose from which it is lowered.
        below: Distance in m below the pose to which it is.

    Returns:
        The support; None where it meets nothing in between.
    """
    drop = np.array((0.0, 0.0, above))
    lower = _lower_side(world, thing, pose)
    rays = _Rays(world, thing, lower)
    hits = [rays.down(point + drop) for point in lower]
    gaps = np.array([hit.length for hit in hits]) - above
    nearest = float(gaps.min())
    if not -above < nearest <= below:
        return None
    gaps = np.minimum(gaps, nearest + max(float(np.ptp(lower[:, :2])), below))
    flat = np.column_stack((lower[:, :2] - pose.position[:2], gaps))
    hull = _LowerHull(flat)
    around = np.arange(8) * (math.pi / 4.0)
    room = 0.4 * float(np.ptp(flat[:, :2], axis=0).min())  # of what is thinner than the margin
    ring = min(MARGIN_M, room) * np.column_stack((np.cos(around), np.sin(around)))
    tilt: float = max(hull.tilt(at) for at in (np.zeros(2), *ring))
    bearing = [hits[i] for i in hull.corners(np.zeros(2))]
    near = [hit for hit in bearing if hit.geom >= 0]
    slope = max((hit.slope for hit in near), default=0.0)
    rubs = [float(world.model.geom_friction[hit.geom, 0]) for hit in near]
    friction = max(world.objects[thing].friction, min(rubs, default=0.0))
    spec = world.objects[thing]
    axis = pose.rotation_matrix[:, 2]
    if spec.shape == "box" or (spec.shape == "cylinder" and abs(axis[2]) > _UPRIGHT):
        return Support(nearest, tilt, slope, friction, rolls=False)
    if spec.shape == "capsule" and abs(axis[2]) > _UPRIGHT:
        return Support(nearest, tilt, slope, friction, rolls=tilt > _LEVEL)
    along = axis[:2] / max(math.hypot(axis[0], axis[1]), 1e-9)
    across = [np.array((-along[1], along[0]))]
    if spec.shape == "sphere":
        across = [np.array((1.0, 0.0)), np.array((0.0, 1.0))]
    lowest = lower[int(np.argmin(gaps))]
    level = all(rays.is_level(lowest + drop, way) for way in across)
    if level and spec.shape == "sphere":
        return Support(nearest, 0.0, 0.0, friction, rolls=False)
    if level:
        ends = (-min(MARGIN_M, room) * along, min(MARGIN_M, room) * along)
        tilt = max(abs(float(hull.gradient(at) @ along)) for at in ends)
        return Support(nearest, math.atan(tilt), slope, friction, rolls=False)
    # Between two things it lies as in a trough.
    return Support(nearest, tilt, slope, friction, rolls=tilt > math.radians(1.0))


def bearing_ahead(
    world: World, start: Vector, toward: Vector, passes: Collection[str]
) -> float | None:
    """How far away what could bear something is along a line of sight, by the shapes of plans.

    Arms and what they hold bear nothing.

    Args:
        world: World that is looked at now, and never changed.
        start: Where the line begins, of shape (3,), m.
        toward: Its direction, of shape (3,) and length 1.
        passes: Names of objects that are looked through.

    Returns:
        Distance in m; None where the line meets nothing, or nothing that faces upward there.
    """
    solid = (world.model.geom_contype != 0) | (world.model.geom_conaffinity != 0)
    left_out = _borne(world) | {world.object_geom(name) for name in passes if name in world.objects}
    hit = _first_hit(world, set(np.flatnonzero(solid).tolist()) - left_out, start, toward)
    return hit.length if math.isfinite(hit.length) and hit.slope <= _FLAT else None


@dataclass(frozen=True)
class _Hit:
    """Where a ray ends.

    Attributes:
        length: Way in m; infinite where nothing is below.
        geom: Id of the shape, -1 for none.
        slope: Slope of its surface, rad.
    """

    length: float
    geom: int
    slope: float


class _Rays:
    """Vertical rays onto what stands still below an object.

    Args:
        world: World that is looked at now.
        thing: Name of the object, which is left out.
        lower: Points from near which rays go down, of shape (n, 3), m.
    """

    def __init__(self, world: World, thing: str, lower: Matrix) -> None:
        model = world.model
        sensed = world.sensed
        self._world = world
        middle = lower[:, :2].mean(axis=0)
        wide = float(np.linalg.norm(lower[:, :2] - middle, axis=1).max()) + 2.0 * _NEAR_M
        aside = np.linalg.norm(sensed.geom_xpos[:, :2] - middle, axis=1)
        plane = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
        near = plane | (aside <= wide + model.geom_rbound)
        left_out = {world.object_geom(thing)} | _borne(world)
        solid = near & ((model.geom_contype != 0) | (model.geom_conaffinity != 0))
        self._geoms = [geom for geom in np.flatnonzero(solid).tolist() if geom not in left_out]

    def down(self, point: Vector) -> _Hit:
        """Where a ray downwards from a point of the world, of shape (3,), ends."""
        return _first_hit(self._world, self._geoms, point, np.array((0.0, 0.0, -1.0)))

    def is_level(self, point: Vector, way: Vector) -> bool:
        """Whether what is below a point neither slopes nor bulges along a way of shape (2,)."""
        step = np.array((*(_NEAR_M * way), 0.0))
        back, here, on = (self.down(point + side * step).length for side in (-1.0, 0.0, 1.0))
        if not (math.isfinite(back) and math.isfinite(on)):
            return False
        slope = abs(on - back) / (2.0 * _NEAR_M)
        return slope <= _LEVEL and 0.5 * (back + on) - here <= _BULGE_M


def _borne(world: World) -> set[int]:
    """Shapes of the arms and of what they hold."""
    found = set[int]()
    for name, body in world.arms.items():
        found |= set(body.geom_ids)
        found |= {world.object_geom(held) for held in world.attachments.attached_to(name)}
    return found


def _first_hit(world: World, geoms: Collection[int], point: Vector, toward: Vector) -> _Hit:
    """Where a ray from a point of the world, of shape (3,), first meets one of some shapes."""
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
            upward = min(abs(float(normal[2])), 1.0) or 1.0
            best = _Hit(float(length), geom, math.acos(upward))
    return best


class _LowerHull:
    """The lower convex hull of points.

    Args:
        points: Places and heights, of shape (n, 3), m.
    """

    def __init__(self, points: Matrix) -> None:
        apex = (*points[:, :2].mean(axis=0), points[:, 2].max() + 1.0)  # else it may have no volume
        hull = scipy.spatial.ConvexHull(np.vstack((points, apex)))
        is_lower = hull.equations[:, 2] < -1e-9
        equations = hull.equations[is_lower]
        self._corners = hull.simplices[is_lower]
        self._gradients = -equations[:, :2] / equations[:, 2:3]
        self._heights = -equations[:, 3] / equations[:, 2]

    def _facet(self, at: Vector) -> int:
        return int(np.argmax(self._gradients @ at + self._heights))

    def gradient(self, at: Vector) -> Vector:
        """Slope along x and y of the facet at a place, each of shape (2,)."""
        gradient: Vector = self._gradients[self._facet(at)]
        return gradient

    def tilt(self, at: Vector) -> float:
        """Angle of that facet, rad."""
        return math.atan(float(np.linalg.norm(self.gradient(at))))

    def corners(self, at: Vector) -> list[int]:
        """Which of the points are its corners."""
        found: list[int] = self._corners[self._facet(at)].tolist()
        return found


def _lower_side(world: World, thing: str, pose: Pose) -> Matrix:
    """Points on the lower side of an object at a pose, of shape (n, 3), in the world, m."""
    spec = world.objects[thing]
    geom = world.object_geom(thing)
    turn = pose.rotation_matrix
    half = half_extents(spec.shape, spec.size, turn) - (_INSET, _INSET, 0.0)
    shares = np.linspace(-1.0, 1.0, _RAYS)
    upward = np.array((0.0, 0.0, 1.0))
    deep = pose.position[2] - half[2] - 1.0
    size = world.model.geom_size[geom]
    kind = int(world.model.geom_type[geom])
    found = []
    for x in (pose.position[0] + half[0] * shares).tolist():
        for y in (pose.position[1] + half[1] * shares).tolist():
            start = np.array((x, y, deep))
            length = mujoco.mju_rayGeom(
                pose.position, turn.ravel(), size, start, upward, kind, None
            )
            if length >= 0.0:
                found.append(start + length * upward)
    return np.array(found)


def half_extents(shape: str, size: Sequence[float], turn: Matrix) -> Vector:
    """Half of what a shape measures along the axes of the world, of shape (3,), m.

    Args:
        shape: Name of the shape.
        size: Its size, as a tree file has it.
        turn: Its axes in the world, of shape (3, 3).
    """
    if shape == "box":
        edges: Vector = np.abs(turn) @ (0.5 * np.array(size))
        return edges
    if shape == "sphere":
        return np.full(3, size[0])
    radius, length = size
    along = np.abs(turn[:, 2])
    round_off = np.ones(3) if shape == "capsule" else np.sqrt(np.maximum(1.0 - along**2, 0.0))
    extents: Vector = 0.5 * length * along + radius * round_off
    return extents
