"""Find things of known colour and shape by the arm's own camera, and say where they are."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bt_dualarm import (
    SIDES,
    Angle,
    Failure,
    ObjectName,
    PortModel,
    Pose,
    PoseSpec,
    SightedThing,
    SightPorts,
    Skill,
    Speed,
    Vector,
    go_to_camera,
    own_camera,
    port,
    still_picture,
)

_Row = tuple[float, float, float, float, float, float]


class Locate(Skill):
    """Find things of a known colour and shape by the arm's own camera, and say where they are.

    It looks from where the arm stands, then from around what it has seen until the place is known
    well enough. Where things are in the file, or in truth, it does not know.
    """

    class Ports(SightPorts):
        accuracy: float = port(
            0.001, "standard deviation of the place, at most", unit="m", ge=1e-4, le=0.1
        )
        angle_accuracy: Angle = port(
            1.0, "the same of the turn, as far as one can be seen", ge=0.05, le=90
        )
        views: int = port(8, "places to look from, at most", ge=1, le=12)
        frames: int = port(6, "pictures that are merged at each place", ge=1, le=100)
        distance: float = port(0.3, "distance from which it looks again", unit="m", ge=0.08, le=2)
        speed: Speed = port(0.5, "share of the arm's limits")
        score: ObjectName | None = port(
            None, "object whose true pose the metrics compare with; never used to find it"
        )

    class Outputs(PortModel):
        pose: PoseSpec = port(..., "Pose of the first of `poses`")
        covariance: tuple[_Row, _Row, _Row, _Row, _Row, _Row] = port(
            ..., "Its covariance: place (m²), then turn about the world's axes (rad²)"
        )
        poses: tuple[PoseSpec, ...] = port(
            ..., "Poses of all that were found, the nearest to the arm's base first"
        )
        count: int = port(..., "How many were found")

    failures = {
        "NO_CAMERA": "the arm has no camera of its own",
        "INVALID_TARGET": "the object has no colour that can be found, or no size is given",
        "NOT_SEEN": "nothing of this colour and shape is in the picture",
        "WRONG_SIZE": "what has this colour and form is larger or smaller",
        "INACCURATE": "what was seen is not known as well as asked for, or did not stand still",
        "TRACKING_ERROR": "the arm was blocked or could not follow",
        "BUSY": "another leaf moves the arm",
    }
    example = "locate: {object: cube, accuracy: 0.002}"
    needs_camera = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Look, go around until the places are known, write them on the blackboard."""
        own_camera(self.arm)
        self._seen = self.ports.sighted(self.arm)
        yield from self.arm.think()  # what was halted before may still be on its way
        yield from self._look_from_here()
        if not self._seen.things:
            self._refuse_unseen()
        yield from self._look_around()
        known = [one for one in self._seen.things if self._is_known(one)]
        found = sorted(filter(self._has_its_size, known), key=self._from_base)
        if not found:
            self._refuse_other_size(known or self._seen.things)
            self._refuse_inaccurate()
        self._tell(found)

    def _look_from_here(self) -> Iterator[None]:
        picture = yield from still_picture(self.arm, self.ports.frames)
        if picture is not None:
            self._looking = picture.pose.quaternion
            self._seen.take(picture)

    def _look_around(self) -> Iterator[float | None]:
        """From one side after the other, as long as something is not known well enough."""
        looked, looking = 1, self._looking
        for side in SIDES:
            open_ = [one for one in self._seen.things if not self._is_known(one)]
            if looked >= self.ports.views or not open_:
                return
            middle = np.mean([thing.position for thing in open_], axis=0)
            camera = side.camera(middle, looking, self._distance(middle))
            if (yield from go_to_camera(self.arm, camera, self.ports.speed, self.ports.ignored)):
                yield from self._look_from_here()
                looked += 1

    def _distance(self, middle: Vector) -> float:
        """As asked for, or farther where several things are to be in the picture."""
        apart = max(float(np.linalg.norm(one.position - middle)) for one in self._seen.things)
        return max(self.ports.distance, 3.0 * apart, 5.0 * self._seen.shape.extent)

    def _is_known(self, thing: SightedThing) -> bool:
        ports = self.ports
        turned = self._seen.sigma_rad(thing)
        if thing.best.sigma_m > ports.accuracy or turned > ports.angle_accuracy:
            return False
        # That all rests on its size: of what is larger than declared, pictures from one place show
        # the same farther away.
        return self._seen.size_of(thing).is_known

    def _has_its_size(self, thing: SightedThing) -> bool:
        return self._seen.other_size(thing) is None

    def _from_base(self, thing: SightedThing) -> float:
        base = self.arm.kinematics.base.position
        return float(np.linalg.norm(thing.position - base))

    def _tell(self, found: list[SightedThing]) -> None:
        poses = [self._seen.pose(thing) for thing in found]
        best = found[0].best
        self.output("pose", _written(poses[0]))
        self.output("covariance", tuple(map(tuple, best.covariance.tolist())))
        self.output("poses", tuple(map(_written, poses)))
        self.output("count", len(poses))
        self.metrics |= {
            "found": len(poses),
            "views": len(found[0].views),
            "sigma_m": best.sigma_m,
            "sigma_rad": self._seen.sigma_rad(found[0]),
            "size_ratio": self._seen.size_of(found[0]).ratio,
            "residual_px": best.residual_px,
        }
        self._score(poses)

    def _score(self, poses: list[Pose]) -> None:
        """How far the nearest one is from the truth, which nothing else reads."""
        name = self.ports.score or self.ports.object
        if name not in self.arm.world.objects:
            return
        truth = self.arm.world.object_pose(name)
        nearest = min(poses, key=truth.distance)
        self.metrics |= {
            "located_error_m": nearest.distance(truth),
            "located_turned_rad": self._seen.shape.angle(nearest, truth),
        }

    def _refuse_unseen(self) -> None:
        seen = self._seen
        raise Failure(
            "NOT_SEEN",
            f"nothing of this colour and shape in {self.ports.frames} pictures; {seen.others}",
            frames=self.ports.frames,
            unlike=seen.unlike,
            beyond_share=seen.beyond,
        )

    def _refuse_other_size(self, things: list[SightedThing]) -> None:
        """What is there is of that form and colour, and larger or smaller than it should be."""
        declared = " by ".join(f"{1e3 * edge:.1f}" for edge in self._seen.shape.size)
        for thing in things:
            size = self._seen.other_size(thing)
            if size is None:
                continue
            measured = " by ".join(f"{1e3 * edge:.1f}" for edge in size.size)
            raise Failure(
                "WRONG_SIZE",
                f"the {self._seen.shape.kind} that is there measures {measured} mm, not {declared} "
                f"mm: {size.ratio:.3f} ± {size.sigma:.3f} times as much",
                size_ratio=size.ratio,
                size_sigma=size.sigma,
                views=len(thing.views) + len(thing.astray),
            )

    def _refuse_inaccurate(self) -> None:
        best = min(self._seen.things, key=lambda one: one.best.sigma_m)
        turned, size = self._seen.sigma_rad(best), self._seen.size_of(best)
        raise Failure(
            "INACCURATE",
            f"from {len(best.views)} places the thing is known to {1e3 * best.best.sigma_m:.1f} mm "
            f"and {np.degrees(turned):.1f}°, its size to {100 * size.sigma:.1f} %"
            + (f"; {len(best.astray)} pictures show it elsewhere" if best.astray else ""),
            views=len(best.views),
            rejected=len(best.astray),
            sigma_m=best.best.sigma_m,
            sigma_rad=turned,
            size_sigma=size.sigma,
        )


def _written(pose: Pose) -> PoseSpec:
    """A pose as a file would have it."""
    x, y, z = pose.position.tolist()
    a, b, c, d = pose.quaternion.tolist()
    return PoseSpec(xyz=(x, y, z), quat=(a, b, c, d))
