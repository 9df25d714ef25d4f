"""Export of a record as MCAP: time-stamped messages with JSON schemas, which Foxglove shows.

The scene has the visual meshes of robots and grippers. A record has only the shapes that cameras
see, convex hulls of the links; the meshes are read from the catalog, by the names of robot and
gripper. An arm with its own description file keeps its hulls: a record may be untrusted, and no
path that it names is opened.
"""

from __future__ import annotations

import base64
import json
import math
import struct
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.errors import DualArmError
from bt_dualarm.core.pose import Vector, camera_pose
from bt_dualarm.core.share import write_atomically
from bt_dualarm.replay.record import Facts, GripperState, Moment, Record, ReplayError
from bt_dualarm.replay.timeline import (
    finger_joints,
    gripper_kind,
    gripper_states,
    joints_of,
    recorded_frames,
)
from bt_dualarm.robots.gripper import gripper_names, load_gripper
from bt_dualarm.robots.mjspec import LOOP_GROUPS, TOOL_GEOM, VISUAL_GROUP, add_gripper, robot_spec
from bt_dualarm.robots.robot_description import load_robot, robot_names, with_gripper
from bt_dualarm.sim.frame import focal_length_px
from bt_dualarm.sim.kernel_arrays import Skins
from bt_dualarm.sim.renderers import geom_colors
from bt_dualarm.sim.skins import (
    Surface,
    as_png,
    image_coordinates,
    image_of,
    skins_of,
    surface_of,
)

if TYPE_CHECKING:
    from mcap.writer import Writer


_KINDS: Final = {
    mujoco.mjtGeom.mjGEOM_PLANE: "plane",
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: "ellipsoid",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_BOX: "box",
    mujoco.mjtGeom.mjGEOM_MESH: "mesh",
}


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh.

    Attributes:
        vertices: Vertices of shape (n, 3), m, 32-bit.
        faces: Indices of three vertices each, counterclockwise from outside, of shape (m, 3).
    """

    vertices: npt.NDArray[np.float32]
    faces: npt.NDArray[np.uint32]


@dataclass(frozen=True, eq=False)
class TexturedMesh:
    """Triangles with an image on them.

    Attributes:
        surface: The triangles.
        coordinates: Coordinates of their corners in the image, of shape (n, 3, 2), see
            `image_coordinates`.
        image: The image, as the content of a PNG file.
    """

    surface: Surface
    coordinates: npt.NDArray[np.float64]
    image: bytes


@dataclass(frozen=True, eq=False)
class DrawnShape:
    """One shape of a body.

    Attributes:
        body: Name of the body; ``world`` for static shapes.
        name: Name of the shape, which may be empty.
        kind: ``plane``, ``sphere``, ``capsule``, ``ellipsoid``, ``cylinder``, ``box`` or ``mesh``.
        position: Position in the body, of shape (3,), m.
        quaternion: Orientation in the body (w, x, y, z).
        size: MuJoCo's sizes: half lengths of a box or plane (0: infinite), radius and half length.
        color: Red, green, blue, opacity, from 0 to 1.
        mesh: Triangles of a mesh.
        textured: Its surface with a texture, None for a shape without.
    """

    body: str
    name: str
    kind: str
    position: Vector
    quaternion: Vector
    size: Vector
    color: tuple[float, float, float, float]
    mesh: Mesh | None
    textured: TexturedMesh | None = None


def drawn_shapes(model: mujoco.MjModel, arms: dict[str, Facts]) -> list[DrawnShape]:
    """Shapes of everything visible in a compiled world.

    Args:
        model: The compiled world.
        arms: The record's data of each arm, by name.
    """
    drawn = [*_shapes(model, LOOP_GROUPS)]
    for arm, facts in arms.items():
        gripper = facts.get("gripper")
        locked = tuple(sorted(facts.get("locked", {}).items()))
        real = _real_shapes(str(facts["robot"]), None if gripper is None else str(gripper), locked)
        bodies = {f"{arm}/{shape.body}" for shape in real}
        present = {model.body(body).name for body in range(model.nbody)} & bodies
        drawn = [shape for shape in drawn if not _is_covered(shape, present)]
        drawn += [
            DrawnShape(
                f"{arm}/{shape.body}",
                f"{arm}/{shape.name}",
                shape.kind,
                shape.position,
                shape.quaternion,
                shape.size,
                shape.color,
                shape.mesh,
            )
            for shape in real
            if f"{arm}/{shape.body}" in present
        ]
    return drawn


def _is_covered(shape: DrawnShape, bodies: Collection[str]) -> bool:
    """Whether a visual mesh replaces the hull of a link; tool shapes have no visual mesh."""
    return shape.body in bodies and not shape.name.endswith(f"/{TOOL_GEOM}")


@lru_cache(maxsize=32)
def _real_shapes(
    robot: str, gripper: str | None, locked: tuple[tuple[str, float], ...]
) -> Sequence[DrawnShape]:
    """Visual shapes of a robot and its gripper, without the arm's prefix; none if unknown."""
    if robot not in robot_names() or (gripper is not None and gripper not in gripper_names()):
        return ()
    try:
        mounted = load_robot(robot, locked=dict(locked))
        if gripper is not None:
            mounted = with_gripper(mounted, load_gripper(gripper))
        spec = robot_spec(mounted, visuals=True)
        if gripper is not None:
            add_gripper(spec, mounted, load_gripper(gripper), visuals=True)
        spec.compiler.discardvisual = False
        model = spec.compile()
    except (DualArmError, ValueError, OSError):  # no meshes on this machine: hulls are drawn
        return ()
    return tuple(_shapes(model, (VISUAL_GROUP,)))


