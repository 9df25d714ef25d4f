"""Data for pages on the state of a world: poses, contacts, signals, planned motion, meshes."""

from __future__ import annotations

import base64
import hashlib
import struct
from array import array
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import Any, Final, TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.control.controller import JointController
from bt_dualarm.core.errors import DualArmError
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.robots.gripper import FINGERS, Gripper, load_gripper
from bt_dualarm.robots.mjspec import (
    COLLISION_GROUP,
    CUP,
    LOOP_GROUPS,
    PAD,
    TOOL_GEOM,
    TOOL_SITE,
    VISUAL_GROUP,
    add_gripper,
    joint_motors,
    robot_spec,
)
from bt_dualarm.robots.robot import Robot
from bt_dualarm.robots.robot_description import load_robot, with_gripper
from bt_dualarm.runtime.arm_runtime import Arms, IdleObserver
from bt_dualarm.runtime.clock import Periodic, exact
from bt_dualarm.sim.composition import CAMERA
from bt_dualarm.sim.kernel_arrays import Skins
from bt_dualarm.sim.skins import as_png, image_of, skins_of
from bt_dualarm.sim.world import World
from bt_dualarm.spec.yaml_reader import Json
from bt_dualarm.trajectory.set_points import TrajectorySource

Ids = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ModelIndices:
    """Indices of one arm in a compiled model.

    Attributes:
        name: Name of the arm.
        qpos: Addresses of its joints' positions, base to tip, of shape (dof,).
        motors: Ids of its joints' motors, in the same order, without a gripper's drive.
        tool: Id of the site at its tool.
        camera: Id of its camera, -1 without one.
        fingers: Addresses of its fingers' positions, of shape (2,), or (0,) without fingers.
        pads: Ids of the gripping geoms: of two fingers, of a cup, or none.
    """

    name: str
    qpos: Ids
    motors: Ids
    tool: int
    camera: int
    fingers: Ids
    pads: tuple[int, ...]

    def torque_share(self, model: mujoco.MjModel, torque: Vector) -> float:
        """Largest ratio of torques, of shape (dof,), N m, to the limits of their motors."""
        return float((np.abs(torque) / model.actuator_ctrlrange[self.motors, 1]).max())

    def opening(self, qpos: Vector) -> float:
        """Opening of its fingers in m; NaN without fingers."""
        return float(qpos[self.fingers].sum()) if len(self.fingers) else np.nan

    def held(self, model: mujoco.MjModel, data: mujoco.MjData) -> list[str]:
        """Names of bodies that all of its pads touch or that are welded to it, sorted."""
        found: set[int] = set()
        if self.pads:
            pairs = data.contact.geom[data.contact.dist <= 0.0]
            ordered = np.vstack((pairs, pairs[:, ::-1])).reshape(-1, 2)
            touched = [
                set(model.geom_bodyid[ordered[ordered[:, 0] == pad, 1]].tolist())
                for pad in self.pads
            ]
            found = set.intersection(*touched) - {0}
        for weld in np.flatnonzero((model.eq_type == mujoco.mjtEq.mjEQ_WELD) & data.eq_active):
            pair = (int(model.eq_obj1id[weld]), int(model.eq_obj2id[weld]))
            own = [model.body(body).name.startswith(f"{self.name}/") for body in pair]
            if own[0] != own[1]:
                found.add(pair[own.index(False)])
        return sorted(model.body(body).name for body in found)


def model_indices(model: mujoco.MjModel, arms: Iterable[str]) -> dict[str, ModelIndices]:
    """Indices of the given arms that are in a model, by name."""
    return {found.name: found for arm in arms for found in _indices_of_arm(model, arm)}


