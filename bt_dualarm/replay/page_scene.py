"""The scene of a record for a page: shapes once, poses of all bodies over time."""

from __future__ import annotations

import base64
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import Final

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.replay.record import Facts, Record
from bt_dualarm.world.robots.geom_groups import LOOP_GROUPS
from bt_dualarm.world.robots.mjspec import TOOL_SITE

MOST_FRAMES: Final = 1500
"""Poses of a scene that a page has at most: a minute at 25 Hz; of longer runs fewer a second."""

_EVERY: Final = 2
"""States from one pose to the next: 25 a second."""

_FLOOR_M: Final = 4.0
_COLORS: Final = ((0.9, 0.65, 0.0, 1.0), (0.1, 0.35, 0.9, 1.0), (0.8, 0.1, 0.5, 1.0))

_Geom = mujoco.mjtGeom


@dataclass
class PageScene:
    """Everything that is drawn, ready for JSON.

    Attributes:
        meshes: Vertices and faces of each mesh, by name.
        generations: Shapes of each model, in the order of their generations.
        segments: Times and poses of frames of one generation.
        trails: Ways of the tools.
        middle: Point that one looks at, of shape (3,), m.
    """

    meshes: dict[str, Facts] = field(default_factory=dict)
    generations: list[Facts] = field(default_factory=list)
    segments: list[Facts] = field(default_factory=list)
    trails: list[Facts] = field(default_factory=list)
    middle: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.5])

    @classmethod
    def of(cls, record: Record) -> PageScene:
        """The scene of a record."""
        scene = cls()
        places = {number: place for place, number in enumerate(sorted(record.models))}
        for number in places:
            model = record.model(number)
            scene.generations.append({"bodies": model.nbody, "shapes": [*scene._shapes(model)]})
        trails: dict[str, list[tuple[float, list[float]]]] = {}
        for number, indices in _runs(record):
            scene.segments.append(_segment(record, number, places[number], indices, trails))
        scene.trails = [
            {
                "name": name,
                "color": _COLORS[place % len(_COLORS)],
                "times": [time for time, _ in points],
                "points": _text(np.array([point for _, point in points], np.float32)),
            }
            for place, (name, points) in enumerate(trails.items())
        ]
        seen = [point for points in trails.values() for _, point in points]
        if seen:
            scene.middle = np.mean(seen, axis=0).round(3).tolist()
        return scene

    def _shapes(
        self, model: mujoco.MjModel, groups: Collection[int] = LOOP_GROUPS
    ) -> Iterator[Facts]:
        for geom in range(model.ngeom):
            if model.geom_group[geom] in groups:
                for name, scale, lift in self._parts(model, geom):
                    yield {
                        "name": name,
                        "geom": geom,
                        "body": int(model.geom_bodyid[geom]),
                        "position": _lifted(model, geom, lift),
                        "quaternion": model.geom_quat[geom].round(6).tolist(),
                        "scale": scale,
                        "color": _color(model, geom),
                    }

    def _parts(self, model: mujoco.MjModel, geom: int) -> Iterator[tuple[str, list[float], float]]:
        """Name of a shape, its scale and how far along z it lies, in m, for each part of a geom."""
        kind, size = model.geom_type[geom], model.geom_size[geom].tolist()
        if kind == _Geom.mjGEOM_MESH:
            yield self._mesh(model, int(model.geom_dataid[geom])), [1.0, 1.0, 1.0], 0.0
        elif kind == _Geom.mjGEOM_BOX:
            yield "box", size, 0.0
        elif kind == _Geom.mjGEOM_SPHERE:
            yield "sphere", [size[0]] * 3, 0.0
        elif kind == _Geom.mjGEOM_ELLIPSOID:
            yield "sphere", size, 0.0
        elif kind == _Geom.mjGEOM_CYLINDER:
            yield "cylinder", [size[0], size[0], size[1]], 0.0
        elif kind == _Geom.mjGEOM_CAPSULE:
            yield "tube", [size[0], size[0], size[1]], 0.0
            yield "sphere", [size[0]] * 3, size[1]
            yield "sphere", [size[0]] * 3, -size[1]
        elif kind == _Geom.mjGEOM_PLANE:
            yield "plane", [size[0] or _FLOOR_M, size[1] or _FLOOR_M, 1.0], 0.0

    def _mesh(self, model: mujoco.MjModel, mesh: int) -> str:
        name = str(model.mesh(mesh).name)
        if name not in self.meshes:
            first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
            faces = model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]
            vertices = model.mesh_vert[first : first + count]
            self.meshes[name] = {
                "vertices": _text(vertices.astype(np.float32)),
                "faces": _text(faces.astype(np.uint32)),
            }
        return name


def shapes_of(
    model: mujoco.MjModel, groups: Collection[int] = LOOP_GROUPS
) -> tuple[list[Facts], dict[str, Facts]]:
    """Shapes of a model in some groups, and the meshes among them by name, ready for JSON."""
    scene = PageScene()
    return [*scene._shapes(model, groups)], scene.meshes


def _lifted(model: mujoco.MjModel, geom: int, lift: float) -> list[float]:
    turned = np.zeros(3)
    mujoco.mju_rotVecQuat(turned, np.array((0.0, 0.0, lift)), model.geom_quat[geom])
    place: list[float] = (model.geom_pos[geom] + turned).round(6).tolist()
    return place


def _color(model: mujoco.MjModel, geom: int) -> list[float]:
    material = int(model.geom_matid[geom])
    rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    if model.geom_type[geom] == _Geom.mjGEOM_PLANE:
        return [0.72, 0.75, 0.78, 1.0]
    color: list[float] = rgba.round(3).tolist()
    return color


def _runs(record: Record) -> Iterator[tuple[int, list[int]]]:
    """Generation and numbers of the states that are drawn, in stretches of one generation."""
    count = len(record.times)
    every = max(_EVERY, -(-count // MOST_FRAMES))
    chosen = sorted({*range(0, count, every), *([count - 1] if count else [])})
    together: list[int] = []
    of = -1
    for index in chosen:
        generation = record.moment(index).generation
        if generation != of and together:
            yield of, together
            together = []
        of = generation
        together.append(index)
    if together:
        yield of, together


def _segment(
    record: Record,
    generation: int,
    place: int,
    indices: list[int],
    trails: dict[str, list[tuple[float, list[float]]]],
) -> Facts:
    """Times and poses of some states; where the tools were is added to their trails."""
    model = record.model(generation)
    data = mujoco.MjData(model)
    sites = {
        arm: mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, f"{arm}/{TOOL_SITE}")
        for arm in record.arms
    }
    poses, times = [], []
    for index in indices:
        moment = record.moment(index)
        data.qpos[:] = moment.qpos
        mujoco.mj_kinematics(model, data)
        poses.append(np.hstack((data.xpos, data.xquat)).astype(np.float32))
        times.append(round(moment.time, 4))
        for arm, site in sites.items():
            if site >= 0:
                trails.setdefault(arm, []).append((times[-1], data.site_xpos[site].tolist()))
    return {"generation": place, "times": times, "poses": _text(np.array(poses))}


def _text(array: npt.NDArray[np.generic]) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode("ascii")
