"""Limits that a tree file sets for a whole motion: the port ``keep``."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field, model_validator

from bt_dualarm.core.pose import Vector
from bt_dualarm.spec.node_types import PortModel, port
from bt_dualarm.spec.relative_pose import PointPose
from bt_dualarm.spec.values import Direction, Tilt

AxisName: TypeAlias = Literal["+x", "-x", "+y", "-y", "+z", "-z"]

_Height: TypeAlias = Annotated[float, Field(ge=-100.0, le=100.0)]


class Facing(PortModel):
    """An axis that points in a direction, or to a point, during a whole motion."""

    exactly_one_of = ("toward", "direction")

    toward: PointPose | None = port(None, "Point to which it points; its orientation is not used")
    direction: Direction | None = port(
        None, "Direction in the world in which it points, of any nonzero length"
    )
    axis: AxisName = port("+z", "Axis of the tool or of the carried object")
    within: Tilt = port(10.0, "Largest angle from there")

    @property
    def unit_axis(self) -> Vector:
        """The axis in the frame of the tool or the object, of shape (3,)."""
        sign = -1.0 if self.axis[0] == "-" else 1.0
        return np.asarray(sign * np.eye(3)["xyz".index(self.axis[1])], float)


class Keep(PortModel):
    """Limits that hold along a whole motion: of the tool, or of the object that is carried."""

    upright: Tilt | None = port(
        None,
        "Largest tilt: of an object the angle of its z axis from the vertical, of the tool that of "
        "its direction that pointed up at the start",
    )
    height: tuple[_Height, _Height] | None = port(
        None, "Lowest and highest position of its center in the world", unit="m"
    )
    facing: Facing | None = port(None, "Where an axis of it points")

    @model_validator(mode="after")
    def _limits_something(self) -> Keep:
        if self.upright is None and self.height is None and self.facing is None:
            raise ValueError("give at least one of: upright, height, facing")
        if self.height is not None and self.height[1] - self.height[0] < 1e-3:
            low, high = self.height
            raise ValueError(
                f"the height goes from {low:g} to {high:g}: give the lower limit first, and at "
                "least 1 mm between the two"
            )
        return self
