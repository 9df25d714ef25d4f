"""Looking for objects with the arm's camera: viewpoints, still images, ports."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Final, Literal, NamedTuple, TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from bt_dualarm.arm.arm import Arm
from bt_dualarm.collision.support import bearing_ahead
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.perception.detection import ColorFilter, ColorlessError, Detection, color_of, detect
from bt_dualarm.perception.known_shape import KnownShape
from bt_dualarm.perception.scan import MarkView, SightedObject, SightedObjects
from bt_dualarm.perception.shape_fit import SIZE_ROOM, SIZE_SIGMAS, merged
from bt_dualarm.sim.camera import GuardedCamera
from bt_dualarm.sim.composition import CAMERA, marker_height
from bt_dualarm.sim.frame import Frame
from bt_dualarm.sim.world import World
from bt_dualarm.spec.cell import CellZone, Region, RegionOrZone
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.node_types import PortModel, port
from bt_dualarm.spec.values import SIZE_IN_WORDS, SIZES, Color, MarkerSpec, ObjectName, ShapeName

FRAMES: Final = 6
"""Images that are averaged in one view of a mark."""

_WAIT_S: Final = 1.0  # simulated seconds to wait for lost images, in addition to the exposures

Mask: TypeAlias = npt.NDArray[np.bool_]

_Length: TypeAlias = Annotated[float, Field(ge=1e-4, le=10.0)]


_NO_ZONES: Final[Mapping[str, CellZone]] = MappingProxyType({})


class SightPorts(PortModel):
    """Ports that define what to detect: a declared object, a shape with its color, a marker."""

    exactly_one_of = ("object", "shape", "marker")

    object: ObjectName | None = port(
        None, "declared object whose color, shape and size are looked for; its pose is not used"
    )
    by: Literal["color", "marker"] = port(
        "color", "detect the object by its color and shape, or by the marker on it"
    )
    marker: MarkerSpec | None = port(
        None, "marker to detect if no object is named; its z axis points out of it"
    )
    shape: ShapeName | None = port(None, "shape to detect if no object is named")
    size: tuple[_Length, ...] | None = port(
        None,
        SIZE_IN_WORDS.lower(),
        unit="m",
        min_length=1,
        max_length=3,
    )
    color: Color | None = port(None, "a name or HSV ranges; by default that of the object")
    flat: bool = port(
        True, "whether objects lie flat on a level surface: one of their axes is vertical"
    )

    region: RegionOrZone | None = port(
        None,
        "zone of the cell, or region of the world, in which the objects are; what is elsewhere is "
        "ignored",
    )

    @model_validator(mode="after")
    def _has_a_whole_shape(self) -> SightPorts:
        if self.shape is not None:
            if self.size is None or self.color is None:
                raise ValueError("a shape needs its size and color")
            wanted = len(SIZES[self.shape])
            if len(self.size) != wanted:
                found = len(self.size)
                raise ValueError(f"the size of a {self.shape} has {wanted} numbers, not {found}")
        return self

    @property
    def wanted(self) -> str:
        """Description of what is to be detected, the same for equal ports."""
        names = ("object", "by", "marker", "shape", "size", "color")
        return "; ".join(f"{name}: {getattr(self, name)!r}" for name in names)

    @property
    def is_by_marker(self) -> bool:
        """Whether a marker is to be detected."""
        return self.marker is not None or (self.object is not None and self.by == "marker")

    def sighted(
        self, arm: Arm, zones: Mapping[str, CellZone] = _NO_ZONES, *, looks_again: bool = False
    ) -> SightedObjects:
        """Detector of such objects, by images alone: a declared object need not be in the world.

        Args:
            arm: Arm with the camera.
            zones: Zones of the cell by name.
            looks_again: Whether the arm moves to see the whole of what an arm may hide.

        Raises:
            Failure: ``INVALID_TARGET``: color, size or marker are missing, or there is no such
                zone; ``UNKNOWN_POSE`` if the zone moves with an object whose pose is not known.
        """
        seen = self._sighted(arm)
        if looks_again and not self.is_by_marker:
            wanted = self.object
            seen.beside(lambda frame, points: arms_before(arm, frame, points, wanted))
        if self.region is None:
            return seen
        frame, region = self.placed_region(arm, zones)
        return seen.within(frame, region)

    def placed_region(self, arm: Arm, zones: Mapping[str, CellZone]) -> tuple[Pose, Region]:
        """Pose of the region in the world, and the region; arguments as for `sighted`.

        Raises:
            Failure: ``INVALID_TARGET``, ``UNKNOWN_POSE``, as `sighted`.
        """
        region = self.region
        if isinstance(region, str):
            if region not in zones:
                raise Failure("INVALID_TARGET", f"the cell has no zone {region!r}")
            region = zones[region]
        if region is None:
            raise Failure("INVALID_TARGET", "no region is given")
        frame = region.pose.pose
        if isinstance(region, CellZone) and region.around is not None:
            frame = arm.known.pose(region.around).pose @ frame
        return frame, region

    def _sighted(self, arm: Arm) -> SightedObjects:
        """Detector of such objects anywhere."""
        if self.object is not None:
            return self._like(arm.world.declared_objects[self.object])
        if self.marker is not None:
            return SightedObjects.of_marker(self.marker, flat=self.flat)
        if self.shape is None or self.size is None or self.color is None:
            raise Failure("INVALID_TARGET", "a shape needs its size and color")
        wanted = len(SIZES[self.shape])
        if len(self.size) != wanted:
            reason = f"the size of a {self.shape} has {wanted} numbers, not {len(self.size)}"
            raise Failure("INVALID_TARGET", reason)
        shape = KnownShape(self.shape, self.size)
        return SightedObjects.of_color(self.color, shape, flat=self.flat)

    def _like(self, obj: ObjectSpec) -> SightedObjects:
        """Detector of objects that look like a declared one."""
        if self.by == "marker":
            if obj.marker is None:
                raise Failure("INVALID_TARGET", f"object {self.object!r} has no marker")
            below = np.array((0.0, 0.0, -marker_height(obj)))
            return SightedObjects.of_marker(obj.marker, below, flat=self.flat)
        try:
            color = self.color or color_of(obj)
        except ColorlessError as error:
            raise Failure("INVALID_TARGET", f"{error}: give `color`") from error
        return SightedObjects.of_color(color, KnownShape.of(obj), flat=self.flat)

    @property
    def ignored(self) -> frozenset[str]:
        """Objects that plans must ignore: the one to detect, since its pose is not known yet."""
        return frozenset({self.object} if self.object else ())


def own_camera(arm: Arm) -> GuardedCamera:
    """Wrist camera of an arm.

    Raises:
        Failure: ``NO_CAMERA``.
    """
    if arm.camera is None or not arm.world.declared_arms[arm.name].carries_camera:
        raise Failure("NO_CAMERA", f"{arm.name} has no camera that moves with it")
    return arm.camera


def still_picture(arm: Arm, count: int) -> Generator[None, None, Frame | None]:
    """Average images taken from the current pose; yields once per tick.

    Args:
        arm: Arm at rest, with a camera of its own.
        count: Number of images.

    Returns:
        The average of the images that arrived in time; None if none did.

    Raises:
        Failure: ``NO_CAMERA``.
    """
    camera = own_camera(arm)
    began = arm.time
    taken = list[Frame]()

    def take(frame: Frame) -> None:
        if frame.stamp >= began and frame.stride == 1:
            taken.append(frame)

    unsubscribe = camera.subscribe(take)
    try:
        latest = began + count * camera.period + camera.latency + _WAIT_S
        while len(taken) < count and arm.time < latest:
            yield
    finally:
        unsubscribe()
    return merged(taken) if taken else None


_UNREACHED: Final = {
    "INVALID_TARGET",  # outside the workspace
    "UNREACHABLE",
    "JOINT_LIMIT",
    "OVERLOADED",  # it cannot be held there
    "IN_COLLISION",
    "NO_PLAN",
    "SINGULAR",
}


@dataclass(frozen=True)
class Side:
    """Viewpoint relative to the first view of a point.

    Attributes:
        across: Rotation about the point, about the image's horizontal axis, degrees.
        along: The same about the image's vertical axis.
        roll: Rotation about the line of sight, degrees.
        share: Distance as a fraction of the nominal one.
    """

    across: float = 0.0
    along: float = 0.0
    roll: float = 0.0
    share: float = 1.0

    def camera(self, point: Vector, looking: Vector, distance: float) -> Pose:
        """Pose of the camera in the world.

        Args:
            point: Point at the image center, in the world, of shape (3,), m.
            looking: Quaternion of the camera at the first view, of shape (4,).
            distance: Nominal distance from the point, m.
        """
        across, along, roll = np.radians((self.across, self.along, self.roll))
        around = Pose.from_rpy((0, 0, 0), (across, along, roll))
        back = Pose.from_rpy((0, 0, -self.share * distance))
        return Pose(point, looking) @ around @ back


SIDES: Final = (
    Side(across=14, roll=30),
    Side(across=-14, roll=-30),
    Side(along=14, share=0.85),
    Side(along=-14),
    Side(across=10, along=10, roll=-40),
    Side(across=-10, along=-10, roll=40),
    Side(across=20, share=1.2),
    Side(across=-20, share=1.2),
    Side(along=20, share=1.2),
    Side(along=-20, share=1.2),
    Side(across=10, roll=60),
    Side(across=-10, roll=-60),
    Side(along=10, roll=90),
    Side(along=-10, roll=-90),
    Side(across=8, along=-8, roll=20, share=0.8),
    Side(across=-8, along=8, roll=-20, share=0.8),
    Side(across=24, along=8, roll=45, share=1.2),
    Side(across=-24, along=8, roll=-45, share=1.2),
    Side(share=0.8),
    Side(share=1.4, roll=20),
    *(
        Side(across, along, roll)
        for across, along in (
            (0, 0),
            *((14, 0), (-14, 0), (0, 14), (0, -14)),
            *((10, 10), (-10, -10), (10, -10), (-10, 10)),
            *((20, 0), (-20, 0), (0, 20), (0, -20)),
        )
        for roll in (60, -60)
    ),
    *(
        Side(across, along, roll)
        for across, along in ((20, 0), (-20, 0), (0, 20), (0, -20))
        for roll in (30, -30)
    ),
)
"""Viewpoints in pairs to either side, so that errors of the camera's mount become visible; rolls
of the camera about the line of sight show them best, as they leave the object where it is."""


def go_to_camera(
    arm: Arm,
    camera: Pose,
    speed: float,
    ignore: frozenset[str] = frozenset(),
    *,
    began_s: float | None = None,
    at: Vector | None = None,
) -> Generator[float | None, None, bool]:
    """Move the wrist camera to a pose in the world; yields once per tick.

    Args:
        arm: Arm with a wrist camera.
        camera: Pose of the camera (x right, y down, z forward).
        speed: Fraction of the limits, above 0 to 1.
        ignore: Names of objects that may be touched.
        began_s: Simulated time at which the caller chose the pose and began to plan, s; by default
            now.
        at: Point in the world that the arm itself must not hide there, of shape (3,), m.

    Returns:
        Whether the pose was reached; if not, the arm has not moved.

    Raises:
        Failure: As `Arm.travel`, but for a pose that cannot be reached.
    """
    return (yield from _refusal(arm, camera, speed, ignore, began_s, at)) is None


def _refusal(
    arm: Arm,
    camera: Pose,
    speed: float,
    ignore: frozenset[str],
    began_s: float | None = None,
    at: Vector | None = None,
) -> Generator[float | None, None, Failure | None]:
    """Move like `go_to_camera`; returns why the pose was not reached, None if it was.

    With ``at``, a point in the world of shape (3,), m, only to configurations in which the arm does
    not hide it; ``OCCLUDED`` if there is none.
    """
    camera_in_tool = arm.tool_pose.inverse @ camera_now(arm)
    try:
        goals = arm.configurations(camera @ camera_in_tool.inverse)
        if at is not None:
            clear = [q for q in goals if not _hides(arm, q, at)]
            if len(goals) and not clear:
                yield None
                return Failure("OCCLUDED", "the arm itself would be in the way")
            goals = clear
        yield from arm.travel(goals, speed, ignore, began_s=began_s, turns=True)
    except Failure as failure:
        if failure.code not in _UNREACHED:
            raise
        yield None  # one attempt a tick, since each takes computing time
        return failure.with_traceback(None)
    return None


_SEARCHES: Final = 6
"""Poses to which no path may be found before `look_at` gives up: each takes seconds of computing,
and an arm that is enclosed, as by a hole around what it holds, finds none to any of 156 poses."""


def gazes(
    point: Vector, distance: float, direction: Vector, lean: float, near: Pose
) -> Iterator[Pose]:
    """Poses of a camera that looks at a point, the preferred ones first.

    Args:
        point: Point at the image center, in the world, of shape (3,), m.
        distance: Distance from it, m.
        direction: Preferred line of sight in the world, of shape (3,), of any nonzero length.
        lean: Largest angle between line of sight and ``direction``, rad.
        near: Current pose of the camera: rolls about the line of sight that are nearer come first.
    """
    along = direction / np.linalg.norm(direction)
    side = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    side /= np.linalg.norm(side)
    for share, around in _LEANS:
        turn = np.cos(around) * side + np.sin(around) * np.cross(along, side)
        sight = np.cos(share * lean) * along + np.sin(share * lean) * turn
        x = side - (side @ sight) * sight
        if np.linalg.norm(x) < _PARALLEL:  # leaned by 90°: sight lies along side
            x = along - (along @ sight) * sight
        x /= np.linalg.norm(x)
        rolled = [_gaze(point, distance, sight, x, roll) for roll in _ROLLS]
        yield from sorted(rolled, key=near.angle)


_ROLLS: Final = tuple(np.radians(np.arange(0, 360, 30)).tolist())
_LEANS: Final = (
    (0.0, 0.0),
    *((share, around) for share in (0.5, 1.0) for around in np.radians(np.arange(0, 360, 60))),
)
"""Fractions of the angle ``lean``, and the direction of leaning, rad."""


_PARALLEL: Final = 1e-6
"""Largest sine of the angle between parallel lines."""


def _gaze(point: Vector, distance: float, sight: Vector, x: Vector, roll: float) -> Pose:
    axes = np.column_stack((x, np.cross(sight, x), sight))
    upright = Pose.from_axes(point - distance * sight, axes.tolist())
    return upright @ Pose.from_rpy((0, 0, 0), (0, 0, roll))


def least_hidden(
    arm: Arm, cameras: Iterable[Pose], center: Pose, shape: KnownShape, obj: str | None = None
) -> list[Pose]:
    """Sort poses of a camera by how much of an object is hidden from there, see `hidden_share`.

    Poses from which equally much is hidden keep their order.
    """
    return sorted(cameras, key=lambda camera: hidden_share(arm, camera, center, shape, obj))


def hidden_share(
    arm: Arm, camera: Pose, center: Pose, shape: KnownShape, obj: str | None = None
) -> float:
    """Share of the outline of an object that other things hide from a pose of a camera.

    These are other arms, where their encoders are now, with what they hold, and, if the object is
    one of the world, all other shapes that plans use. The arm itself, which will be elsewhere, does
    not count.

    Args:
        arm: Arm with the camera.
        camera: Pose of its camera in the world.
        center: Pose of the center of the object's shape in the world.
        shape: Its shape.
        obj: Its name, if it is where the world has it.
    """
    world = arm.world
    others = [name for name in world.arms if name != arm.name]
    if obj is None and not others:
        return 0.0
    state = world.model, world.sensed
    eye = camera.position
    outline = shape.seen_from(eye - center.position, center.rotation_matrix)
    outline = outline[:: max(len(outline) // _OUTLINE_RAYS, 1)]
    rays = center.position + (_BEYOND if obj is None else _WITHIN) * outline - eye
    if obj is None:
        away = _hits_arms(arm, state, eye, rays, others)
        return float(((away > 0.0) & (away < 1.0)).mean())
    geoms, away = _first_hits(state, arm.name, eye, rays)
    bodies = state[0].geom_bodyid
    passed = bodies[[*world.arms[arm.name].geom_ids, *world.object_geoms(obj)]]
    is_hit = (geoms >= 0) & (away < 1.0) & ~np.isin(bodies[geoms], passed)
    return float(is_hit.mean())


_OUTLINE_RAYS: Final = 24
"""Points of an outline for which it is determined whether something hides them."""

_WITHIN: Final = 0.9
"""Where these points are, as a share of their distance from the center: the support of an object
does not hide its lower edge."""

_BEYOND: Final = 1.3
"""The same for an object whose pose is not known yet."""


def look_at(
    arm: Arm,
    cameras: Iterable[Pose],
    speed: float,
    ignore: frozenset[str] = frozenset(),
    *,
    at: Vector,
) -> Generator[float | None, None, Pose | None]:
    """Move the wrist camera to the first of several poses that is reachable.

    Poses in which the arm itself hides what it looks at come last.

    Args:
        arm: Arm with a wrist camera.
        cameras: Poses of the camera in the world, the preferred one first.
        speed: Fraction of the limits, above 0 to 1.
        ignore: Names of objects that may be touched.
        at: Point at the image center, in the world, of shape (3,), m.

    Returns:
        The pose; None if none of them is reachable.

    Raises:
        Failure: As `go_to_camera`; ``NO_PLAN`` if searches for a path to several of them failed.
    """
    searches = 0
    tool_in_camera = camera_now(arm).inverse @ arm.tool_pose
    occluded: list[Pose] = []
    for camera in cameras:
        if arm.kinematics.is_beyond(camera @ tool_in_camera):
            continue  # at once: a search for it would take 30 ms, and a tick
        refusal = yield from _refusal(arm, camera, speed, ignore, at=at)
        if refusal is None:
            return camera
        if refusal.code == "OCCLUDED":
            occluded.append(camera)
        searches += refusal.code == "NO_PLAN"
        if searches == _SEARCHES:
            raise refusal
    for camera in occluded[:_SEARCHES]:
        if (yield from _refusal(arm, camera, speed, ignore)) is None:
            return camera
    return None


def camera_now(arm: Arm) -> Pose:
    """Pose of the wrist camera in the world, from the encoders and the nominal model.

    Raises:
        Failure: ``NO_CAMERA``: the arm has none.
    """
    return arm.world.nominal[arm.name].camera_pose_at(arm.q)


_SAMPLES: Final = 5
"""Points along each edge of a part of an area, by which it counts as seen."""

_CELL_PX: Final = 8
"""Edge of the squares of an image for which it is known whether an arm hides what is behind."""

_NEAREST_M: Final = 0.005
"""Distance up to which the link that carries the camera hides nothing: its shape may contain it."""


def hidden_by_arms(arm: Arm, frame: Frame) -> Mask:
    """Which squares of an image show an arm: its links, its hand, or what it holds.

    Args:
        arm: Arm with the camera, which has not moved since the exposure.
        frame: The image.

    Returns:
        Array of shape (rows, columns), of squares of `_CELL_PX`; by the encoders and the shapes
        that plans use.
    """
    return np.isfinite(_depths_of_arms(arm, frame))


def arms_in_view(arm: Arm, frame: Frame) -> dict[str, float]:
    """Shares of an image that show other arms, or what they hold, by name; see `hidden_by_arms`."""
    world = arm.world
    shares = dict[str, float]()
    for name in world.arms:
        if name != arm.name:
            share = float(np.isfinite(_depths_of_arms(arm, frame, (name,))).mean())
            if share > 0.0:
                shares[name] = share
    return shares


def hidden_point(
    arm: Arm, frame: Frame, seen: SightedObjects, distance: float
) -> tuple[Vector, Vector] | None:
    """What an image shows only in part, or what another arm in its middle may hide.

    What its border cuts off is assumed at a distance, so that the camera turns in place. What an
    arm hides is assumed on the surface behind it, to look there from another side.

    Args:
        arm: Arm with the camera, which has not moved since the exposure.
        frame: The image.
        seen: Detector that has processed the image as the last one.
        distance: Distance of what the border cuts off, m, and where no level surface is known.

    Returns:
        A point in the world, of shape (3,), m, and the line of sight to it, a unit vector; None if
        there is neither.
    """
    world = arm.world
    others = [name for name in world.arms if name != arm.name]
    if seen.cut_off:
        eye, sight = seen.cut_off[0]
    elif others and np.isfinite(arms_before(arm, frame, np.zeros((1, 2)), names=others)).all():
        eye, sight = frame.pose.position, frame.pose.rotation_matrix[:, 2]
    else:
        return None
    along = sight / np.linalg.norm(sight)
    if seen.cut_off and not seen.behind_arm:
        return eye + distance * along, along
    alike = [name for name, one in world.objects.items() if seen.has_color(one.rgba)]
    away = bearing_ahead(world, eye, along, alike)
    return eye + (distance if away is None else away) * along, along


def _depths_of_arms(arm: Arm, frame: Frame, names: Iterable[str] | None = None) -> Matrix:
    """Depths of some arms, by default all, in the squares of an image; see `arms_before`."""
    columns, rows = (max(size // _CELL_PX, 1) for size in (frame.width, frame.height))
    x, y = np.meshgrid(
        (np.arange(columns) + 0.5) * frame.width / columns - 0.5 * frame.width,
        (np.arange(rows) + 0.5) * frame.height / rows - 0.5 * frame.height,
    )
    points = np.column_stack((x.ravel(), y.ravel()))
    return arms_before(arm, frame, points, names=names).reshape(rows, columns)


def arms_before(
    arm: Arm,
    frame: Frame,
    points: Matrix,
    wanted: str | None = None,
    names: Iterable[str] | None = None,
) -> Vector:
    """How far ahead an image shows an arm: its links, its hand, or what it holds.

    Args:
        arm: Arm with the camera, which has not moved since the exposure.
        frame: The image.
        points: Points relative to the image center, of shape (n, 2), px.
        wanted: Name of a held object that does not count: the one that is looked for.
        names: Names of the arms that count; by default all.

    Returns:
        Depths along the optical axis, of shape (n,), m; infinite where something else, or nothing,
        is first. By the encoders and the shapes that plans use.
    """
    rays = np.column_stack((points, np.full(len(points), frame.focal_px))) / frame.focal_px
    rays = rays @ frame.pose.rotation_matrix.T
    state = arm.world.model, arm.world.sensed
    every = arm.world.arms if names is None else names
    depths = _hits_arms(arm, state, frame.pose.position, rays, every, wanted)
    return np.where(depths > 0.0, depths, np.inf)


def _hides(arm: Arm, q: Vector, point: Vector) -> bool:
    """Whether the arm would hide a point from its camera.

    Args:
        arm: Arm with a wrist camera.
        q: Its configuration then, of shape (dof,), rad.
        point: The point in the world, of shape (3,), m.
    """
    checker = arm.checker()
    checker.place(q)
    eye = arm.world.nominal[arm.name].camera_pose_at(q).position
    state = checker.model, checker.data
    (away,) = _hits_arms(arm, state, eye, (point - eye)[None], (arm.name,))
    return bool(0.0 < away < 1.0)


def _hits_arms(
    arm: Arm,
    state: _State,
    eye: Vector,
    rays: Matrix,
    names: Iterable[str],
    wanted: str | None = None,
) -> Vector:
    """How far along rays arms are, with their hands and what they hold.

    Args:
        arm: Arm with the camera.
        state: The model of its world, with the positions of all geoms.
        eye: Where the rays begin, in the world, of shape (3,), m.
        rays: Directions of any length in the world, of shape (n, 3), m.
        names: Names of the arms that count.
        wanted: Name of a held object that does not count.

    Returns:
        Distances as multiples of the length of the rays, of shape (n,); -1 where something else, or
        nothing, is hit first.
    """
    world = arm.world
    geoms, away = _first_hits(state, arm.name, eye, rays)
    counted = set[int]()
    for name in names:
        counted.update(world.arms[name].geom_ids)
        for obj in world.attachments.attached_to(name):
            if obj != wanted:
                counted |= world.payload_geoms(obj)
    # By their bodies: for collisions, the convex parts of a link stand for the mesh that is seen.
    body_of = state[0].geom_bodyid
    is_arm = np.isin(body_of[geoms], body_of[list(counted)]) & (geoms >= 0)
    found: Vector = np.where(is_arm, away, -1.0)
    return found


def geoms_ahead(world: World, name: str, rays: Matrix) -> npt.NDArray[np.int32]:
    """First geoms before an arm's camera, by the encoders and the shapes that plans use.

    Args:
        world: World with the arm.
        name: Name of the arm.
        rays: Directions in the camera's frame, of shape (n, 3).

    Returns:
        Geoms, of shape (n,); -1 where there is none.
    """
    state = world.model, world.sensed
    camera = world.nominal[name].camera_pose_at(world.sensed.qpos[world.arms[name].qpos_ids])
    return _first_hits(state, name, camera.position, rays @ camera.rotation_matrix.T)[0]


_State: TypeAlias = tuple[mujoco.MjModel, mujoco.MjData]


def _first_hits(
    state: _State, name: str, eye: Vector, rays: Matrix
) -> tuple[npt.NDArray[np.int32], Vector]:
    """First geoms along rays from an arm's camera; -1 where there is none.

    Also the distances to them, as multiples of the length of the rays; arguments as `_hits_arms`.
    """
    model, data = state
    geoms = np.empty(len(rays), np.int32)
    away = np.empty(len(rays))
    mujoco.mj_multiRay(
        model, data, eye, rays.ravel(), None, True, -1, geoms, away, None, len(rays),
        mujoco.mjMAXVAL,
    )  # fmt: skip
    welded = model.body_weldid
    is_mount = welded[model.geom_bodyid[geoms]] == welded[model.camera(f"{name}/{CAMERA}").bodyid]
    geoms[is_mount & (away * np.linalg.norm(rays, axis=1) <= _NEAREST_M)] = -1
    return geoms, away


class _Part(NamedTuple):
    """A part of an area.

    Attributes:
        center: Where to look, of shape (3,), m.
        points: What of it no image has shown yet, of shape (n, 3), m.
        is_rest: Whether it is what an arm hid of another part, which is looked at once.
    """

    center: Vector
    points: Matrix
    is_rest: bool = False


class Coverage:
    """Parts of a level area that no image has shown yet.

    Args:
        centers: Centers of the parts in the world, each of shape (3,), m.
        extents: Extents of each part along x and y, m.
    """

    def __init__(self, centers: Sequence[Vector], extents: tuple[float, float]) -> None:
        shares = (np.arange(_SAMPLES) + 0.5) / _SAMPLES - 0.5
        x, y = np.meshgrid(extents[0] * shares, extents[1] * shares)
        offsets = np.column_stack((x.ravel(), y.ravel(), np.zeros(x.size)))
        self._left = [_Part(center, center + offsets) for center in centers]
        self._chosen: _Part | None = None

    def take(self, frame: Frame, room: float, hidden: Mask | None = None) -> None:
        """Leave out what an image shows.

        What an arm hides in the middle of the part that was chosen becomes a part of its own.

        Args:
            frame: The image.
            room: Distance of a point from the border of the image, and from what hides others, at
                which an object there would be shown on whole, m.
            hidden: Where an arm hides what is behind, as `hidden_by_arms`.
        """
        left = []
        for part in self._left:
            is_seen, is_hidden = self._shown(frame, room, hidden, part.points)
            rest = part.points[~is_seen | is_hidden]
            if len(rest):
                left.append(part._replace(points=rest))
        chosen = self._chosen
        self._chosen = None
        if chosen is not None and not chosen.is_rest:
            is_seen, is_hidden = self._shown(frame, room, hidden, chosen.points)
            rest = chosen.points[is_seen & is_hidden]
            if len(rest):
                left.append(_Part(rest.mean(axis=0), rest, is_rest=True))
        self._left = left

    @staticmethod
    def _shown(frame: Frame, room: float, hidden: Mask | None, points: Matrix) -> tuple[Mask, Mask]:
        """Which points are in the image with room around them, and which an arm may hide."""
        half = np.array((frame.width, frame.height)) / 2.0
        inside = frame.pose.inverse.apply(points)
        scale = (frame.focal_px / inside[:, 2].clip(1e-6))[:, None]
        pixels = inside[:, :2] * scale
        margin = room * scale
        is_seen = np.all(np.abs(pixels) + margin <= half, axis=1) & (inside[:, 2] > 0.0)
        is_hidden = np.zeros(len(points), np.bool_)
        if hidden is not None:
            cells = np.array(hidden.shape[::-1]) / (2.0 * half)
            first = np.floor((pixels - margin + half) * cells).astype(int)
            last = np.floor((pixels + margin + half) * cells).astype(int)
            for index in np.flatnonzero(is_seen):
                (left, top), (right, bottom) = first[index], last[index]
                is_hidden[index] = hidden[top : bottom + 1, left : right + 1].any()
        return is_seen, is_hidden

    def nearest(self, camera: Pose) -> Vector | None:
        """Center of the part nearest to a camera's line of sight, which is not chosen again.

        None if everything was seen or chosen.
        """
        if not self._left:
            return None
        ahead = camera.rotation_matrix[:, 2]
        beside = [
            float(np.linalg.norm(np.cross(ahead, part.center - camera.position)))
            for part in self._left
        ]
        self._chosen = self._left.pop(int(np.argmin(beside)))
        return self._chosen.center


class MarkViews:
    """Views of a still mark of a color by an arm's wrist camera.

    Args:
        arm: Arm with a wrist camera.
        color: Color of the mark.

    Raises:
        Failure: ``NO_CAMERA``.
    """

    def __init__(self, arm: Arm, color: Color) -> None:
        self._arm = arm
        self._camera = own_camera(arm)
        self._color = ColorFilter(color)

    def look(self) -> Generator[None, None, MarkView | None]:
        """View the mark from the current pose; None if it is not fully in view.

        Yields once per tick.
        """
        began = self._arm.time
        found = list[tuple[Frame, Detection]]()

        def take(frame: Frame) -> None:
            seen = detect(frame, self._color) if frame.stamp >= began else None
            if seen is not None and not seen.touches_border:
                found.append((frame, seen))

        unsubscribe = self._camera.subscribe(take)
        try:
            latest = began + FRAMES * self._camera.period + self._camera.latency + _WAIT_S
            while len(found) < FRAMES and self._arm.time < latest:
                yield
        finally:
            unsubscribe()
        if not found:
            return None
        frame = found[-1][0]
        pixel = np.mean([seen.centroid_px for _, seen in found], axis=0)
        middle = np.array((frame.width, frame.height)) / 2.0
        return MarkView(frame.pose, pixel - middle, frame.focal_px)


_MOST: Final = 3.0
"""Ratio of sizes beyond which an object is assumed to stand on something undeclared: its size is
unknown then."""

_STACK_SIGMAS: Final = 2.0
"""Standard deviations of height that are allowed if the object may be on an equal one."""

_ALONE_SIGMAS: Final = 1.5
"""Standard deviations by which it has to be lower than on an equal one, to stand on none for sure.
The stated deviations are 2.5 times the measured ones (``docs/sight.md``)."""

_UPRIGHT: Final = 0.7
"""Cosine to the vertical above which a cylinder's flat face can bear another object."""


