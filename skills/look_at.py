"""Turn the wrist camera to a point, from a distance."""

from __future__ import annotations

from collections.abc import Iterator
from math import degrees

import numpy as np

from bt_dualarm import (
    Angle,
    Failure,
    PortModel,
    PoseSpec,
    Skill,
    Speed,
    Vector3,
    camera_now,
    gazes,
    look_at,
    own_camera,
    port,
    unit_vector,
)


class LookAt(Skill):
    """Turn the arm's own camera to a point, from a distance, where there is a way to do so."""

    class Ports(PortModel):
        at: PoseSpec = port(..., "point in the middle of the image; how it is turned is no matter")
        distance: float = port(0.4, "of the camera from the point", unit="m", ge=0.05, le=5)
        direction: Vector3 = port((0.0, 0.0, -1.0), "line of sight, world axes")
        lean: Angle = port(30, "how far the line of sight may be off that", ge=0, le=90)
        speed: Speed = port(0.5, "share of the arm's limits")

    failures = {
        "NO_CAMERA": "the arm has no camera of its own",
        "INVALID_TARGET": "the direction has no length",
        "OUT_OF_REACH": "there is no way to any place from which it could look there",
        "TRACKING_ERROR": "the arm was blocked or could not follow",
        "BUSY": "another leaf moves the arm",
    }
    example = "look_at: {at: {xyz: [0.68, 0.11, 0.70]}, direction: [-1, 0, 0]}"
    needs_camera = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Try the places one after the other; `travel` ends only where the arm stands there."""
        arm, ports = self.arm, self.ports
        own_camera(arm)
        direction = unit_vector(ports.direction)
        yield from arm.think()  # what was halted before may still be on its way
        point = ports.at.pose.position
        places = gazes(point, ports.distance, direction, ports.lean, camera_now(arm))
        if (yield from look_at(arm, places, ports.speed)) is None:
            raise Failure(
                "OUT_OF_REACH",
                f"no way to a place that looks at the point from {ports.distance:.2f} m, within "
                f"{degrees(ports.lean):.0f}° of the direction",
                distance_m=ports.distance,
            )
        seen = camera_now(arm).inverse.apply(point)
        beside, depth = float(np.hypot(seen[0], seen[1])), float(seen[2])
        self.metrics |= {"beside_m": beside, "distance_m": depth}