def _shapes(model: mujoco.MjModel, groups: Collection[int]) -> Iterator[DrawnShape]:
    colors = geom_colors(model)
    skins = skins_of(model)
    for geom in range(model.ngeom):
        kind = _KINDS.get(mujoco.mjtGeom(int(model.geom_type[geom])))
        material = int(model.geom_matid[geom])
        opacity = float(model.geom_rgba[geom, 3] if material < 0 else model.mat_rgba[material, 3])
        if kind is None or opacity <= 0.0 or model.geom_group[geom] not in groups:
            continue
        red, green, blue = colors[geom].tolist()
        yield DrawnShape(
            str(model.body(int(model.geom_bodyid[geom])).name),
            str(model.geom(geom).name),
            kind,
            model.geom_pos[geom].copy(),
            model.geom_quat[geom].copy(),
            model.geom_size[geom].copy(),
            (red, green, blue, opacity),
            _mesh(model, int(model.geom_dataid[geom])) if kind == "mesh" else None,
            None if skins is None else _textured(model, skins, geom),
        )


def _mesh(model: mujoco.MjModel, mesh: int) -> Mesh:
    first = int(model.mesh_vertadr[mesh])
    count = int(model.mesh_vertnum[mesh])
    start = int(model.mesh_faceadr[mesh])
    faces = int(model.mesh_facenum[mesh])
    return Mesh(
        model.mesh_vert[first : first + count].astype(np.float32),
        model.mesh_face[start : start + faces].astype(np.uint32),
    )


def _textured(model: mujoco.MjModel, skins: Skins, geom: int) -> TexturedMesh | None:
    skin = int(skins.numbers[geom])
    surface = None if skin < 0 else surface_of(model, geom)
    if surface is None:
        return None
    image = as_png(image_of(skins, skin))
    return TexturedMesh(surface, image_coordinates(skins, skin, surface), image)


@dataclass(frozen=True)
class Message:
    """One message.

    Attributes:
        topic: Name of its channel.
        schema: Name of its schema, a key of `message_schemas`.
        time_s: Simulated time in s.
        content: Fields in JSON's types.
    """

    topic: str
    schema: str
    time_s: float
    content: Mapping[str, object]

    @property
    def nanoseconds(self) -> int:
        """Simulated time in ns."""
        return round(1e9 * self.time_s)


def timestamp(time: float) -> dict[str, int]:
    """A time in s as whole seconds and nanoseconds."""
    seconds, nanoseconds = divmod(round(1e9 * time), 10**9)
    return {"sec": seconds, "nsec": nanoseconds}


# Schemas
#
# Schemas whose names begin with ``foxglove.`` have the fields, types and required fields of
# https://docs.foxglove.dev/docs/sdk/schemas; viewers recognize them by name.


Schema: TypeAlias = dict[str, Any]

_NUMBER: Final[Schema] = {"type": "number"}
_TEXT: Final[Schema] = {"type": "string"}
_WHOLE: Final[Schema] = {"type": "integer", "minimum": 0}
_FLAG: Final[Schema] = {"type": "boolean"}
_ANY: Final[Schema] = {}


def _object(
    fields: Mapping[str, Schema], title: str = "", optional: tuple[str, ...] = ()
) -> Schema:
    """Schema of an object with these fields, all required but the optional ones."""
    required = [name for name in fields if name not in optional]
    named = {"title": title} if title else {}
    return {**named, "type": "object", "properties": dict(fields), "required": required}


def _list(items: Schema, count: int | None = None) -> Schema:
    exactly = {} if count is None else {"minItems": count, "maxItems": count}
    return {"type": "array", "items": items, **exactly}


def _or_null(schema: Schema) -> Schema:
    return {**schema, "type": [schema["type"], "null"]}