def _indices_of_arm(model: mujoco.MjModel, arm: str) -> Iterator[ModelIndices]:
    tool = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, f"{arm}/{TOOL_SITE}")
    if tool < 0:
        return
    motors = joint_motors(model, arm)
    joints = model.actuator_trnid[motors, 0]
    camera = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, f"{arm}/{CAMERA}")
    slides = _ids(model, mujoco.mjtObj.mjOBJ_JOINT, [f"{arm}/{finger}" for finger in FINGERS])
    holds = [f"{arm}/{body}/{PAD}" for body in (*FINGERS, CUP)]
    yield ModelIndices(
        arm,
        model.jnt_qposadr[joints].astype(np.int64),
        motors,
        tool,
        camera,
        model.jnt_qposadr[slides].astype(np.int64),
        tuple(_ids(model, mujoco.mjtObj.mjOBJ_GEOM, holds)),
    )


def _ids(model: mujoco.MjModel, kind: mujoco.mjtObj, names: Iterable[str]) -> list[int]:
    """Ids of the named elements that are in the model."""
    found = (mujoco.mj_name2id(model, kind, name) for name in names)
    return [number for number in found if number >= 0]


MOST_CONTACTS: Final = 60
_LEAST_FORCE_N: Final = 0.05
"""Smallest contact force shown, N; smaller ones are noise of the solver."""


def bodies(data: mujoco.MjData) -> str:
    """Positions (m) and quaternions of all bodies, seven 32-bit floats each, as base64."""
    return as_text(np.hstack((data.xpos, data.xquat)))


def contacts(model: mujoco.MjModel, data: mujoco.MjData) -> list[Json]:
    """Contacts: point in m, force on the second body in N, names of both bodies.

    Args:
        model: The model.
        data: Its state, whose forces are those of its contacts.
    """
    found = []
    force = np.zeros(6)
    for number in range(min(data.ncon, 4 * MOST_CONTACTS)):
        contact = data.contact[number]
        if contact.efc_address < 0:
            continue
        mujoco.mj_contactForce(model, data, number, force)
        in_world = force[:3] @ contact.frame.reshape(3, 3)
        if float(np.linalg.norm(in_world)) < _LEAST_FORCE_N:
            continue
        between = [_owner(model, int(geom)) for geom in contact.geom]
        point = contact.pos.round(4).tolist()
        newton = in_world.round(2).tolist()
        found.append({"point": point, "force": newton, "between": between})
    strongest = sorted(found, key=lambda each: -float(np.linalg.norm(each["force"])))
    return strongest[:MOST_CONTACTS]


def cameras(
    model: mujoco.MjModel, data: mujoco.MjData, arms: Mapping[str, ModelIndices]
) -> list[Json]:
    """The arms' cameras: position in m, axes (right, up, backward), tangents of half angles."""
    found: list[Json] = []
    for name, arm in arms.items():
        if arm.camera >= 0:
            width, height = model.cam_resolution[arm.camera].tolist()
            up = float(np.tan(np.radians(model.cam_fovy[arm.camera]) / 2.0))
            found.append(
                {
                    "arm": name,
                    "eye": data.cam_xpos[arm.camera].round(4).tolist(),
                    "axes": data.cam_xmat[arm.camera].round(4).tolist(),
                    "half": [round(up * width / height, 4), round(up, 4)],
                    "size": [width, height],
                }
            )
    return found


def arm_numbers(row: Sequence[float]) -> Json:
    """Tool position in m, joint error in degrees and torque share of a sample of `row_of`."""
    tool = row[1:4]
    error = row[4]
    share = row[5]
    return {
        "tool": [round(x, 4) for x in tool],
        "error_deg": round(error, 4),
        "torque": round(share, 4),
    }


def gripper(
    model: mujoco.MjModel, data: mujoco.MjData, arm: ModelIndices, name: str, force: float
) -> Json:
    """State of a gripper: its name, opening in m, force in N, and the objects actually held.

    Opening and force are None if the gripper has none or it is unknown.
    """
    opening = arm.opening(data.qpos)
    return {
        "name": name,
        "opening_m": round(opening, 5) if np.isfinite(opening) else None,
        "force_n": round(force, 2) if np.isfinite(force) else None,
        "holds": arm.held(model, data),
    }


def as_text(array: npt.NDArray[np.floating]) -> str:
    """The array as 32-bit floats in base64."""
    return base64.b64encode(np.ascontiguousarray(array, np.float32).tobytes()).decode("ascii")