@dataclass(frozen=True)
class Standing:
    """How an object that lies flat stands on its support, by one image.

    In one image a larger object cannot be distinguished from a nearer one: the size follows from
    the assumption that it stands on its support.

    Attributes:
        ratio: Its size as a multiple of the declared one, if it stands on the support.
        sigma: Standard deviation of the ratio.
        layer: Increase of the ratio if an equal object is between it and the support.
        stacks: Whether an equal object can stand on it.
    """

    ratio: float
    sigma: float
    layer: float
    stacks: bool

    @property
    def other_size(self) -> float | None:
        """Ratio of its size to the declared one; None if that may be 1."""
        room = SIZE_SIGMAS * self.sigma
        if (
            self.ratio > 1.0
        ):  # at half the height of an equal object below it, both cases are equally likely
            room = min(room, max(_STACK_SIGMAS * self.sigma, 0.5 * self.layer))
        return self.ratio if abs(self.ratio - 1.0) > max(room, SIZE_ROOM) else None

    @property
    def may_hide_another(self) -> bool:
        """Whether it may stand on an equal object that the image does not show."""
        return self.stacks and 1.0 + self.layer - self.ratio < _ALONE_SIGMAS * self.sigma


def standing_of(
    world: World, seen: SightedObjects, obj: SightedObject, height: float | None
) -> Standing | None:
    """How a detected object stands on its support; None if no support is known.

    An object scaled about the camera looks the same. Its size ratio is therefore the distance of
    the support over that of its lower side at the declared size, both along the line of sight
    through the center of that side. It may also have the declared size and stand on something else.

    Args:
        world: World with the declared objects, which plans use as well.
        seen: Detector that has processed the images.
        obj: One of its objects, which lies flat.
        height: Height of the support in the world, m; by default from the shapes of the world,
            except objects of the color to detect.
    """
    shape = seen.shape
    fit = obj.best
    eye = obj.views[0].camera.position
    half = shape.half_height(fit.scene.rotation)
    line = fit.scene.position - np.array((0.0, 0.0, half)) - eye
    away = float(np.linalg.norm(line))
    downward = float(-line[2])
    if height is None:
        alike = [name for name, one in world.objects.items() if seen.has_color(one.rgba)]
        length = bearing_ahead(world, eye, line / away, alike)
        ratio = length / away if length is not None else math.inf
    else:
        ratio = (float(eye[2]) - height) / downward if downward > 0.0 else math.inf
    if downward <= 0.0 or not 1.0 / _MOST < ratio < _MOST:
        return None
    sigma = math.sqrt(float(fit.covariance[2, 2])) / downward
    axis = abs(float(fit.scene.rotation[2, 2]))
    stacks = shape.kind == "box" or (shape.kind == "cylinder" and axis > _UPRIGHT)
    return Standing(ratio, sigma, 2.0 * half / downward, stacks)