_NANOSECONDS: Final[Schema] = {"type": "integer", "minimum": 0, "maximum": 999999999}
_TIME: Final = _object({"sec": _WHOLE, "nsec": _NANOSECONDS}, "time")
_POINT: Final = _object({"x": _NUMBER, "y": _NUMBER}, "foxglove.Point2")
_VECTOR: Final = _object(dict.fromkeys("xyz", _NUMBER), "foxglove.Vector3")
_TURN: Final = _object(dict.fromkeys("xyzw", _NUMBER), "foxglove.Quaternion")
_COLOR: Final = _object(dict.fromkeys("rgba", _NUMBER), "foxglove.Color")
_PAIR: Final = _object({"key": _TEXT, "value": _TEXT}, "foxglove.KeyValuePair")

_TRANSFORM: Final = _object(
    {
        "timestamp": _TIME,
        "parent_frame_id": _TEXT,
        "child_frame_id": _TEXT,
        "translation": _VECTOR,
        "rotation": _TURN,
    },
    "foxglove.FrameTransform",
)
_POSE: Final = _object({"position": _VECTOR, "orientation": _TURN}, "foxglove.Pose")
_SIZED: Final[dict[str, Schema]] = {"pose": _POSE, "size": _VECTOR, "color": _COLOR}
_LENGTH_OF_TIME: Final = _object({"sec": {"type": "integer"}, "nsec": _NANOSECONDS}, "duration")
_MODEL: Final = _object(
    {
        "pose": _POSE,
        "scale": _VECTOR,
        "color": _COLOR,
        "override_color": _FLAG,
        "url": _TEXT,
        "media_type": _TEXT,
        "data": {**_TEXT, "contentEncoding": "base64"},
    },
    "foxglove.ModelPrimitive",
)
_TAPERED: Final[dict[str, Schema]] = {**_SIZED, "bottom_scale": _NUMBER, "top_scale": _NUMBER}
_ENTITY: Final = _object(
    {
        "timestamp": _TIME,
        "frame_id": _TEXT,
        "id": _TEXT,
        "lifetime": _LENGTH_OF_TIME,
        "frame_locked": _FLAG,
        "metadata": _list(_PAIR),
        "arrows": _list(_ANY),
        "cubes": _list(_object(_SIZED, "foxglove.CubePrimitive")),
        "spheres": _list(_object(_SIZED, "foxglove.SpherePrimitive")),
        "cylinders": _list(_object(_TAPERED, "foxglove.CylinderPrimitive")),
        "lines": _list(_ANY),
        "triangles": _list(_ANY),
        "texts": _list(_ANY),
        "models": _list(_MODEL),
    },
    "foxglove.SceneEntity",
)
_DELETION: Final = _object(
    {"timestamp": _TIME, "type": {"type": "integer", "enum": [0, 1]}, "id": _TEXT},
    "foxglove.SceneEntityDeletion",
)
_MEASURED: Final = ("position", "velocity", "acceleration", "effort")
_JOINT: Final = _object(
    {"name": _TEXT, **dict.fromkeys(_MEASURED, _NUMBER)}, "foxglove.JointState", _MEASURED
)
_CIRCLE: Final = _object(
    {
        "timestamp": _TIME,
        "position": _POINT,
        "diameter": _NUMBER,
        "thickness": _NUMBER,
        "fill_color": _COLOR,
        "outline_color": _COLOR,
        "metadata": _list(_PAIR),
    },
    "foxglove.CircleAnnotation",
)
_CALIBRATED: Final[dict[str, Schema]] = {
    "timestamp": _TIME,
    "frame_id": _TEXT,
    "width": _WHOLE,
    "height": _WHOLE,
    "distortion_model": _TEXT,
    "D": _list(_NUMBER),
    "K": _list(_NUMBER, 9),
    "R": _list(_NUMBER, 9),
    "P": _list(_NUMBER, 12),
}
_NOTED: Final[dict[str, Schema]] = {"time_s": _NUMBER}
_SEEN: Final[dict[str, Schema]] = {**_NOTED, "stamp": _NUMBER}