def _owner(model: mujoco.MjModel, geom: int) -> str:
    """Name of a geom's body, or of the geom itself if it is fixed to the world."""
    body = int(model.geom_bodyid[geom])
    name = model.body(body).name if body else model.geom(geom).name
    return str(name or "the scene")


_POINTS: Final = 60


class MotionAhead:
    """Remaining tool path of an arm's current motion; the whole path is computed once per motion.

    Args:
        model: The compiled world; not modified.
        arm: The arm in it.
    """

    def __init__(self, model: mujoco.MjModel, arm: ModelIndices) -> None:
        self._model = model
        self._arm = arm
        self._scratch: mujoco.MjData | None = None
        self._of: TrajectorySource | None = None
        self._times: Vector = np.empty(0)
        self._points: Matrix = np.empty((0, 3))

    def of(self, controller: JointController, data: mujoco.MjData) -> str:
        """Points of the remaining tool path in m, three 32-bit floats each, as base64.

        Empty while the arm holds its position, or follows a stream, whose future is unknown.
        """
        motion = controller.motion if isinstance(controller, JointController) else None
        if not isinstance(motion, TrajectorySource):
            self._of = None
            return ""
        if motion is not self._of:
            self._of = motion
            self._times = np.linspace(0.0, motion.trajectory.duration, _POINTS)
            self._points = self._traced(motion, data)
        remaining = self._points[self._times >= motion.parameter.s]
        return as_text(np.vstack((data.site_xpos[self._arm.tool], remaining)))

    def _traced(self, motion: TrajectorySource, data: mujoco.MjData) -> Matrix:
        if self._scratch is None:
            self._scratch = mujoco.MjData(self._model)
        scratch = self._scratch
        points = np.empty((_POINTS, 3))
        scratch.qpos[:] = data.qpos
        for number, s in enumerate(self._times.tolist()):
            scratch.qpos[self._arm.qpos] = motion.configuration(s)
            mujoco.mj_kinematics(self._model, scratch)
            points[number] = scratch.site_xpos[self._arm.tool]
        return points


PERIOD: Final = Fraction(1, 25)
"""Simulated seconds between two samples."""

MOST_ROWS: Final = 6000
"""Largest number of samples kept per arm: four minutes at 25 Hz; longer runs are thinned."""

COLUMNS: Final = (
    "time", "x", "y", "z", "error_deg", "torque_share", "opening_m", "force_n", "life"
)  # fmt: skip
"""Columns of a sample: simulated time in s, tool position in m, largest deviation of a joint from
its set-point, largest share of a motor's torque limit, opening of the fingers, and force of a pad
or cup, NaN if the arm has none; and which stay of the arm in the world it is, from 1: between two
of them the tool did not move from one place to the other."""

Row = tuple[float, ...]


def row_of(
    model: mujoco.MjModel, data: mujoco.MjData, arm: ModelIndices, setpoint: Vector, torque: Vector
) -> Row:
    """A sample without the gripper's force and the stay, which the state does not contain.

    Args:
        model: The compiled world.
        data: Its data, with current kinematics.
        arm: The arm in it.
        setpoint: Positions of the set-point, of shape (dof,), rad.
        torque: Commanded torques, of shape (dof,), N m.
    """
    error = float(np.degrees(np.abs(setpoint - data.qpos[arm.qpos]).max()))
    share = arm.torque_share(model, torque)
    tool = data.site_xpos[arm.tool].tolist()
    return (float(data.time), *tool, error, share, arm.opening(data.qpos))


def series_text(arms: Mapping[str, Vector]) -> Json:
    """Samples of arms, each of shape (n, 9), JSON-ready: 32-bit floats as base64."""
    return {"columns": COLUMNS, "arms": {name: as_text(rows) for name, rows in arms.items()}}


