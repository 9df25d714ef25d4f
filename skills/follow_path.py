"""Follow a path from a file with the tool, at a constant speed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from bt_dualarm import (
    Failure,
    FreeAxes,
    PathFile,
    PathSkill,
    Plane,
    PortModel,
    Pose,
    Speed,
    blended_path,
    points_in,
    port,
)

Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]


class FollowPath(PathSkill):
    """Follow lines through points, or a path from a file, at a constant speed of the tool."""

    class Ports(PortModel):
        exactly_one_of = ("file", "points")

        file: PathFile | None = port(
            None, "CSV file with a point `x, y` per line, or SVG file, whose first path is followed"
        )
        points: tuple[tuple[Coordinate, Coordinate], ...] | None = port(
            None, "points in order, in units of `scale`", min_length=2, max_length=2000
        )
        scale: float = port(0.001, "length of a unit of the points", unit="m", gt=0, le=10)
        plane: Plane = port("yz", "plane of the path; y of a drawing is its second axis")
        start: Literal["from", "around"] = port(
            "from",
            "from: the tool is at the first point; around: points are relative to the tool",
        )
        closed: bool = port(False, "whether a line connects the last point to the first")
        tool_speed: float = port(
            0.05, "speed of the tool, constant except at both ends", unit="m/s", ge=1e-4, le=2
        )
        blend: float = port(
            0.01, "distance from a corner within which the path may cut it", unit="m", gt=0, le=0.5
        )
        speed: Speed = port(0.5, "fraction of the arm's limits for the motion to the first point")
        tolerance: float = PathSkill.TOLERANCE
        free: FreeAxes | None = PathSkill.FREE

    failures = PathSkill.failures | {
        "INVALID_TARGET": "there are fewer than two different points",
        "TOO_FAST": "the joints cannot follow at this speed, or the path is too short for it",
        "UNREACHABLE": "no configuration of the arm reaches the path",
    }
    example = "follow_path: {points: [[0, 0], [80, 0], [80, 50], [0, 50]], tool_speed: 0.05}"
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Build the path from the current tool pose, follow it, measure the error."""
        ports = self.ports
        tool = self.arm.commanded_tool_pose
        given = ports.points or ()
        if ports.file is not None:
            given = tuple(points_in(self.context.texts[ports.file], ports.file))
        offsets = ports.scale * np.array(given)
        if ports.start == "from":
            offsets = offsets - offsets[0]
        if ports.closed:
            offsets = np.vstack((offsets, offsets[0]))
        steps = np.linalg.norm(np.diff(offsets, axis=0), axis=1)
        offsets = offsets[np.concatenate(((True,), steps > 1e-6))]
        if len(offsets) < 2:
            raise Failure("INVALID_TARGET", "all points are at one place")
        positions = tool.position + offsets @ np.array(ports.plane.axes)
        path = blended_path([Pose(at, tool.quaternion) for at in positions], ports.blend)
        self.metrics["path_length_m"] = path.length
        self.metrics["tool_speed_m_s"] = ports.tool_speed
        yield from self.along(path, tool_speed=ports.tool_speed, free=ports.free or ())

    @classmethod
    def shift(cls, ports: Ports) -> tuple[float, str] | None:
        """Distance of the end from where the tool was; unknown for a file."""
        if ports.points is None:
            return None
        points = ports.scale * np.array(ports.points)
        first = points[0] if ports.start == "from" else np.zeros(2)
        end = points[0] if ports.closed else points[-1]
        distance = float(np.linalg.norm(end - first))
        return distance, "closed: true with start: from brings the tool back"