_FIELDS: Final[dict[str, dict[str, Schema]]] = {
    "foxglove.FrameTransforms": {"transforms": _list(_TRANSFORM)},
    "foxglove.JointStates": {"timestamp": _TIME, "joints": _list(_JOINT)},
    "foxglove.CompressedImage": {
        "timestamp": _TIME,
        "frame_id": _TEXT,
        "data": {**_TEXT, "contentEncoding": "base64"},
        "format": _TEXT,
    },
    "foxglove.CameraCalibration": _CALIBRATED,
    "foxglove.ImageAnnotations": {
        "circles": _list(_CIRCLE),
        "points": _list(_ANY),
        "texts": _list(_ANY),
    },
    "foxglove.SceneUpdate": {"deletions": _list(_DELETION), "entities": _list(_ENTITY)},
    "foxglove.Log": {
        "timestamp": _TIME,
        "level": {"type": "integer", "enum": [0, 1, 2, 3, 4, 5]},
        "message": _TEXT,
        "name": _TEXT,
        "file": _TEXT,
        "line": _WHOLE,
    },
    "bt_dualarm.StatusChange": {
        **_NOTED,
        "arm": _TEXT,
        "path": _TEXT,
        "kind": _TEXT,
        "old": _TEXT,
        "new": _TEXT,
        "code": _TEXT,
        "reason": _TEXT,
        "metrics": {"type": "object"},
    },
    "bt_dualarm.Ports": {**_NOTED, "leaf": _TEXT, "ports": {"type": "object"}},
    "bt_dualarm.Wrote": {**_NOTED, "leaf": _TEXT, "key": _TEXT, "value": _ANY},
    "bt_dualarm.Waits": {
        **_NOTED,
        "leaf": _TEXT,
        "target": _TEXT,
        "others": _list(_TEXT),
        "since": _NUMBER,
    },
    "bt_dualarm.Fault": {
        **_NOTED,
        "name": _TEXT,
        "fault": _TEXT,
        "sentence": _TEXT,
        "active": _FLAG,
        "leaf": _TEXT,
        "objects": _list(_TEXT),
    },
    "bt_dualarm.Guard": {**_NOTED, "does": _TEXT, "reason": _TEXT},
    "bt_dualarm.Holds": {**_NOTED, "gripped": _list(_TEXT), "welded": _list(_TEXT)},
    "bt_dualarm.Gripper": {
        **_NOTED,
        "takes_by": {"type": "string", "enum": ["fingers", "suction"]},
        "width_m": _NUMBER,
        "speed_m_s": _NUMBER,
        "force_n": _NUMBER,
        "vacuum": _NUMBER,
        "commanded_width_m": _NUMBER,
        "commanded_speed_m_s": _NUMBER,
        "commanded_force_n": _NUMBER,
        "held": _list(_TEXT),
    },
    "bt_dualarm.Frame": {**_SEEN, "region": _list(_WHOLE, 4), "stride": _WHOLE, "crc": _WHOLE},
    "bt_dualarm.Found": {**_SEEN, "asked": _TEXT, "answer": _list(_ANY)},
    "bt_dualarm.Look": {
        **_SEEN,
        "pixel": _or_null(_list(_NUMBER, 2)),
        "area_px": _NUMBER,
        "point": _or_null(_list(_NUMBER, 3)),
        "locked": _FLAG,
    },
}


def schema_of(name: str) -> Schema:
    """The JSON schema of a message; that of an arbitrary object if there is none."""
    return {"title": name, **_object(_FIELDS.get(name, {}))}


# Cameras: images, intrinsics, detections


_LOCKED = (0.1, 0.9, 0.2, 1.0)
_SEEN_COLOR = (1.0, 0.7, 0.0, 1.0)
_CLEAR = (0.0, 0.0, 0.0, 0.0)


def camera_frame(arm: str) -> str:
    """Name of the frame of an arm's camera: x right, y down, z forward."""
    return f"{arm}/camera"


def camera_messages(record: Record) -> Iterator[Message]:
    """``/ARM/camera/image`` if images were recorded, ``…/calibration`` and ``…/found``."""
    for picture in recorded_frames(record):
        content = {
            "timestamp": timestamp(picture.time),
            "frame_id": camera_frame(picture.arm),
            "data": base64.b64encode(picture.whole).decode(),
            "format": "jpeg",
        }
        topic = f"/{picture.arm}/camera/image"
        yield Message(topic, "foxglove.CompressedImage", picture.time, content)
    for arm, facts in record.arms.items():
        if facts.get("camera"):
            yield from _calibrations(record, arm, facts["camera"])
    for note in record.notes:
        if note["kind"] == "look":
            topic = f"/{note['arm']}/camera/found"
            yield Message(topic, "foxglove.ImageAnnotations", note["time_s"], _found(note))