class Signals(IdleObserver):
    """Observer that samples all arms in simulated time, independent of page requests.

    Args:
        world: The world.
        arms: Arms of the run.
    """

    def __init__(self, world: World, arms: Arms) -> None:
        self._world = world
        self._arms = arms
        self._due = Periodic(PERIOD, exact(world.timestep))
        self._steps = 0
        self._seen = 0
        self._stride = 1
        self._generation = -1
        self._indices: dict[str, ModelIndices] = {}
        self._rows: dict[str, array[float]] = {}
        self._lock = Lock()

    def after_step(self, time: float) -> None:  # noqa: ARG002 - the world knows it, too
        """Take a sample if one is due."""
        due = self._due.due(self._steps)
        self._steps += 1
        if due:
            if self._seen % self._stride == 0:
                self._sample()
            self._seen += 1

    def since(self, time: float) -> Json:
        """Samples after a time in s, JSON-ready."""
        with self._lock:
            kept = {name: np.array(rows) for name, rows in self._rows.items()}
        tables = {name: rows.reshape(-1, len(COLUMNS)) for name, rows in kept.items()}
        return series_text({name: rows[rows[:, 0] > time + 1e-4] for name, rows in tables.items()})

    def _sample(self) -> None:
        world = self._world
        if world.generation != self._generation:
            self._indices = model_indices(world.model, world.arms)
            self._generation = world.generation
        for present in self._arms.present:
            arm = self._indices.get(present.name)
            if arm is not None:
                data = world.data
                setpoint = present.controller.setpoint.q
                row = row_of(world.model, data, arm, setpoint, data.ctrl[arm.motors])
                gripper = world.grippers.get(present.name)
                with self._lock:
                    rows = self._rows.setdefault(present.name, array("f"))
                    force = np.nan if gripper is None else gripper.force
                    rows.extend((*row, force, self._arms.lives_of(present.name)))
        if any(len(rows) > MOST_ROWS * len(COLUMNS) for rows in self._rows.values()):
            self._stride *= 2
            with self._lock:
                self._rows = {name: _thinned(rows) for name, rows in self._rows.items()}


def _thinned(rows: array[float]) -> array[float]:
    return array("f", np.array(rows).reshape(-1, len(COLUMNS))[::2].ravel())


Mounted: TypeAlias = tuple[Robot, Gripper | None]
"""A robot with its gripper mounted, and that gripper if it has one."""

_MESH_HEADER: Final = struct.Struct("<II6f")
_GRID_STEPS: Final = 65535
_SMALL: Final = 1 << 16
_FLOOR_M: Final = 4.0
_FLOOR_COLOR: Final = [0.72, 0.75, 0.78, 1.0]

_Geom = mujoco.mjtGeom


@dataclass(frozen=True)
class VisualMeshes:
    """Shapes and meshes of one compiled world, for drawing by a page.

    Attributes:
        shapes: Shapes with name, body, pose on the body, scale and color, JSON-ready.
        meshes: Content of each mesh among them by name, see `packed`. The name is a digest of the
            content, so that equal meshes are sent once.
        textures: Images of the shapes' textures by name, as ``data:`` URLs.
    """

    shapes: tuple[Json, ...]
    meshes: Mapping[str, bytes]
    textures: Mapping[str, str] = field(default_factory=dict)

    def scene(self, generation: int) -> Json:
        """The answer to a page that asks for the shapes of a generation."""
        return {
            "generation": generation,
            "shapes": [*self.shapes],
            "meshes": [*self.meshes],
            "textures": dict(self.textures),
        }


