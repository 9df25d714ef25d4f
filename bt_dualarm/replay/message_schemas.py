"""JSON schemas of the messages of a record: Foxglove's by their specification, and our own.

Those whose names begin with ``foxglove.`` have the fields, types and required ones of
https://docs.foxglove.dev/docs/sdk/schemas; viewers show them by that name.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, TypeAlias

Schema: TypeAlias = dict[str, Any]

_NUMBER: Final[Schema] = {"type": "number"}
_TEXT: Final[Schema] = {"type": "string"}
_WHOLE: Final[Schema] = {"type": "integer", "minimum": 0}
_FLAG: Final[Schema] = {"type": "boolean"}
_ANY: Final[Schema] = {}


def _object(
    fields: Mapping[str, Schema], title: str = "", optional: tuple[str, ...] = ()
) -> Schema:
    """An object with these fields, all but the optional ones required."""
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
    """The JSON schema of a message, of an object with any fields where none is known."""
    return {"title": name, **_object(_FIELDS.get(name, {}))}