def _calibrations(record: Record, arm: str, camera: Facts) -> Iterator[Message]:
    """Nominal intrinsics, once per second, so that a viewer has them at any time."""
    width, height = camera["resolution"]
    focal = focal_length_px(height, math.radians(camera["fov"]))
    matrix = [focal, 0.0, width / 2.0, 0.0, focal, height / 2.0, 0.0, 0.0, 1.0]
    for second in range(math.ceil(record.until)):
        content = {
            "timestamp": timestamp(second),
            "frame_id": camera_frame(arm),
            "width": width,
            "height": height,
            "distortion_model": "",
            "D": [],
            "K": matrix,
            "R": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            "P": [*matrix[:3], 0.0, *matrix[3:6], 0.0, *matrix[6:], 0.0],
        }
        topic = f"/{arm}/camera/calibration"
        yield Message(topic, "foxglove.CameraCalibration", float(second), content)


def _found(note: Facts) -> Facts:
    """A circle of the area of a detection; none without one."""
    if note["pixel"] is None:
        return {"circles": [], "points": [], "texts": []}
    x, y = note["pixel"]
    circle = {
        "timestamp": timestamp(note["time_s"]),
        "position": {"x": x, "y": y},
        "diameter": 2.0 * math.sqrt(note["area_px"] / math.pi),
        "thickness": 1.0,
        "fill_color": _color(_CLEAR),
        "outline_color": _color(_LOCKED if note["locked"] else _SEEN_COLOR),
        "metadata": [{"key": "locked", "value": str(note["locked"]).lower()}],
    }
    return {"circles": [circle], "points": [], "texts": []}


def _color(rgba: tuple[float, float, float, float]) -> Facts:
    return dict(zip("rgba", rgba, strict=True))


# Scene: shapes of robots, grippers, objects and surroundings
#
# There is one `foxglove.SceneUpdate` for each arm, and one for everything else, whenever that
# changes by spawning or removal. Shapes are in the frames of their bodies, which move by
# ``/bodies``. Each message is complete, so that a viewer that jumps to a time needs only the last.


_FLOOR_M: Final = 10.0
"""Width of the visible part of an infinite plane, m."""

_THIN_M: Final = 1e-3
_ALL: Final = 1  # foxglove.SceneEntityDeletion: everything on the topic
_PRIMITIVES: Final = (
    "arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models",
)  # fmt: skip


def scene_messages(record: Record) -> Iterator[Message]:
    """``/scene/ARM`` and ``/scene/world``."""
    known: dict[str, list[Facts]] = {}
    last = -1
    for index, time in enumerate(record.times.tolist()):
        generation = record.moment(index).generation
        if generation == last:
            continue
        last = generation
        found: dict[str, list[DrawnShape]] = {topic: [] for topic in known}
        for shape in drawn_shapes(record.model(generation), dict(record.arms)):
            arm, slash, _ = shape.body.partition("/")
            topic = arm if slash and arm in record.arms else "world"
            found.setdefault(topic, []).append(shape)
        for topic, shapes in sorted(found.items()):
            entities = [*_entities(shapes)]
            if entities != known.get(topic):
                known[topic] = entities
                stamp = timestamp(time)
                content = {
                    "deletions": [{"timestamp": stamp, "type": _ALL, "id": ""}],
                    "entities": [{"timestamp": stamp, **entity} for entity in entities],
                }
                yield Message(f"/scene/{topic}", "foxglove.SceneUpdate", time, content)


def _entities(shapes: Iterable[DrawnShape]) -> Iterator[Facts]:
    """An entity for each body, without its time stamp."""
    bodies: dict[str, list[DrawnShape]] = {}
    for shape in shapes:
        bodies.setdefault(shape.body, []).append(shape)
    for body, own in bodies.items():
        primitives: dict[str, list[Facts]] = {name: [] for name in _PRIMITIVES}
        for shape in own:
            for name, primitive in _primitives(shape):
                primitives[name].append(primitive)
        yield {
            "frame_id": body,
            "id": body,
            "lifetime": {"sec": 0, "nsec": 0},
            "frame_locked": True,
            "metadata": [],
            **primitives,
        }


