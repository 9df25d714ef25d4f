"""Search an area with the wrist camera."""

from __future__ import annotations

from collections.abc import Generator, Iterator

import numpy as np

from bt_dualarm import (
    Angle,
    Coverage,
    Failure,
    PortModel,
    PoseSpec,
    SightedObjects,
    SightPorts,
    Skill,
    Speed,
    Vector,
    Vector3,
    camera_now,
    gazes,
    hidden_by_arms,
    look_at,
    own_camera,
    port,
    still_picture,
)

_NEW_M = 0.1  # distance from which another point is worth a look of its own


class Scan(Skill):
    """Search an area with the wrist camera until enough objects are detected.

    It looks first at what an image shows in part, then at the nearest part not seen yet.

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
    begins_anywhere = True
    needs_camera = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """View from where the arm is, then from above one part of the area after the other."""
        own_camera(self.arm)
        seen = self.ports.sighted(self.arm, self.context.cell.zones, looks_again=True)
        yield from self.arm.come_to_rest()  # the motion of a halted leaf may still be braking
        viewpoints = 0
        unreachable = 0
        self._left = self._parts()
        self._hints: list[Vector] = []
        point: Vector | None = None
        while True:
            is_there = point is None or (yield from self._look_at(point, viewpoints))
            unreachable += not is_there
            if is_there:
                viewpoints += point is not None
                picture = yield from still_picture(self.arm, self.ports.frames)
                if picture is not None:
                    seen.take(picture)
                    hidden = hidden_by_arms(self.arm, picture)
                    self._left.take(picture, seen.shape.extent, hidden)
                if len(seen.objects) >= self.ports.least:
                    self._report(seen, viewpoints)
                    return
            point = self._next(seen)
            if point is None:
                seen.accept_hidden()
                if len(seen.objects) >= self.ports.least:
                    self._report(seen, viewpoints)
                    return
                self._refuse(viewpoints, unreachable, seen)

    def _next(self, seen: SightedObjects) -> Vector | None:
        """Next point to look at; None if there is none."""
        for hint in self._cut_off(seen):
            if all(float(np.linalg.norm(hint - one)) > _NEW_M for one in self._hints):
                self._hints.append(hint)
                return hint
        return self._left.nearest(camera_now(self.arm))

    def _cut_off(self, seen: SightedObjects) -> list[Vector]:
        """Points of the area's plane on the lines of sight to what the last image shows in part."""
        points = []
        for eye, sight in seen.cut_off:
            down = float(self._center[2] - eye[2])
            if sight[2] * down > 0.0:
                points.append(eye + down / sight[2] * sight)
        size = 0.5 * self._extents + self.ports.distance
        return [one for one in points if np.all(np.abs(one - self._center)[:2] <= size)]

    def _parts(self) -> Coverage:
        """The parts of the area; each covers about half of an image."""
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
        self._center = np.array(center)
        self._extents = np.array((width, depth))
        part = self._extents / (len(xs), len(ys))
        centers = [self._center + np.array((x, y, 0.0)) for y in ys for x in xs]
        return Coverage(centers, (float(part[0]), float(part[1])))

    def _look_at(self, point: Vector, viewpoints: int) -> Generator[float | None, None, bool]:
        down = np.array((0.0, 0.0, -1.0))
        ports = self.ports
        poses = gazes(point, ports.distance, down, ports.lean, camera_now(self.arm))
        try:
            found = yield from look_at(self.arm, poses, ports.speed, ports.ignored, at=point)
        except Failure as failure:
            if failure.code != "NO_PLAN" or not viewpoints:  # so far the arm may be enclosed
                raise
            return False
        return found is not None

    def _report(self, seen: SightedObjects, places: int) -> None:
        first = seen.pose(seen.objects[0])
        x, y, z = first.position.tolist()
        a, b, c, d = first.quaternion.tolist()
        self.output("pose", PoseSpec(xyz=(x, y, z), quat=(a, b, c, d)))
        self.output("count", len(seen.objects))
        self.arm.known.glimpsed[self.ports.wanted] = seen.objects[0].position
        if self.ports.object is not None:
            self.arm.known.saw(self.ports.object, first)
        self.metrics |= {"found": len(seen.objects), "places": places}

    def _refuse(self, viewpoints: int, unreachable: int, seen: SightedObjects) -> None:
        found = len(seen.objects)
        if unreachable and not viewpoints:
            raise Failure("OUT_OF_REACH", "no viewpoint above the area is reachable")
        # The image from where the arm was may have shown the whole area.
        places = {0: "where the arm was", 1: "one place"}.get(viewpoints, f"{viewpoints} places")
        raise Failure(
            "NOT_SEEN",
            f"{found} of {self.ports.least} objects of this color and shape from {places}; "
            f"in the last image {seen.others}",
            found=found,
            places=viewpoints,
            beyond_share=seen.beyond,
        )


def _centers(size: float, step: float) -> list[float]:
    """Centers of equal parts of a length, none longer than a step, relative to its center."""
    count = max(int(np.ceil(size / step)), 1)
    return [size * ((part + 0.5) / count - 0.5) for part in range(count)]
