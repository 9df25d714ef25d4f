"""Joints between the parts of a compound: doors, drawers, lids, levers and buttons.

A compound with ``joints`` is several bodies. The parts that no joint moves stay under the name of
the object; those of a joint become an object of their own, ``OBJECT.JOINT``, whose frame is that of
the compound when the joint is at 0. `bt_dualarm.spec.document.expanded`
makes them.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Annotated, Final, Literal, TypeAlias

import numpy as np
from pydantic import Field, model_validator

from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.spec.node_types import port
from bt_dualarm.spec.problems import Name, suggestion
from bt_dualarm.spec.values import JointPosition, Point, Value, Vector3, wrong_unit
from bt_dualarm.spec.yaml_reader import Data

JointKind: TypeAlias = Literal["hinge", "slide"]

MOST_JOINTS: Final = 8
"""Largest number of joints of a compound."""

_FARTHEST: Final[Mapping[JointKind, float]] = {"hinge": 720.0, "slide": 10.0}
_UNITS: Final[Mapping[JointKind, str]] = {"hinge": "°", "slide": " m"}


class PartJoint(Value):
    """A joint between parts of a compound, which moves some of them against the others."""

    type: JointKind = port(..., "`hinge` turns about its axis, `slide` moves along it")
    parts: Annotated[tuple[Name, ...], Field(min_length=1, max_length=32)] = port(
        ..., "Names of the parts that it moves"
    )
    axis: Vector3 = port(
        (0.0, 0.0, 1.0), "Its axis in the frame of the object; a hinge turns by the right hand"
    )
    anchor: Point = port(
        (0.0, 0.0, 0.0), "Point on the axis of a hinge, in the frame of the object", unit="m"
    )
    range: tuple[JointPosition, JointPosition] = port(
        ...,
        "Minimum and maximum position, in degrees or meters; at 0 the parts are at their `pose`",
    )
    at: JointPosition | None = port(
        None,
        "Position at the start, in degrees or in meters; by default 0, or the nearest in the range",
    )
    mass: float = port(1.0, "Mass of the parts that it moves", unit="kg", ge=1e-3, le=1000.0)
    damping: float = port(1.0, "Viscous friction, in N m s/rad or in N s/m", ge=0.0, le=1e4)
    friction: float = port(0.5, "Dry friction, in N m or in N", ge=0.0, le=1e4)
    spring: float = port(0.0, "Stiffness of a spring, in N m/rad or in N/m", ge=0.0, le=1e5)
    rest: JointPosition = port(0.0, "Position where the spring is relaxed, in degrees or in meters")
    sensor: bool = port(
        True, "Whether a sensor at the joint measures its position, which all arms then know"
    )

    @model_validator(mode="before")
    @classmethod
    def _has_its_unit(cls, data: Data) -> Data:
        if isinstance(data, dict) and str(data.get("type")) in _FARTHEST:
            for name in ("range", "at", "rest"):
                complaint = wrong_unit(data.get(name), turns=data["type"] == "hinge")
                if complaint:
                    raise ValueError(f"{name}: {complaint}")
        return data

    @model_validator(mode="after")
    def _is_possible(self) -> PartJoint:
        if math.hypot(*self.axis) < 1e-6:
            raise ValueError("axis has no direction: its length is 0")
        low, high = self.range
        unit = _UNITS[self.type]
        if low >= high:
            raise ValueError(f"range goes from {low:g} to {high:g}: give the smaller one first")
        farthest = _FARTHEST[self.type]
        if max(-low, high) > farthest:
            raise ValueError(
                f"range goes to {max(-low, high):g}; a {self.type} has at most {farthest:g}{unit}"
            )
        if self.at is not None and not low <= self.at <= high:
            raise ValueError(f"at: {self.at:g}{unit} is not between {low:g} and {high:g}{unit}")
        if len(set(self.parts)) < len(self.parts):
            raise ValueError("parts has a name twice")
        return self

    @property
    def unit(self) -> str:
        """Unit of positions in a file: ``deg`` or ``m``."""
        return "deg" if self.type == "hinge" else "m"

    @property
    def si_unit(self) -> str:
        """Unit of positions in skills and metrics: ``rad`` or ``m``."""
        return "rad" if self.type == "hinge" else "m"

    def si(self, position: float) -> float:
        """Position as in a file, in degrees or m, in rad or m."""
        return math.radians(position) if self.type == "hinge" else position

    def in_words(self, position: float) -> str:
        """Position in rad or m, as text with the unit of a file."""
        if self.type == "hinge":
            return f"{math.degrees(position):.1f}°"
        return f"{1e3 * position:.1f} mm"

    @property
    def limits(self) -> tuple[float, float]:
        """Minimum and maximum position, rad or m."""
        low, high = self.range
        return self.si(low), self.si(high)

    @property
    def start(self) -> float:
        """Position at the start, rad or m."""
        low, high = self.range
        return self.si(min(max(0.0, low), high) if self.at is None else self.at)

    @property
    def direction(self) -> Vector:
        """Unit vector along the axis in the frame of the object, of shape (3,)."""
        return np.array(self.axis) / math.hypot(*self.axis)

    def displacement(self, position: float) -> Pose:
        """Pose in the object's frame, at a position in rad or m, of what is at the origin at 0."""
        if self.type == "slide":
            return Pose(position * self.direction, np.array((1.0, 0.0, 0.0, 0.0)))
        half = 0.5 * position
        turn = Pose(np.zeros(3), np.array((math.cos(half), *(math.sin(half) * self.direction))))
        anchor = np.array(self.anchor)
        return Pose(anchor - turn.apply(anchor), turn.quaternion)

    def position_of(self, pose: Pose) -> float:
        """Position, rad or m, whose `displacement` is nearest to a pose in the object's frame.

        A hinge is within half a turn of the middle of its range.
        """
        if self.type == "slide":
            return float(self.direction @ pose.position)
        scalar, *vector = pose.quaternion.tolist()
        angle = 2.0 * math.atan2(float(np.dot(vector, self.direction)), scalar)
        middle = 0.5 * sum(self.limits)
        turns = round((middle - angle) / (2.0 * math.pi))
        return angle + 2.0 * math.pi * turns


@dataclass(frozen=True, eq=False)
class Articulation:
    """Joint by which an object hangs on another one.

    Attributes:
        owner: Name of the object with the other parts.
        name: Name of the joint.
        spec: The joint.
    """

    owner: str
    name: str
    spec: PartJoint


def moved_name(owner: str, joint: str) -> str:
    """Returns the name of the object that a joint of another one moves."""
    return f"{owner}.{joint}"


def refuse_joints(joints: Mapping[str, PartJoint], parts: Collection[str]) -> None:
    """Check that joints fit the parts of their compound.

    Args:
        joints: Joints by name.
        parts: Names of all parts.

    Raises:
        ValueError: One of them does not; the message names it.
    """
    movers: dict[str, str] = {}
    for name, joint in joints.items():
        if name in parts:
            raise ValueError(f"joints: '{name}' is the name of a part as well: rename one")
        for part in joint.parts:
            if part not in parts:
                hint = suggestion(part, parts, "part")
                raise ValueError(f"joint '{name}' moves '{part}', which is not a part ({hint})")
            if part in movers:
                raise ValueError(
                    f"'{part}' is moved by two joints, {movers[part]} and {name}: a part moves on "
                    "one joint, against the parts that stay, and joints form no chains"
                )
            movers[part] = name
    if joints and len(movers) == len(parts):
        raise ValueError("joints move all parts: at least one has to stay, such as a frame")
