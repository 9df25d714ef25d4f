"""Draw a smooth curve through given points of a plane with the tool."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from bt_dualarm import PathSkill, Plane, PortModel, Speed, drawn_path, port

Coordinate = Annotated[float, Field(ge=-2.0, le=2.0)]


class Draw(PathSkill):
    """Draw a smooth curve through points of a plane with the tool."""

    class Ports(PortModel):
        plane: Plane = port("yz", "plane of the curve")
        points: tuple[tuple[Coordinate, Coordinate], ...] = port(
            ..., "along the plane's axes, in order", unit="m", min_length=3, max_length=500
        )
        start: Literal["around", "from"] = port(
            "around", "around: points are seen from where the tool is; from: it is at the first"
        )
        closed: bool = port(True, "go on from the last point to the first")
        repeats: int = port(1, "how often the whole curve, if it is closed", ge=1, le=100)
        end: Literal["curve", "center"] = port(
            "curve", "curve: the tool ends where that does; center: where points are seen from"
        )
        speed: Speed = PathSkill.SPEED
        tolerance: float = PathSkill.TOLERANCE

    failures = PathSkill.failures | {
        "INVALID_TARGET": "two points in a row are alike, or an open curve is to be repeated",
        "UNREACHABLE": "no configuration of the arm reaches the curve",
    }
    example = "draw: {points: [[0.08, 0.0], [0.0, 0.06], [-0.05, 0.01], [0.02, -0.07]], speed: 0.5}"
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Draw the curve from where the tool is, follow it, measure."""
        ports = self.ports
        path = drawn_path(
            self.arm.commanded_tool_pose,
            ports.plane.axes,
            ports.points,
            mode=ports.start,
            closed=ports.closed,
            repeats=ports.repeats,
        )
        yield from self.along(path, to_center=ports.end == "center")
