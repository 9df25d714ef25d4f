"""Point the wrist camera at a point, from a distance."""

from __future__ import annotations

from collections.abc import Iterator
from math import degrees

import numpy as np

from bt_dualarm import (
    Angle,
    Direction,
    Failure,
    PointPose,
    PortModel,
    Skill,
    Speed,
    camera_now,
    gazes,
    look_at,
    own_camera,
    port,
    unit_vector,
)


class LookAt(Skill):
    """Point the wrist camera at a point, from a distance."""

    class Ports(PortModel):
        at: PointPose = port(..., "point to center in the image; its orientation is not used")
        distance: float = port(
            0.4, "distance of the camera from the point", unit="m", ge=0.05, le=5
        )
        direction: Direction = port((0.0, 0.0, -1.0), "line of sight, world axes")
        lean: Angle = port(
            30, "largest angle between the line of sight and `direction`", ge=0, le=90
        )
        speed: Speed = port(0.5, "fraction of the arm's limits")

    failures = {
        "NO_CAMERA": "the arm has no camera that moves with it",
        "OUT_OF_REACH": "no pose of the camera for that can be reached",
        "TRACKING_ERROR": "the arm was blocked or could not follow",
        "BUSY": "another leaf moves the arm",
    }
    example = "look_at: {at: {xyz: [0.68, 0.11, 0.70]}, direction: [-1, 0, 0]}"
    begins_anywhere = True
    needs_camera = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Try camera poses in turn until one is reached; measure the remaining error."""
        arm = self.arm
        ports = self.ports
        own_camera(arm)
        direction = unit_vector(ports.direction)
        yield from arm.come_to_rest()  # the motion of a halted leaf may still be braking
        point = ports.at.pose.position
        poses = gazes(point, ports.distance, direction, ports.lean, camera_now(arm))
        if (yield from look_at(arm, poses, ports.speed, at=point)) is None:
            raise Failure(
                "OUT_OF_REACH",
                f"no reachable camera pose looks at the point from {ports.distance:.2f} m, within "
                f"{degrees(ports.lean):.0f}° of the direction",
                distance_m=ports.distance,
            )
        x, y, depth = camera_now(arm).inverse.apply(point).tolist()
        self.metrics |= {"beside_m": float(np.hypot(x, y)), "distance_m": depth}