def _primitives(shape: DrawnShape) -> Iterator[tuple[str, Facts]]:
    """Primitive of a shape: the name of its list in the entity, and its fields."""
    color = dict(zip("rgba", (round(part, 4) for part in shape.color), strict=True))
    x, y, z = shape.size.tolist()
    pose = _pose(shape.position, shape.quaternion)
    model = shape.textured or shape.mesh
    if model is not None:
        yield (
            "models",
            {
                "pose": pose,
                "scale": _vector(1.0, 1.0, 1.0),
                "color": color,
                "override_color": shape.textured is None,
                "url": "",
                "media_type": "model/gltf-binary",
                "data": _glb_text(model),
            },
        )
    elif shape.kind == "box":
        yield "cubes", {"pose": pose, "size": _vector(2 * x, 2 * y, 2 * z), "color": color}
    elif shape.kind == "plane":
        below = shape.position - _THIN_M / 2 * _axis_z(shape.quaternion)
        size = _vector(2 * x or _FLOOR_M, 2 * y or _FLOOR_M, _THIN_M)
        yield "cubes", {"pose": _pose(below, shape.quaternion), "size": size, "color": color}
    elif shape.kind in ("sphere", "ellipsoid"):
        axes = (x, x, x) if shape.kind == "sphere" else (x, y, z)
        size = _vector(*(2 * axis for axis in axes))
        yield "spheres", {"pose": pose, "size": size, "color": color}
    elif shape.kind in ("cylinder", "capsule"):
        yield (
            "cylinders",
            {
                "pose": pose,
                "size": _vector(2 * x, 2 * x, 2 * y),
                "bottom_scale": 1.0,
                "top_scale": 1.0,
                "color": color,
            },
        )
        if shape.kind == "capsule":
            for side in (-y, y):
                end = shape.position + side * _axis_z(shape.quaternion)
                size = _vector(2 * x, 2 * x, 2 * x)
                yield (
                    "spheres",
                    {"pose": _pose(end, shape.quaternion), "size": size, "color": color},
                )


@lru_cache(maxsize=512)
def _glb_text(mesh: Mesh | TexturedMesh) -> str:
    content = glb(mesh) if isinstance(mesh, Mesh) else textured_glb(mesh)
    return base64.b64encode(content).decode("ascii")


_FLOATS: Final = 5126
_INTEGERS: Final = 5125
_VERTICES: Final = 34962
_INDICES: Final = 34963
"""Numbers of glTF for types of components and for uses of buffers."""


def glb(mesh: Mesh) -> bytes:
    """A mesh in binary glTF 2.0, by its specification."""
    vertices = _y_up(mesh.vertices)
    indices = np.ascontiguousarray(mesh.faces, "<u4").tobytes()
    views = [(vertices.tobytes(), _VERTICES), (indices, _INDICES)]
    accessors = [
        _places(vertices),
        {"bufferView": 1, "componentType": _INTEGERS, "count": mesh.faces.size, "type": "SCALAR"},
    ]
    return _glb({"attributes": {"POSITION": 0}, "indices": 1}, accessors, views, {})


def textured_glb(mesh: TexturedMesh) -> bytes:
    """Triangles with an image on them in binary glTF 2.0, by its specification."""
    vertices = _y_up(mesh.surface.points.reshape(-1, 3))
    normals = _y_up(mesh.surface.normals.reshape(-1, 3))
    coordinates = np.ascontiguousarray(mesh.coordinates.reshape(-1, 2), "<f4")
    views = [(one.tobytes(), _VERTICES) for one in (vertices, normals, coordinates)]
    accessors = [
        _places(vertices),
        {"bufferView": 1, "componentType": _FLOATS, "count": len(normals), "type": "VEC3"},
        {"bufferView": 2, "componentType": _FLOATS, "count": len(normals), "type": "VEC2"},
    ]
    nearest, repeats = 9728, 10497
    color = {"baseColorTexture": {"index": 0}, "metallicFactor": 0.0, "roughnessFactor": 1.0}
    material = {
        "materials": [{"pbrMetallicRoughness": color}],
        "textures": [{"sampler": 0, "source": 0}],
        "samplers": [
            {"magFilter": nearest, "minFilter": nearest, "wrapS": repeats, "wrapT": repeats}
        ],
        "images": [{"bufferView": 3, "mimeType": "image/png"}],
    }
    attributes = {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2}
    primitive = {"attributes": attributes, "material": 0}
    return _glb(primitive, accessors, [*views, (mesh.image, None)], material)


def _y_up(vectors: npt.NDArray[np.floating]) -> npt.NDArray[np.float32]:
    """Vectors, of shape (n, 3), for glTF.

    Its y axis points up, here z does: viewers rotate meshes by 90° about x, which is compensated in
    the vertices.
    """
    x, y, z = vectors.T
    return np.ascontiguousarray(np.stack((x, z, -y), axis=1), "<f4")


def _places(vertices: npt.NDArray[np.float32]) -> Facts:
    """Accessor of vertices in the first buffer view."""
    return {
        "bufferView": 0,
        "componentType": _FLOATS,
        "count": len(vertices),
        "type": "VEC3",
        "min": vertices.min(axis=0).tolist(),
        "max": vertices.max(axis=0).tolist(),
    }


