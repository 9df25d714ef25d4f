"""Search an area with the wrist camera."""

from __future__ import annotations

from collections.abc import Generator, Iterator

import numpy as np

from bt_dualarm import (
    Angle,
    Failure,
    PortModel,
    PoseSpec,
    SightedThings,
    SightPorts,
    Skill,
    Speed,
    Vector,
    Vector3,
    camera_now,
    gazes,
    look_at,
    own_camera,
    port,
    still_picture,
)


class Scan(Skill):
    """Search an area with the wrist camera until enough objects are detected.

    The poses are rough estimates from one viewpoint; `locate` refines them.
    """

    class Ports(SightPorts):
        center: Vector3 = port(
            (0.35, -0.5, 0.4),
            "center of the area; with `region`, this and the extents are by default those of it",
            unit="m",
        )
        width: float = port(0.5, "extent of the area along x", unit="m", ge=0, le=5)
        depth: float = port(0.4, "extent of the area along y", unit="m", ge=0, le=5)
        distance: float = port(0.45, "distance of the camera from the area", unit="m", ge=0.1, le=5)
        lean: Angle = port(
            30, "largest angle between the line of sight and the vertical", ge=0, le=90
        )
        least: int = port(1, "number of objects at which the search ends", ge=1, le=100)
        frames: int = port(2, "images that are averaged at each viewpoint", ge=1, le=100)
        speed: Speed = port(0.5, "fraction of the arm's limits")

    class Outputs(PortModel):
        pose: PoseSpec = port(..., "Rough pose of the first detected object")
        count: int = port(..., "Number of objects detected")

    failures = {
        "NO_CAMERA": "the arm has no camera that moves with it",
        "INVALID_TARGET": "the object has no color that can be detected, or no size is given",
        "NOT_SEEN": "too few objects of this color and shape are in the area",
        "OUT_OF_REACH": "no viewpoint above the area can be reached",
        "TRACKING_ERROR": "the arm was blocked or could not follow",
        "BUSY": "another leaf moves the arm",
    }
    example = "scan: {object: cube, center: [0.40, -0.40, 0.40], width: 0.3, depth: 0.2}"
    needs_camera = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """View from where the arm is, then from above one part of the area after the other."""
        own_camera(self.arm)
        seen = self.ports.sighted(self.arm, self.context.cell.zones)
        yield from self.arm.come_to_rest()  # the motion of a halted leaf may still be braking
        viewpoints = 0
        for number, point in enumerate((None, *self._centers())):
            if point is not None and not (yield from self._look_at(point, viewpoints)):
                continue
            viewpoints += point is not None
            picture = yield from still_picture(self.arm, self.ports.frames)
            if picture is not None:
                seen.take(picture)
            if len(seen.things) >= self.ports.least:
                self._report(seen, number)
                return
        self._refuse(viewpoints, seen)

    def _centers(self) -> list[Vector]:
        """Centers of the parts of the area, row by row; a part covers about half of an image."""
        ports = self.ports
        step = 0.6 * self.ports.distance
        center = np.array(ports.center)
        width = ports.width
        depth = ports.depth
        if ports.region is not None and not {"center", "width", "depth"} & ports.model_fields_set:
            frame, region = ports.placed_region(self.arm, self.context.cell.zones)
            center = frame.position
            width, depth = (np.abs(frame.rotation_matrix) @ region.edges)[:2].tolist()
        xs = _centers(width, step)
        ys = _centers(depth, step)
        return [
            center + np.array((x, y, 0.0))
            for row, y in enumerate(ys)
            for x in (xs if row % 2 == 0 else xs[::-1])
        ]

    def _look_at(self, point: Vector, viewpoints: int) -> Generator[float | None, None, bool]:
        down = np.array((0.0, 0.0, -1.0))
        ports = self.ports
        poses = gazes(point, ports.distance, down, ports.lean, camera_now(self.arm))
        try:
            found = yield from look_at(self.arm, poses, ports.speed, ports.ignored)
        except Failure as failure:
            if failure.code != "NO_PLAN" or not viewpoints:  # so far the arm may be enclosed
                raise
            return False
        return found is not None

    def _report(self, seen: SightedThings, places: int) -> None:
        first = seen.pose(seen.things[0])
        x, y, z = first.position.tolist()
        a, b, c, d = first.quaternion.tolist()
        self.output("pose", PoseSpec(xyz=(x, y, z), quat=(a, b, c, d)))
        self.output("count", len(seen.things))
        if self.ports.object is not None:
            self.arm.known.saw(self.ports.object, first)
        self.metrics |= {"found": len(seen.things), "places": places}

    def _refuse(self, viewpoints: int, seen: SightedThings) -> None:
        found = len(seen.things)
        if not viewpoints:
            raise Failure("OUT_OF_REACH", "no viewpoint above the area is reachable")
        raise Failure(
            "NOT_SEEN",
            f"{found} of {self.ports.least} objects of this color and shape from {viewpoints} "
            f"places; in the last image {seen.others}",
            found=found,
            places=viewpoints,
            beyond_share=seen.beyond,
        )


def _centers(size: float, step: float) -> list[float]:
    """Centers of equal parts of a length, none longer than a step, relative to its center."""
    count = max(int(np.ceil(size / step)), 1)
    return [size * ((part + 0.5) / count - 0.5) for part in range(count)]
