"""Places, sizes and colors of the objects of a group, drawn with the seed of the run.

Scattered objects and piles are placed one after the other, where MuJoCo finds no contact with
the scene and everything placed before, with the gap that the file specifies.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.core.errors import RoomError, WorldError
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.sim import composition
from bt_dualarm.sim.arm_models import LinkFactors
from bt_dualarm.sim.object_body import body_of
from bt_dualarm.spec.document import ObjectSpec, TreeFile
from bt_dualarm.spec.many import Group, ManySpec
from bt_dualarm.spec.values import PoseSpec

_TRIES: Final = 200
"""Random places that are tried for each scattered object."""

_STARTS: Final = 20
"""Number of times that a group is placed again: the first objects may leave no room for the
last."""

_LAYERS: Final = 200
"""Heights that are tried for each object of a pile."""

_STACKED_M: Final = 1e-4
"""Distance between the objects of a stack at the start, m: they do not penetrate each other."""

_FAR_M: Final = 500.0
"""Height of what is not placed yet, m."""

_EXACT: Final = LinkFactors(1.0, 1.0, np.zeros(3))


def drawn(file: TreeFile, seed: int) -> TreeFile:
    """The file with a pose, size and color for each object of its groups; has no groups itself.

    Raises:
        RoomError: There is no room for a group.
        WorldError: The objects do not compile to a world.
        CatalogError: The scene cannot be used.
    """
    if not file.groups:
        return file
    objects = dict(file.objects)
    for group in file.groups:
        rng = np.random.default_rng([seed, zlib.crc32(group.entry.encode()), 1])
        for name in group.names:
            objects[name] = _varied(objects[name], group.many, rng)
    for group in file.groups:
        if group.many.grid is not None or group.many.stack is not None:
            own = [objects[name] for name in group.names]
            places = _grid(own, group.many) if group.many.grid else _stack(own)
            for name, place in zip(group.names, places, strict=True):
                objects[name] = _moved(objects[name], place)
    loose = [group for group in file.groups if group.many.pile or group.many.scatter]
    if loose:
        _place(file, seed, objects, loose)
    return file.model_copy(update={"objects": objects, "groups": ()})


def _varied(obj: ObjectSpec, many: ManySpec, rng: np.random.Generator) -> ObjectSpec:
    """An object with a random size and color, if the group has several."""
    changed: dict[str, object] = {}
    if many.sizes is not None:
        low, high = (np.array(size) for size in many.sizes)
        changed["size"] = tuple((low + (high - low) * rng.uniform(size=len(low))).tolist())
    if many.colors is not None:
        changed["color"] = many.colors[int(rng.integers(len(many.colors)))]
    return obj.model_copy(update=changed)


def _moved(obj: ObjectSpec, place: Pose) -> ObjectSpec:
    """An object at a pose in the frame of its declared one."""
    pose = obj.pose.pose @ place
    x, y, z = pose.position.tolist()
    a, b, c, d = pose.quaternion.tolist()
    return obj.model_copy(update={"pose": PoseSpec(xyz=(x, y, z), quat=(a, b, c, d))})


def _grid(objects: list[ObjectSpec], many: ManySpec) -> Iterator[Pose]:
    """Places on a grid around the pose, x first; rows are as far apart as the largest needs."""
    counts = (*(many.grid or ()), 1, 1)[:3]
    spans = np.array([np.ptp(body_of(obj).corners, axis=0) for obj in objects])
    steps: Vector = spans.max(axis=0) + many.gap
    if many.spacing is not None:
        given = many.spacing if len(many.spacing) > 1 else many.spacing * len(many.grid or ())
        steps[: len(given)] = given
    for z in range(counts[2]):
        for y in range(counts[1]):
            for x in range(counts[0]):
                number = np.array((x, y, z)) - 0.5 * (np.array(counts) - 1.0)
                yield Pose.from_rpy(tuple((number * steps).tolist()))


def _stack(objects: list[ObjectSpec]) -> Iterator[Pose]:
    """Places on top of each other, of which the first one is the pose."""
    top: float | None = None
    for obj in objects:
        heights = body_of(obj).corners[:, 2]
        low, high = float(heights.min()), float(heights.max())
        place = 0.0 if top is None else top + _STACKED_M - low
        top = place + high
        yield Pose.from_rpy((0.0, 0.0, place))


class _Room:
    """A world of objects alone, in which places are tried.

    Args:
        file: File whose scene surrounds the objects.
        seed: Seed of the noise of objects that are in place already.
        objects: All objects.
        loose: Names of those that have no place yet.
    """

    def __init__(
        self, file: TreeFile, seed: int, objects: dict[str, ObjectSpec], loose: set[str]
    ) -> None:
        spec = composition.scene_spec(file.world)
        for number, (name, obj) in enumerate(objects.items()):
            if name in loose:
                free = obj.model_copy(update={"fixed": False})
                away = Pose.from_rpy((0.0, 20.0 * number, _FAR_M))
                composition.add_object(spec, name, free, away, _EXACT)
            elif obj.spawned:
                pose = composition.noisy_pose(name, obj, seed)
                composition.add_object(spec, name, obj, pose, _EXACT)
        try:
            self._model = spec.compile()
        except ValueError as error:
            raise WorldError(f"MuJoCo cannot compile the objects: {error}") from error
        self._data = mujoco.MjData(self._model)

    def clear(self, name: str) -> None:
        """Move an object out of the way again."""
        body = int(self._model.body(name).id)
        start = int(self._model.jnt_qposadr[self._model.body_jntadr[body]])
        self._data.qpos[start : start + 7] = self._model.qpos0[start : start + 7]

    def takes(self, name: str, pose: Pose, gap: float) -> bool:
        """Put an object at a pose; returns whether it keeps the gap from everything else."""
        model = self._model
        data = self._data
        body = int(model.body(name).id)
        start = int(model.jnt_qposadr[model.body_jntadr[body]])
        data.qpos[start : start + 7] = (*pose.position, *pose.quaternion)
        own = model.geom_bodyid == body
        model.geom_margin[:] = np.where(own, gap, 0.0)
        model.body_margin[:] = np.where(np.arange(model.nbody) == body, gap, 0.0)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        contact = data.contact
        # What lies on a support keeps no gap from it: only what is beside it counts.
        beside = np.abs(contact.frame.reshape(-1, 3, 3)[:, 0, 2]) < _BENEATH
        near = (contact.dist < gap) & beside | (contact.dist < -_TOUCH_M)
        return not (own[contact.geom].any(axis=1) & near).any()


_BENEATH: Final = 0.9
"""Minimum cosine between the vertical and the normal of a contact with a support."""

_TOUCH_M: Final = 5e-4
"""Penetration that counts as lying on something, m."""


def _place(file: TreeFile, seed: int, objects: dict[str, ObjectSpec], groups: list[Group]) -> None:
    """Set the poses of scattered objects and piles, one after the other."""
    room = _Room(file, seed, objects, {name for group in groups for name in group.names})
    for group in groups:
        rng = np.random.default_rng([seed, zlib.crc32(group.entry.encode()), 2])
        most = 0
        for _ in range(_STARTS):
            found = _one_after_the_other(room, [objects[name] for name in group.names], group, rng)
            if len(found) == len(group.names):
                objects.update(zip(group.names, found, strict=True))
                break
            most = max(most, len(found))
            for name in group.names:
                room.clear(name)
        else:
            wide, deep = group.many.area
            raise RoomError(
                group.entry,
                f"only {most} of {group.many.count} objects found room in {wide:g} m by {deep:g} m "
                f"with a gap of {group.many.gap:g} m",
            )


def _one_after_the_other(
    room: _Room, objects: list[ObjectSpec], group: Group, rng: np.random.Generator
) -> list[ObjectSpec]:
    """Objects of a group at places that are free; fewer if there is no room for the next one."""
    many = group.many
    found: list[ObjectSpec] = []
    for name, obj in zip(group.names, objects, strict=True):
        places = _dropped(obj, many, rng) if many.pile else _scattered(obj, many, rng)
        moved = (_moved(obj, place) for place in places)
        fits = (one for one in moved if room.takes(name, one.pose.pose, many.gap))
        placed = next(fits, None)
        if placed is None:
            break
        found.append(placed)
    return found


def _scattered(obj: ObjectSpec, many: ManySpec, rng: np.random.Generator) -> Iterator[Pose]:
    """Random places within the area, with the whole object inside."""
    corners = body_of(obj).corners
    for _ in range(_TRIES):
        share = rng.uniform(-0.5, 0.5, 2)
        turn = math.radians(float(rng.uniform(-many.yaw, many.yaw)))
        half = np.abs(Pose.from_rpy((0, 0, 0), (0, 0, turn)).apply(corners)[:, :2]).max(axis=0)
        x, y = (share * np.maximum(np.array(many.area) - 2.0 * half, 0.0)).tolist()
        yield Pose.from_rpy((x, y, 0.0), (0.0, 0.0, turn))


def _dropped(obj: ObjectSpec, many: ManySpec, rng: np.random.Generator) -> Iterator[Pose]:
    """A random place within the area at rising heights."""
    x, y = (rng.uniform(-0.5, 0.5, 2) * np.array(many.area)).tolist()
    turn = math.radians(float(rng.uniform(-many.yaw, many.yaw)))
    step = 0.25 * float(np.ptp(body_of(obj).corners[:, 2])) + many.gap
    for layer in range(_LAYERS):
        yield Pose.from_rpy((x, y, layer * step), (0.0, 0.0, turn))
