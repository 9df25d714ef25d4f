"""Draw a smooth curve through given points of a plane with the tool."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from bt_dualarm import Plane, PortModel, Skill, Speed, drawn_path, follow_curve, port

Coordinate = Annotated[float, Field(ge=-2.0, le=2.0)]


class Draw(Skill):
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
        speed: Speed = port(0.5, "share of the arm's limits of velocity, acceleration and jerk")
        tolerance: float = port(
            0.005, "how far the tool may be from its plan at any time", unit="m", ge=1e-4, le=0.1
        )

    failures = {
        "INVALID_TARGET": "two points in a row are alike, or an open curve is to be repeated",
        "UNREACHABLE": "no configuration of the arm reaches the curve",
        "SINGULAR": "the curve leads through a singularity of the arm; nothing was executed",
        "PATH_BROKEN": "the arm can follow only a part of the curve; nothing was executed",
        "IN_COLLISION": "the arm would touch something on the way",
        "TRACKING_ERROR": "the arm was blocked or left its plan by more than the tolerance",
        "BUSY": "another leaf moves the arm",
    }
    example = "draw: {points: [[0.08, 0.0], [0.0, 0.06], [-0.05, 0.01], [0.02, -0.07]], speed: 0.5}"
    needs = ("toppra",)
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
        self.metrics |= yield from follow_curve(
            self.arm, path, ports.speed, self.record, ports.tolerance
        )
