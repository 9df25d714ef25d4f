"""Trace a Lissajous curve with the tool."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from bt_dualarm import Angle, FreeAxes, PathSkill, Plane, PortModel, Speed, lissajous_path, port

Amplitude = Annotated[float, Field(ge=0, le=2.0)]
Frequency = Annotated[int, Field(ge=1, le=20)]


class Lissajous(PathSkill):
    """Trace A sin(a t + phase), B sin(b t) with the tool."""

    class Ports(PortModel):
        plane: Plane = port("yz", "plane of the curve")
        amplitudes: tuple[Amplitude, Amplitude] = port(
            (0.10, 0.10), "A and B: half of the width and of the height", unit="m"
        )
        frequencies: tuple[Frequency, Frequency] = port((1, 2), "a and b; only their ratio matters")
        phase: Angle = port(0.0, "phase of the first axis", ge=-360, le=360)
        start: Literal["around", "from"] = port(
            "around", "around: the tool is at the center at the start; from: it is on the curve"
        )
        waypoints: int = port(40, "number of waypoints on the curve", ge=4, le=1000)
        repeats: float = port(
            1.0, "number of passes of the whole curve; less than 1 is a part of it", ge=0.01, le=100
        )
        tilt: Angle = port(
            0.0,
            "tilt of the tool toward the center; 0 keeps its orientation",
            ge=-60,
            le=60,
        )
        end: Literal["curve", "center"] = port(
            "curve", "curve: the tool ends where the curve ends; center: it moves on to the center"
        )
        speed: Speed = PathSkill.SPEED
        tolerance: float = PathSkill.TOLERANCE
        free: FreeAxes | None = PathSkill.FREE

    failures = PathSkill.failures | {
        "INVALID_TARGET": "both amplitudes are 0",
        "UNREACHABLE": "no configuration of the arm reaches the curve",
    }
    example = "lissajous: {amplitudes: [0.10, 0.05], frequencies: [1, 2], speed: 0.5}"
    ports: Ports

    @classmethod
    def shift(cls, ports: Ports) -> tuple[float, str] | None:
        """Distance of the end from where the tool was."""
        to_first = abs(ports.amplitudes[0] * math.sin(ports.phase))
        if ports.start == "around" and ports.end == "center":
            return 0.0, ""
        if ports.end == "center":
            return to_first, "end: curve brings the tool back after whole repeats"
        if not float(ports.repeats).is_integer():
            return None
        if ports.start == "around":
            return to_first, "end: center brings the tool back"
        return 0.0, ""

    def run(self) -> Iterator[float | None]:
        """Build the path from the current tool pose, follow it, measure the error."""
        ports = self.ports
        path = lissajous_path(
            self.arm.commanded_tool_pose,
            ports.plane.axes,
            ports.amplitudes,
            ports.frequencies,
            phase=ports.phase,
            mode=ports.start,
            waypoints=ports.waypoints,
            repeats=ports.repeats,
            tilt=ports.tilt,
        )
        yield from self.along(path, to_center=ports.end == "center", free=ports.free or ())
