"""Look over an area with the wrist camera until something is found."""

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
    """Look over an area with the arm's own camera until so many things are found.

    Where they are it says roughly, as one picture tells; `locate` knows better.
    """

    class Ports(SightPorts):
        center: Vector3 = port((0.35, -0.5, 0.4), "middle of the area", unit="m")
        width: float = port(0.5, "of the area along x", unit="m", ge=0, le=5)
        depth: float = port(0.4, "of the area along y", unit="m", ge=0, le=5)
        distance: float = port(0.45, "of the camera from the area", unit="m", ge=0.1, le=5)
        lean: Angle = port(30, "how far the line of sight may be off the vertical", ge=0, le=90)
        least: int = port(1, "how many things are enough", ge=1, le=100)
        frames: int = port(4, "pictures that are merged at each place", ge=1, le=100)
        speed: Speed = port(0.5, "share of the arm's limits")

    class Outputs(PortModel):
        pose: PoseSpec = port(..., "Pose of the thing that was found first, roughly")
        count: int = port(..., "How many were found")

    failures = {
        "NO_CAMERA": "the arm has no camera of its own",
        "INVALID_TARGET": "the object has no colour that can be found, or no size is given",
        "NOT_SEEN": "too few things of this colour and shape are in the area",
        "OUT_OF_REACH": "there is no place from which the arm could look at the area",
        "TRACKING_ERROR": "the arm was blocked or could not follow",
        "BUSY": "another leaf moves the arm",
    }
    example = "scan: {object: cube, center: [0.40, -0.40, 0.40], width: 0.3, depth: 0.2}"
    needs_camera = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Look from where the arm is, then from above one part of the area after the other."""
        own_camera(self.arm)
        seen = self.ports.sighted(self.arm)
        yield from self.arm.think()  # what was halted before may still be on its way
        looked = 0
        for number, point in enumerate((None, *self._points())):
            if point is not None and not (yield from self._look_at(point)):
                continue
            looked += point is not None
            picture = yield from still_picture(self.arm, self.ports.frames)
            if picture is not None:
                seen.take(picture)
            if len(seen.things) >= self.ports.least:
                self._tell(seen, number)
                return
        self._refuse(looked, seen)

    def _points(self) -> list[Vector]:
        """Middles of the parts of the area, each as large as half of what is in one picture."""
        ports, step = self.ports, 0.6 * self.ports.distance
        xs, ys = (_middles(size, step) for size in (ports.width, ports.depth))
        middle = np.array(ports.center)
        return [
            middle + np.array((x, y, 0.0))
            for row, y in enumerate(ys)
            for x in (xs if row % 2 == 0 else xs[::-1])
        ]

    def _look_at(self, point: Vector) -> Generator[float | None, None, bool]:
        down, ports = np.array((0.0, 0.0, -1.0)), self.ports
        places = gazes(point, ports.distance, down, ports.lean, camera_now(self.arm))
        found = yield from look_at(self.arm, places, ports.speed, ports.ignored)
        return found is not None

    def _tell(self, seen: SightedThings, places: int) -> None:
        first = seen.pose(seen.things[0])
        x, y, z = first.position.tolist()
        a, b, c, d = first.quaternion.tolist()
        self.output("pose", PoseSpec(xyz=(x, y, z), quat=(a, b, c, d)))
        self.output("count", len(seen.things))
        self.metrics |= {"found": len(seen.things), "places": places}

    def _refuse(self, looked: int, seen: SightedThings) -> None:
        found = len(seen.things)
        if not looked:
            raise Failure("OUT_OF_REACH", "no place above the area can be reached")
        raise Failure(
            "NOT_SEEN",
            f"{found} of {self.ports.least} things of this colour and shape from {looked} places; "
            f"in the last picture {seen.others}",
            found=found,
            places=looked,
            beyond_share=seen.beyond,
        )


def _middles(size: float, step: float) -> list[float]:
    """Middles of equal parts of a length, none longer than a step, from the length's middle."""
    count = max(int(np.ceil(size / step)), 1)
    return [size * ((part + 0.5) / count - 0.5) for part in range(count)]