def packed(model: mujoco.MjModel, mesh: int) -> bytes:
    """A mesh in a compact binary format, a fifth of its size in memory.

    Numbers of vertices and triangles, two 32-bit integers; lowest corner and size of the bounding
    box in m, six floats; per vertex three 16-bit fractions of the box (an error of at most 8 µm for
    a link of 1 m); per triangle the indices of its vertices, 16-bit if that suffices, else 32-bit;
    per vertex the normal, three 8-bit integers.
    """
    first = int(model.mesh_vertadr[mesh])
    count = int(model.mesh_vertnum[mesh])
    normal = int(model.mesh_normaladr[mesh])
    normals = int(model.mesh_normalnum[mesh])
    face = int(model.mesh_faceadr[mesh])
    faces = int(model.mesh_facenum[mesh])
    corners = model.mesh_face[face : face + faces].astype(np.int64).ravel()
    facing = model.mesh_facenormal[face : face + faces].astype(np.int64).ravel()
    # The page needs one normal per vertex: split MuJoCo's vertices that have several.
    pairs, numbers = np.unique(corners * max(normals, 1) + facing, return_inverse=True)
    points = model.mesh_vert[first : first + count][pairs // max(normals, 1)].astype(float)
    directions = model.mesh_normal[normal : normal + normals][pairs % max(normals, 1)]
    low = points.min(axis=0)
    size = np.maximum(points.max(axis=0) - low, 1e-9)
    parts = (
        (_GRID_STEPS * (points - low) / size).round().astype("<u2"),
        numbers.astype("<u2" if len(points) <= _SMALL else "<u4"),
        (127 * directions).round().astype("i1"),
    )
    head = _MESH_HEADER.pack(len(points), faces, *low.tolist(), *size.tolist())
    return head + b"".join(part.tobytes() for part in parts)


def visual_meshes(model: mujoco.MjModel, arms: Mapping[str, Mounted]) -> VisualMeshes:
    """Shapes and meshes for drawing a world.

    Args:
        model: The compiled world.
        arms: Arms drawn with their visual meshes, by name; others are drawn with the hulls that
            cameras see.
    """
    visuals: list[Json] = []
    meshes: dict[str, bytes] = {}
    for arm, (robot, gripper) in arms.items():
        visual = _visuals_of_arm(robot, gripper)
        for shape in visual.shapes:
            body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, f"{arm}/{shape['body']}")
            if body >= 0:
                visuals.append({**shape, "body": body})
        meshes |= visual.meshes
    with_visuals = {int(shape["body"]) for shape in visuals}
    geoms = [
        geom
        for geom in range(model.ngeom)
        if model.geom_group[geom] in LOOP_GROUPS and not _is_hull(model, geom, with_visuals)
    ]
    shapes, hulls = _shapes_of(model, geoms)
    kept = (*shapes, *visuals)
    used = {str(shape["name"]) for shape in kept}
    meshes |= hulls
    used_meshes = {name: mesh for name, mesh in meshes.items() if name in used}
    return VisualMeshes(kept, used_meshes, _textures_of(model))


def arm_of(facts: Json, root: Path) -> Mounted | None:
    """Robot and gripper of an arm, loaded by the names in a record.

    None if one is not available any more, or does not match any more.
    """
    try:
        robot = load_robot(str(facts["robot"]), root, facts.get("locked"))
        if facts.get("gripper") is None:
            return robot, None
        gripper = load_gripper(str(facts["gripper"]), root)
        return with_gripper(robot, gripper), gripper
    except (DualArmError, OSError, KeyError):
        return None


def _is_hull(model: mujoco.MjModel, geom: int, with_visuals: Collection[int]) -> bool:
    """Whether a geom is the hull of a link drawn with its visual meshes; not a tool geom."""
    return (
        int(model.geom_group[geom]) == COLLISION_GROUP
        and int(model.geom_bodyid[geom]) in with_visuals
        and not model.geom(geom).name.endswith(f"/{TOOL_GEOM}")
    )


@lru_cache(maxsize=16)
def _visuals_of_arm(robot: Robot, gripper: Gripper | None) -> VisualMeshes:
    """Visual shapes of an arm, each with the name of its link as the body."""
    try:
        spec = robot_spec(robot, visuals=True)
        if gripper is not None:
            add_gripper(spec, robot, gripper, visuals=True)
        spec.compiler.discardvisual = False
        model = spec.compile()
    except (DualArmError, ValueError, OSError):
        return VisualMeshes((), {})
    geoms = [geom for geom in range(model.ngeom) if model.geom_group[geom] == VISUAL_GROUP]
    shapes, meshes = _shapes_of(model, geoms)
    named = [{**shape, "body": model.body(int(shape["body"])).name} for shape in shapes]
    return VisualMeshes(tuple(named), meshes)


