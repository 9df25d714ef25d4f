"""Trace a smooth curve through points of a plane with the tool."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from bt_dualarm import FreeAxes, PathSkill, Plane, PortModel, Speed, drawn_path, port

Coordinate = Annotated[float, Field(ge=-2.0, le=2.0)]


class Draw(PathSkill):
    """Trace a smooth curve through points of a plane with the tool."""

    class Ports(PortModel):
        plane: Plane = port("yz", "plane of the curve")
        points: tuple[tuple[Coordinate, Coordinate], ...] = port(
            ..., "points in order, along the plane's axes", unit="m", min_length=3, max_length=500
        )
        start: Literal["around", "from"] = port(
            "around",
            "around: points are relative to the tool; from: the tool is at the first point",
        )
        closed: bool = port(True, "whether the curve continues from the last point to the first")
        repeats: int = port(1, "number of passes of a closed curve", ge=1, le=100)
        end: Literal["curve", "center"] = port(
            "curve",
            "curve: the tool ends where the curve ends; center: at the origin of the points",
        )
        speed: Speed = PathSkill.SPEED
        tolerance: float = PathSkill.TOLERANCE
        free: FreeAxes | None = PathSkill.FREE

    failures = PathSkill.failures | {
        "INVALID_TARGET": "two successive points are equal, or an open curve is to be repeated",
        "UNREACHABLE": "no configuration of the arm reaches the curve",
    }
    example = "draw: {points: [[0.08, 0.0], [0.0, 0.06], [-0.05, 0.01], [0.02, -0.07]], speed: 0.5}"
    ports: Ports

    @classmethod
    def shift(cls, ports: Ports) -> tuple[float, str] | None:
        """Distance of the end from where the tool was."""
        first = math.hypot(*ports.points[0])
        if ports.start == "around":
            if ports.end == "center":
                return 0.0, ""
            last = first if ports.closed else math.hypot(*ports.points[-1])
            return last, "end: center brings the tool back"
        if ports.end == "center":
            return first, "end: curve brings the tool back along a closed curve"
        apart = 0.0 if ports.closed else math.dist(ports.points[0], ports.points[-1])
        return apart, "closed: true brings the tool back"

    def run(self) -> Iterator[float | None]:
        """Build the path from the current tool pose, follow it, measure the error."""
        ports = self.ports
        path = drawn_path(
            self.arm.commanded_tool_pose,
            ports.plane.axes,
            ports.points,
            mode=ports.start,
            closed=ports.closed,
            repeats=ports.repeats,
        )
        yield from self.along(path, to_center=ports.end == "center", free=ports.free or ())
