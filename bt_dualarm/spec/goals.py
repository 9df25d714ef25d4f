"""Types of ports that name what an arm is to do: the check asks whether this arm can."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, TypeAlias

from bt_dualarm.spec.values import Angle, PoseSpec


@dataclass(frozen=True)
class Goal:
    """Metadata of a pose in the world: the arm goes there.

    Attributes:
        carried: Whether an object that the arm holds comes there, and not the tool itself.
    """

    carried: bool = False


@dataclass(frozen=True)
class OfPosture:
    """Metadata of a text port: it names a posture of the robot."""


@dataclass(frozen=True)
class OfJoints:
    """Metadata of a port: one value for each of the arm's joints, or some by the joint's name."""


ToolPose: TypeAlias = Annotated[PoseSpec, Goal()]
"""A pose in the world that the tool is to take; the check warns if it is out of reach."""

CarriedPose: TypeAlias = Annotated[PoseSpec, Goal(carried=True)]
"""A pose in the world that a held object is to take; the check warns if it is out of reach."""

PostureName: TypeAlias = Annotated[str, OfPosture()]
"""A posture of the robot's catalogue page; the check knows which there are."""

JointAngles: TypeAlias = Annotated[tuple[Angle, ...] | dict[str, Angle], OfJoints()]
"""Angles of all joints, base to tip, or some by name; the check knows the robot's joints."""
