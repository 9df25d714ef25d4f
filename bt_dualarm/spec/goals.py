"""Types of ports that name what an arm is to do: the check asks whether this arm can."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias

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


@dataclass(frozen=True)
class OfGripper:
    """Metadata of a number that the arm's gripper is asked for: its page has the limits.

    Attributes:
        what: ``"width"``, ``"speed"`` or ``"force"``.
    """

    what: Literal["width", "speed", "force"]


GripWidth: TypeAlias = Annotated[float, OfGripper("width")]
"""An opening between the pads in m; the check knows the gripper's stroke."""

GripSpeed: TypeAlias = Annotated[float, OfGripper("speed")]
"""A speed of the opening in m/s; the check knows what the gripper can do."""

GripForce: TypeAlias = Annotated[float, OfGripper("force")]
"""A force of each pad, or of a cup, in N; likewise."""

ToolPose: TypeAlias = Annotated[PoseSpec, Goal()]
"""A pose in the world that the tool is to take; the check warns if it is out of reach."""

CarriedPose: TypeAlias = Annotated[PoseSpec, Goal(carried=True)]
"""A pose in the world that a held object is to take; the check warns if it is out of reach."""

PostureName: TypeAlias = Annotated[str, OfPosture()]
"""A posture of the robot's catalogue page; the check knows which there are."""

JointAngles: TypeAlias = Annotated[tuple[Angle, ...] | dict[str, Angle], OfJoints()]
"""Angles of all joints, base to tip, or some by name; the check knows the robot's joints."""