def _glb(
    primitive: Facts,
    accessors: Sequence[Facts],
    views: Sequence[tuple[bytes, int | None]],
    material: Facts,
) -> bytes:
    """A file with one mesh.

    Args:
        primitive: The mesh's primitive.
        accessors: Its accessors.
        views: Content of each buffer view, and what it is used for, None for an image.
        material: Fields of the document for the material.
    """
    binary = b""
    described: list[Facts] = []
    for content, target in views:
        use = {} if target is None else {"target": target}
        described.append(
            {"buffer": 0, "byteOffset": len(binary), "byteLength": len(content), **use}
        )
        binary += content + bytes(-len(content) % 4)
    document = {
        "asset": {"version": "2.0", "generator": "bt_dualarm"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": [*accessors],
        "bufferViews": described,
        "buffers": [{"byteLength": len(binary)}],
        **material,
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = b"".join(
        struct.pack("<I4s", len(part), kind) + part
        for kind, part in ((b"JSON", text), (b"BIN\0", binary))
    )
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _axis_z(quaternion: Vector) -> Vector:
    w, x, y, z = quaternion
    axis: Vector = np.array((2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)))
    return axis


def _pose(position: Vector, quaternion: Vector) -> Facts:
    w, x, y, z = quaternion.round(6).tolist()
    orientation = {"x": x, "y": y, "z": z, "w": w}
    return {"position": _vector(*position.tolist()), "orientation": orientation}


def _vector(x: float, y: float, z: float) -> Facts:
    return {"x": round(x, 6), "y": round(y, 6), "z": round(z, 6)}


_EVERY: Final = 2
"""Interval of messages with body poses, in recorded states: 25 messages per second."""

# levels of foxglove.Log
_INFO = 2
_ERROR = 4


def messages_of(record: Record) -> list[Message]:
    """All messages of a record, in chronological order.

    ``/status`` has status changes, ``/log`` the same as text. ``/ARM/ports``, ``/ARM/wrote``,
    ``/ARM/frame``, ``/ARM/look``, ``/ARM/found``, ``/ARM/holds`` and ``/ARM/guard`` are notes.
    ``/ARM/joints`` has measured joint positions, those of fingers too, and commanded torques;
    ``/ARM/set_point`` the set-points, in rad, s and N m (m and N for fingers); ``/ARM/gripper``
    state, command and held objects of a gripper; ``/bodies`` the poses of all bodies and cameras in
    the world, in m; ``/scene/…`` their shapes (`scene_messages`); ``/ARM/camera/…`` see
    `camera_messages`.
    """
    found = [
        *_statuses(record),
        *_notes(record),
        *_joints(record),
        *_grippers(record),
        *_bodies(record),
        *scene_messages(record),
        *camera_messages(record),
    ]
    return sorted(found, key=lambda message: message.time_s)


def _statuses(record: Record) -> Iterator[Message]:
    for event in record.events:
        time = float(event["time_s"])
        yield Message("/status", "bt_dualarm.StatusChange", time, event)
        message = ": ".join(filter(None, (event["new"], event["code"], event["reason"])))
        content = {
            "timestamp": timestamp(time),
            "level": _ERROR if event["new"] == "FAILURE" else _INFO,
            "message": message,
            "name": f"{event['arm']}:{event['path']}",
            "file": "",
            "line": 0,
        }
        yield Message("/log", "foxglove.Log", time, content)


def _notes(record: Record) -> Iterator[Message]:
    for note in record.notes:
        kind = note["kind"]
        arm = note["arm"] or "world"  # a fault of an object belongs to no arm
        content = {name: value for name, value in note.items() if name not in ("kind", "arm")}
        schema = f"bt_dualarm.{str(kind).capitalize()}"
        yield Message(f"/{arm}/{kind}", schema, float(note["time_s"]), content)


def _joints(record: Record) -> Iterator[Message]:
    """Measured states and set-points, with the model's names, as `foxglove.JointStates`."""
    for arm in record.arms:
        for index, time in enumerate(record.times.tolist()):
            row = record.arm_row(arm, index)
            if row is None:
                continue
            q, v, a, torque = ([float(f"{x:.7g}") for x in part] for part in row)
            moment = record.moment(index)
            model = record.model(moment.generation)
            joints = joints_of(model, arm, len(q))
            now = _measured(model, moment, joints, torque)
            sent = [
                {"name": joint["name"], "position": q[j], "velocity": v[j], "acceleration": a[j]}
                for j, joint in enumerate(now)
            ]
            fingers = finger_joints(model, arm)
            gripper = record.gripper(arm, index)  # records of earlier versions have only the state
            grip = None if gripper is None else _rounded(gripper)
            now += _measured(
                model, moment, fingers, [grip["force_n"]] * len(fingers) if grip else None
            )
            if grip is not None:
                asked = grip["commanded_width_m"] / 2, grip["commanded_force_n"]
                sent += [
                    {"name": str(model.joint(joint).name), "position": asked[0], "effort": asked[1]}
                    for joint in fingers
                ]
            for topic, joints_now in ((f"/{arm}/joints", now), (f"/{arm}/set_point", sent)):
                content = {"timestamp": timestamp(time), "joints": joints_now}
                yield Message(topic, "foxglove.JointStates", time, content)


def _measured(
    model: mujoco.MjModel, moment: Moment, joints: Sequence[int], efforts: Sequence[float] | None
) -> list[Facts]:
    """Name, position, velocity and, if known, effort, as `foxglove.JointState`."""
    at = model.jnt_qposadr[joints]
    to = model.jnt_dofadr[joints]
    where = moment.qpos[at].round(9).tolist()
    how = moment.qvel[to].round(9).tolist()
    found: list[Facts] = [
        {"name": str(model.joint(joint).name), "position": q, "velocity": v}
        for joint, q, v in zip(joints, where, how, strict=True)
    ]
    if efforts is not None:
        found = [{**joint, "effort": effort} for joint, effort in zip(found, efforts, strict=True)]
    return found


def _grippers(record: Record) -> Iterator[Message]:
    """State and command of each gripper, and the objects that it was assumed to hold."""
    for arm in record.arms:
        for index, state, held in gripper_states(record, arm):
            time = float(record.times[index])
            kind = gripper_kind(record.model(record.moment(index).generation), arm)
            content = {"time_s": time, "takes_by": kind, **_rounded(state), "held": [*held]}
            yield Message(f"/{arm}/gripper", "bt_dualarm.Gripper", time, content)


def _rounded(state: GripperState) -> dict[str, float]:
    """Values of a gripper by name and unit, in the precision of the record."""
    named = {
        "width_m": state.width,
        "speed_m_s": state.speed,
        "force_n": state.force,
        "vacuum": state.vacuum,
        "commanded_width_m": state.commanded_width,
        "commanded_speed_m_s": state.commanded_speed,
        "commanded_force_n": state.commanded_force,
    }
    return {name: float(f"{value:.7g}") for name, value in named.items()}


def _bodies(record: Record) -> Iterator[Message]:
    model = None
    data = None
    for index in range(0, len(record.times), _EVERY):
        moment = record.moment(index)
        if model is not record.model(moment.generation) or data is None:
            model = record.model(moment.generation)
            data = mujoco.MjData(model)
        data.qpos[:] = moment.qpos
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)
        poses = [
            (str(model.body(body).name), data.xpos[body], data.xquat[body])
            for body in range(1, model.nbody)
        ]
        for arm in record.arms:
            camera = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, camera_frame(arm))
            if camera >= 0:
                pose = camera_pose(data, camera)
                poses.append((camera_frame(arm), pose.position, pose.quaternion))
        transforms = [_transform(name, place, turn, moment.time) for name, place, turn in poses]
        content: Facts = {"transforms": transforms}
        yield Message("/bodies", "foxglove.FrameTransforms", moment.time, content)


