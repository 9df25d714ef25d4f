"""A plane for curves and for tracking: two axes to draw along."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np
from pydantic import ConfigDict, model_validator

from bt_dualarm.pose import Vector
from bt_dualarm.spec.ports import port
from bt_dualarm.spec.problems import suggestion
from bt_dualarm.spec.source import Data, Json, with_tuples
from bt_dualarm.spec.values import Value, Vector3

_NAMED_NORMALS: Final[Mapping[str, Vector3]] = {
    "xy": (0.0, 0.0, 1.0),
    "yz": (1.0, 0.0, 0.0),
    "xz": (0.0, -1.0, 0.0),
}


def _notations(schema: Json) -> None:
    """A name instead of the mapping that pydantic knows of."""
    mapping = dict(schema)
    schema.clear()
    schema["description"] = mapping["description"]
    schema["anyOf"] = [{"enum": list(_NAMED_NORMALS)}, mapping]


class Plane(Value):
    """``xy``, ``yz``, ``xz`` of the world, or ``{normal: [x, y, z]}``."""

    model_config = ConfigDict(json_schema_extra=_notations)

    normal: Vector3 = port(..., "Normal in the world, of any length but 0")

    @model_validator(mode="before")
    @classmethod
    def _from_notation(cls, value: Data) -> Data:
        if not isinstance(value, str):
            return with_tuples(value)
        if value not in _NAMED_NORMALS:
            hint = suggestion(value, _NAMED_NORMALS, "plane")
            raise ValueError(f"there is no plane '{value}' ({hint}); or give {{normal: [x, y, z]}}")
        return {"normal": _NAMED_NORMALS[value]}

    @model_validator(mode="after")
    def _has_direction(self) -> Plane:
        if math.hypot(*self.normal) < 1e-6:
            raise ValueError("the normal has no direction: its length is 0")
        return self

    @property
    def axes(self) -> tuple[Vector, Vector]:
        """Unit vectors u, v in the plane with u cross v along the normal, each of shape (3,).

        v points upwards as far as the plane lets it; in a horizontal plane it is the world's y.
        Hence yz has (y, z), xz has (x, z), xy has (x, y).
        """
        normal = np.array(self.normal) / math.hypot(*self.normal)
        up = np.array([0.0, 0.0, 1.0])
        if np.linalg.norm(np.cross(up, normal)) < 1e-6:
            up = np.array([0.0, 1.0, 0.0])
        v = up - (up @ normal) * normal
        v /= np.linalg.norm(v)
        return np.asarray(np.cross(v, normal), float), v
