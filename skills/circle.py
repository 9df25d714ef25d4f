"""Trace a circle with the tool."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from bt_dualarm import Angle, Plane, PortModel, Skill, Speed, circle_path, follow_curve, port


class Circle(Skill):
    """Trace a circle with the tool."""

    class Ports(PortModel):
        plane: Plane = port("yz", "plane of the circle")
        radius: float = port(0.10, "radius", unit="m", ge=0.005, le=2.0)
        start: Literal["around", "from"] = port(
            "around", "around: the tool is at the centre now; from: it is on the circle now"
        )
        waypoints: int = port(20, "points on a turn that the path goes through", ge=4, le=1000)
        turns: float = port(1.0, "how often around; less than 1 is an arc", gt=0, le=100)
        begin: Angle = port(
            0.0, "angle of the first point, from the plane's first axis", ge=-360, le=360
        )
        direction: Literal["counterclockwise", "clockwise"] = port(
            "counterclockwise", "as seen against the plane's normal"
        )
        tilt: Angle = port(
            0.0, "how far the tool leans towards the middle; 0 keeps its orientation", ge=-60, le=60
        )
        speed: Speed = port(0.5, "share of the arm's limits of velocity, acceleration and jerk")
        tolerance: float = port(
            0.005, "how far the tool may be from its plan at any time", unit="m", ge=1e-4, le=0.1
        )

    failures = {
        "UNREACHABLE": "no configuration of the arm reaches the circle",
        "SINGULAR": "the circle leads through a singularity of the arm; nothing was executed",
        "PATH_BROKEN": "the arm can follow only a part of the circle; nothing was executed",
        "IN_COLLISION": "the arm would touch something on the way",
        "TRACKING_ERROR": "the arm was blocked or left its plan by more than the tolerance",
        "BUSY": "another leaf moves the arm",
    }
    example = "circle: {plane: yz, radius: 0.10, turns: 2, speed: 0.5}"
    needs = ("toppra",)
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Draw the path from where the tool is, follow it, measure."""
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
        self.metrics |= yield from follow_curve(
            self.arm, path, ports.speed, self.record, ports.tolerance
        )