def _shapes_of(
    model: mujoco.MjModel, geoms: Collection[int]
) -> tuple[tuple[Json, ...], Mapping[str, bytes]]:
    """Geoms as shapes that a page can draw, and the meshes among them by name."""
    meshes: dict[str, bytes] = {}
    names: dict[int, str] = {}
    skins = skins_of(model)
    shapes = []
    for geom in geoms:
        if model.geom_type[geom] == _Geom.mjGEOM_MESH:
            mesh = int(model.geom_dataid[geom])
            if mesh not in names:
                content = packed(model, mesh)
                names[mesh] = hashlib.sha256(content).hexdigest()[:20]
                meshes[names[mesh]] = content
            parts = [(names[mesh], [1.0, 1.0, 1.0], 0.0)]
        else:
            parts = [*_parts(int(model.geom_type[geom]), model.geom_size[geom].tolist())]
        for name, scale, lift in parts:
            turned = np.zeros(3)
            mujoco.mju_rotVecQuat(turned, np.array((0.0, 0.0, lift)), model.geom_quat[geom])
            shape: dict[str, Any] = {
                "name": name,
                "body": int(model.geom_bodyid[geom]),
                "position": (model.geom_pos[geom] + turned).round(6).tolist(),
                "quaternion": model.geom_quat[geom].round(6).tolist(),
                "scale": scale,
                "color": _color(model, geom),
            }
            if skins is not None and skins.numbers[geom] >= 0:
                mean = image_of(skins, int(skins.numbers[geom])).mean(axis=(0, 1)) / 255.0
                shape["color"] = [*mean.round(3).tolist(), shape["color"][3]]
                shape["texture"] = _texture(model, skins, geom, scale, lift)
            shapes.append(shape)
    return tuple(shapes), meshes


def _texture(
    model: mujoco.MjModel, skins: Skins, geom: int, scale: list[float], lift: float
) -> Json:
    """How a page draws the texture of a part of a geom.

    Matrices are columns first: ``place`` from the part before it is scaled, whose center is
    ``lift`` above that of the geom, to the texture's frame; ``facing`` likewise for normals.
    """
    skin = int(skins.numbers[geom])
    turn = skins.turns[skin]
    place = np.eye(4)
    place[:3, :3] = turn * scale
    place[:3, 3] = turn @ (0.0, 0.0, lift) + skins.shifts[skin]
    return {
        "image": _texture_name(model, geom),
        "tiles": skins.tiles[skin].round(6).tolist(),
        "place": place.T.round(7).ravel().tolist(),
        "facing": (turn / scale).T.round(6).ravel().tolist(),
    }


def _texture_name(model: mujoco.MjModel, geom: int) -> str:
    texture = model.mat_texid[model.geom_matid[geom], mujoco.mjtTextureRole.mjTEXROLE_RGB]
    return str(model.texture(int(texture)).name)


def _textures_of(model: mujoco.MjModel) -> Mapping[str, str]:
    """Images of the textures of a model by name, as ``data:`` URLs."""
    skins = skins_of(model)
    if skins is None:
        return {}
    found = {}
    for geom in np.flatnonzero(skins.numbers >= 0).tolist():
        name = _texture_name(model, geom)
        if name not in found:
            content = as_png(image_of(skins, int(skins.numbers[geom])))
            found[name] = "data:image/png;base64," + base64.b64encode(content).decode("ascii")
    return found


def _parts(kind: int, size: list[float]) -> Iterator[tuple[str, list[float], float]]:
    """Yields the shape name, scale and z offset in m of each part of a geom."""
    if kind == _Geom.mjGEOM_BOX:
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


def _color(model: mujoco.MjModel, geom: int) -> list[float]:
    if model.geom_type[geom] == _Geom.mjGEOM_PLANE:
        return _FLOOR_COLOR
    material = int(model.geom_matid[geom])
    rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    color: list[float] = rgba.round(3).tolist()
    return color