def _transform(name: str, position: Vector, quaternion: Vector, time: float) -> Facts:
    x, y, z = position.round(6).tolist()
    w, i, j, k = quaternion.round(6).tolist()
    return {
        "timestamp": timestamp(time),
        "parent_frame_id": "world",
        "child_frame_id": name,
        "translation": {"x": x, "y": y, "z": z},
        "rotation": {"x": i, "y": j, "z": k, "w": w},
    }


def write_mcap(messages: Sequence[Message], path: Path) -> None:
    """Write messages in chronological order; the file appears only when it is complete.

    Args:
        messages: The messages.
        path: File to write.

    Raises:
        ReplayError: The package mcap is not installed.
        OSError: The file cannot be written.
    """
    try:
        from mcap.writer import Writer
    except ImportError as error:
        raise ReplayError("--mcap needs the package mcap (the extra bt_dualarm[export])") from error

    def write(file: object) -> None:
        writer = Writer(file)  # type: ignore[arg-type]  # a binary file
        writer.start(library=f"bt_dualarm {version('bt_dualarm')}")
        _add(writer, messages)
        writer.finish()  # type: ignore[no-untyped-call]  # the package leaves it so

    write_atomically(path, write)


def _add(writer: Writer, messages: Sequence[Message]) -> None:
    schemas: dict[str, int] = {}
    channels: dict[str, int] = {}
    for number, message in enumerate(messages):
        name = message.schema
        if name not in schemas:
            schema = json.dumps(schema_of(name)).encode()
            schemas[name] = writer.register_schema(name, "jsonschema", schema)
        if message.topic not in channels:
            channels[message.topic] = writer.register_channel(message.topic, "json", schemas[name])
        text = json.dumps(message.content, allow_nan=False, separators=(",", ":"))
        time = message.nanoseconds
        writer.add_message(channels[message.topic], time, text.encode(), time, number)
