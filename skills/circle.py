"""Trace a circle with the tool."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Literal

from bt_dualarm import Angle, FreeAxes, PathSkill, Plane, PortModel, Speed, circle_path, port


class Circle(PathSkill):
    """Trace a circle with the tool."""

    class Ports(PortModel):
        plane: Plane = port("yz", "plane of the circle")
        radius: float = port(0.10, "radius", unit="m", ge=0.005, le=2.0)
        start: Literal["around", "from"] = port(
            "around", "around: the tool is at the center at the start; from: it is on the circle"
        )
        waypoints: int = port(20, "number of waypoints per turn", ge=4, le=1000)
        turns: float = port(1.0, "number of turns; less than 1 is an arc", ge=0.01, le=100)
        begin: Angle = port(
            0.0, "angle of the first point, from the plane's first axis", ge=-360, le=360
        )
        direction: Literal["counterclockwise", "clockwise"] = port(
            "counterclockwise", "direction of rotation, viewed against the plane's normal"
        )
        tilt: Angle = port(
            0.0,
            "tilt of the tool toward the center; 0 keeps its orientation",
            ge=-60,
            le=60,
        )
        end: Literal["rim", "center"] = port(
            "rim", "rim: the tool ends on the circle; center: it moves on to the center"
        )
        speed: Speed = PathSkill.SPEED
        tolerance: float = PathSkill.TOLERANCE
        free: FreeAxes | None = PathSkill.FREE

    failures = PathSkill.failures | {
        "UNREACHABLE": "no configuration of the arm reaches the circle",
    }
    example = "circle: {plane: yz, radius: 0.10, turns: 2, speed: 0.5}"
    ports: Ports

    @classmethod
    def shift(cls, ports: Ports) -> tuple[float, str] | None:
        """Distance of the end from where the tool was."""
        if ports.start == "around":
            distance = 0.0 if ports.end == "center" else ports.radius
            return distance, "end: center brings the tool back"
        if ports.end == "center":
            return ports.radius, "end: rim brings the tool back after whole turns"
        chord = 2.0 * ports.radius * abs(math.sin(math.pi * ports.turns))
        return chord, "whole turns bring the tool back"

    def run(self) -> Iterator[float | None]:
        """Build the path from the current tool pose, follow it, measure the error."""
        ports = self.ports
        path = circle_path(
            self.arm.commanded_tool_pose,
            ports.plane.axes,
            ports.radius,
            mode=ports.start,
            waypoints=ports.waypoints,
            turns=ports.turns,
            begin=ports.begin,
            direction=1 if ports.direction == "counterclockwise" else -1,
            tilt=ports.tilt,
        )
        yield from self.along(path, to_center=ports.end == "center", free=ports.free or ())
