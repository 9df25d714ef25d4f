"""The scene of a record as messages: shapes of robots, grippers, objects and what stands around.

One message of `foxglove.SceneUpdate` for each arm, and one for all else, whenever that changes: as
things are spawned and removed. Shapes are in the frames of their bodies, which move by ``/bodies``.
Each message has all of its topic, so that a viewer that jumps to a time needs the last one alone.
"""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import Final

import numpy as np

from bt_dualarm.pose import Vector
from bt_dualarm.replay.drawn_shapes import DrawnShape, Mesh, drawn_shapes
from bt_dualarm.replay.message import Message, timestamp
from bt_dualarm.replay.record import Facts, Record

_FLOOR_M: Final = 10.0
"""Width that is drawn of a ground without end."""

_THIN_M: Final = 1e-3
_ALL: Final = 1  # of foxglove.SceneEntityDeletion: everything of the topic
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
    """What a shape is drawn by: the name of the list that it belongs to, and its fields."""
    color = dict(zip("rgba", (round(part, 4) for part in shape.color), strict=True))
    x, y, z = shape.size.tolist()
    pose = _pose(shape.position, shape.quaternion)
    if shape.kind == "mesh" and shape.mesh is not None:
        yield (
            "models",
            {
                "pose": pose,
                "scale": _vector(1.0, 1.0, 1.0),
                "color": color,
                "override_color": True,
                "url": "",
                "media_type": "model/gltf-binary",
                "data": _glb_text(shape.mesh),
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
def _glb_text(mesh: Mesh) -> str:
    return base64.b64encode(glb(mesh)).decode("ascii")


def glb(mesh: Mesh) -> bytes:
    """A mesh in binary glTF 2.0, by its specification.

    glTF's y axis points up, where ours is z: viewers turn it back by 90° about x.
    """
    x, y, z = mesh.vertices.T
    vertices = np.ascontiguousarray(np.stack((x, z, -y), axis=1), "<f4")
    places, indices = vertices.tobytes(), np.ascontiguousarray(mesh.faces, "<u4").tobytes()
    document = {
        "asset": {"version": "2.0", "generator": "bt_dualarm"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": 5126,  # 32-bit floats
                "count": len(vertices),
                "type": "VEC3",
                "min": vertices.min(axis=0).tolist(),
                "max": vertices.max(axis=0).tolist(),
            },
            {"bufferView": 1, "componentType": 5125, "count": mesh.faces.size, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": len(places), "target": 34962},
            {"buffer": 0, "byteOffset": len(places), "byteLength": len(indices), "target": 34963},
        ],
        "buffers": [{"byteLength": len(places) + len(indices)}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = b"".join(
        struct.pack("<I4s", len(part), kind) + part
        for kind, part in ((b"JSON", text), (b"BIN\0", places + indices))
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
