"""Values with a notation of their own in YAML: poses, durations, angles, colours, planes, names.

YAML speaks metres, seconds and degrees; what comes out of these types is SI, angles in radians.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, TypeAlias

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    Field,
    PlainSerializer,
    model_validator,
)

from bt_dualarm.pose import Pose, Vector
from bt_dualarm.spec.ports import STRICT, port
from bt_dualarm.spec.source import Data
from bt_dualarm.spec.unit import DEGREES, QUANTITY, SECONDS, Unit

_Component: TypeAlias = Annotated[float, Field(ge=-1000.0, le=1000.0)]
Vector3: TypeAlias = tuple[_Component, _Component, _Component]
"""Three numbers; the field that uses it gives frame and unit."""

_Coordinate: TypeAlias = Annotated[float, Field(ge=-100.0, le=100.0)]
_Turn: TypeAlias = Annotated[float, Field(ge=-720.0, le=720.0)]
_Point: TypeAlias = tuple[_Coordinate, _Coordinate, _Coordinate]


@dataclass(frozen=True)
class Refers:
    """Metadata of a text port: it names something that the tree file declares.

    Attributes:
        to: ``"object"``, ``"arm"`` or both.
    """

    to: tuple[str, ...]


ObjectName: TypeAlias = Annotated[str, Refers(("object",))]
"""The name of an object of the tree file."""

ArmName: TypeAlias = Annotated[str, Refers(("arm",))]
"""The name of an arm of the tree file."""

ObjectOrArmName: TypeAlias = Annotated[str, Refers(("object", "arm"))]
"""The name of an object or an arm of the tree file."""


def _quantity(value: Data, units: Mapping[str, float]) -> Data:
    """A number as it is, text such as ``"500 ms"`` in the base unit."""
    if not isinstance(value, str):
        return value
    match = QUANTITY.fullmatch(value)
    if match is None or match[2] not in units:
        choices = ", ".join(units)
        raise ValueError(f"expected a number, or text with a unit ({choices}), not '{value}'")
    return float(match[1]) * units[match[2]]


def _seconds(value: Data) -> Data:
    return _quantity(value, SECONDS)


def _degrees(value: Data) -> Data:
    return _quantity(value, DEGREES)


Duration: TypeAlias = Annotated[
    float, BeforeValidator(_seconds), Field(ge=0.0, le=86400.0), Unit("s", SECONDS)
]
"""Seconds of simulated time, a day at most: ``0.5``, or text with a unit: ``"500 ms"``."""

Angle: TypeAlias = Annotated[
    float,
    BeforeValidator(_degrees),
    Field(ge=-3600.0, le=3600.0),
    AfterValidator(math.radians),
    PlainSerializer(math.degrees),
    Unit("deg", DEGREES),
]
"""Radians inside; in YAML degrees, ten turns at most: ``90``, or text: ``"1.57 rad"``."""

Speed: TypeAlias = Annotated[float, Field(ge=0.001, le=1.0)]
"""Share of the arm's limits of velocity, acceleration and jerk; 1.0 is the arm's maximum."""


class Value(BaseModel):
    """Base of value types: frozen, and strict about what YAML says."""

    model_config = STRICT


class PoseSpec(Value):
    """Where a frame is: a position, and at most one notation of its orientation."""

    xyz: _Point = port(..., "Position", unit="m")
    rpy: tuple[_Turn, _Turn, _Turn] | None = port(
        None, "Roll, pitch, yaw about the fixed axes x, y, z in that order", unit="deg"
    )
    quat: tuple[float, float, float, float] | None = port(
        None, "Quaternion w, x, y, z of unit length"
    )
    look_at: _Point | None = port(
        None, "A point that the frame's z axis points to; its y axis points downwards", unit="m"
    )

    @model_validator(mode="after")
    def _one_orientation(self) -> PoseSpec:
        notations = (name for name in type(self).model_fields if name != "xyz")
        given = [name for name in notations if getattr(self, name) is not None]
        if len(given) > 1:
            raise ValueError(f"gives its orientation twice: {' and '.join(given)}")
        if self.quat is not None and abs(math.hypot(*self.quat) - 1.0) > 1e-3:
            length = math.hypot(*self.quat)
            raise ValueError(f"quat has length {length:.4g}; a rotation has length 1")
        if self.look_at is not None and math.dist(self.look_at, self.xyz) < 1e-6:
            raise ValueError("look_at is the position itself: no direction follows from it")
        return self

    @property
    def pose(self) -> Pose:
        """The transform; without an orientation, that of the frame it is given in."""
        if self.quat is not None:
            quaternion = np.array(self.quat) / math.hypot(*self.quat)
            return Pose(np.array(self.xyz), quaternion)
        if self.look_at is not None:
            return _looking(np.array(self.xyz), np.array(self.look_at))
        roll, pitch, yaw = np.radians(self.rpy or (0.0, 0.0, 0.0))
        return Pose.from_rpy(self.xyz, (roll, pitch, yaw))

    def pose_from(self, current: Pose) -> Pose:
        """The transform; without an orientation, it is turned as ``current``."""
        if self.rpy is None and self.quat is None and self.look_at is None:
            return Pose(np.array(self.xyz), current.quaternion)
        return self.pose


def _looking(eye: Vector, target: Vector) -> Pose:
    """Z forward, x right, y down, as cameras have it; right is world x when looking up or down."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    if np.linalg.norm(right) < 1e-6:
        right = np.array([1.0, 0.0, 0.0])
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = np.column_stack((right, np.cross(forward, right), forward))
    matrix[:3, 3] = eye
    return Pose.from_matrix(matrix)
