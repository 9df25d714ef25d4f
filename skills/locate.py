"""Estimate the poses of objects of known color and shape with the wrist camera."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType

import numpy as np

from bt_dualarm import (
    Angle,
    Failure,
    ObjectName,
    PortModel,
    Pose,
    PoseSpec,
    SightedObject,
    SightPorts,
    Skill,
    Speed,
    Vector,
    Viewpoints,
    arms_in_view,
    camera_now,
    gazes,
    go_to_camera,
    hidden_point,
    least_hidden,
    look_at,
    own_camera,
    port,
    still_picture,
)

_MARKER_SHARES = (0.75, 0.4)
"""Fractions of the requested standard deviations of position and rotation above which a marker is
worth one more viewpoint: other objects are placed relative to it, and far from it an error of its
rotation counts most."""

_TURNS = 2  # turns of the camera to what its image shows in part
_ROUGHLY_M = 0.02  # standard deviation of a position up to which plans avoid what is there
_LEANS = np.radians((30.0, 60.0))  # largest deviations of the line of sight from that to it

_Row = tuple[float, float, float, float, float, float]


class Locate(Skill):
    """Estimate the poses of objects of a known color and shape with the wrist camera.

    It takes images from the current pose, turned to what the border of the image cuts off if there
    is nothing else, then from around the detected objects until their poses are accurate enough. It
    uses neither the declared nor the true poses.
    """

    class Ports(SightPorts):
        accuracy: float = port(
            0.001,
            "largest standard deviation of the position of its center",
            unit="m",
            ge=1e-4,
            le=0.1,
        )
        angle_accuracy: Angle = port(
            1.0,
            "largest standard deviation of the orientation, up to the object's symmetry",
            ge=0.05,
            le=90,
        )
        views: int = port(8, "largest number of viewpoints", ge=1, le=12)
        frames: int = port(3, "images that are averaged at each viewpoint", ge=1, le=100)
        distance: float = port(0.3, "distance of the further viewpoints", unit="m", ge=0.08, le=2)
        speed: Speed = port(0.5, "fraction of the arm's limits")
        score: ObjectName | None = port(
            None, "object whose true pose the metrics compare with; not used for the estimate"
        )

    class Outputs(PortModel):
        pose: PoseSpec = port(..., "Pose of the first of `poses`")
        covariance: tuple[_Row, _Row, _Row, _Row, _Row, _Row] = port(
            ..., "Its covariance: position (m²), then rotation about the world's axes (rad²)"
        )
        poses: tuple[PoseSpec, ...] = port(
            ..., "Poses of all objects found, the nearest to the arm's base first"
        )
        count: int = port(..., "Number of objects found")

    failures = {
        "NO_CAMERA": "the arm has no camera that moves with it",
        "INVALID_TARGET": "the object has no color that can be detected, or no size is given",
        "NOT_SEEN": "nothing of this color and shape is in the image",
        "WRONG_SIZE": "the object with this color and shape is larger or smaller",
        "INACCURATE": "the estimate is less accurate than requested, or the object moved",
        "TRACKING_ERROR": "the arm was blocked or could not follow",
        "BUSY": "another leaf moves the arm",
    }
    example = "locate: {object: cube, accuracy: 0.002}"
    needs_camera = True
    ports: Ports
    _viewpoints = 1
    _unseen: tuple[Vector, Vector] | None = None
    _arms_seen: Mapping[str, float] = MappingProxyType({})

    def run(self) -> Iterator[float | None]:
        """View, move around until the poses are accurate, write them to the blackboard."""
        own_camera(self.arm)
        self._seen = self.ports.sighted(self.arm, self.context.cell.zones, looks_again=True)
        yield from self.arm.come_to_rest()  # the motion of a halted leaf may still be braking
        yield from self._take_image()
        yield from self._turn_to_cut_off()
        if not self._seen.objects:
            self._seen.accept_hidden()
        if not self._seen.objects:
            self._refuse_unseen()
        yield from self._view_from_around()
        known = [one for one in self._seen.objects if self._is_known(one)]
        found = sorted(filter(self._has_its_size, known), key=self._from_base)
        if not found:
            self._refuse_other_size(known or self._seen.objects)
            self._refuse_inaccurate()
        self._report(found)

    def _take_image(self) -> Iterator[None]:
        picture = yield from still_picture(self.arm, self.ports.frames)
        if picture is not None:
            self._orientation = picture.pose.quaternion
            self._seen.take(picture)
            self._arms_seen = arms_in_view(self.arm, picture)
            self._unseen = hidden_point(self.arm, picture, self._seen, self.ports.distance)
            glimpsed = self.arm.known.glimpsed
            if self._seen.objects:
                glimpsed[self.ports.wanted] = self._seen.objects[0].position
            elif self._unseen is None and self.ports.wanted in glimpsed:
                point = glimpsed.pop(self.ports.wanted)
                sight = point - picture.pose.position
                self._unseen = point, sight / np.linalg.norm(sight)

    def _turn_to_cut_off(self) -> Iterator[float | None]:
        """Turn to what the image's border or an arm hides, or what was seen before, if need be.

        So the camera may stand after the halt of a leaf that moved it.
        """
        ports = self.ports
        for _ in range(_TURNS):
            if self._seen.objects or self._unseen is None:
                return
            point, along = self._unseen
            poses = least_hidden(
                self.arm,
                [
                    pose
                    for lean in _LEANS
                    for pose in gazes(point, ports.distance, along, lean, camera_now(self.arm))
                ],
                Pose(point, np.array((1.0, 0.0, 0.0, 0.0))),
                self._seen.shape,
            )
            try:
                there = yield from look_at(self.arm, poses, ports.speed, ports.ignored, at=point)
            except Failure as failure:
                if failure.code != "NO_PLAN":
                    raise
                return
            if there is None:
                return
            self._viewpoints += 1
            yield from self._take_image()

    def _view_from_around(self) -> Iterator[float | None]:
        """View from where it tells most while an estimate is not accurate enough."""
        ports = self.ports
        choice = Viewpoints(
            self.arm, self._orientation, ports.speed, ports.accuracy, ports.angle_accuracy
        )
        camera: Pose | None = None
        began_s: float | None = None
        while self._viewpoints < ports.views and (unknown := self._to_be_seen()):
            if camera is None:
                camera = self._next_of(choice, unknown)
                began_s = None
            if camera is None:
                return
            seen = self._where_seen()
            with self.arm.avoiding(seen):
                there = yield from go_to_camera(
                    self.arm,
                    camera,
                    ports.speed,
                    ports.ignored.difference(seen),
                    began_s=began_s,
                    at=np.mean([one.position for one in unknown], axis=0),
                )
            camera = None
            if there:
                self._viewpoints += 1
                # The next viewpoint is chosen, and the motion to it planned, during the exposures.
                began_s = self.time
                camera = self._next_of(choice, unknown, pending=True)
                yield from self._take_image()

    def _where_seen(self) -> dict[str, Pose]:
        """Where plans avoid the named object, once its place is roughly known."""
        name = self.ports.object
        seen = self._seen.objects
        if name is None or len(seen) != 1 or seen[0].best.sigma_m > _ROUGHLY_M:
            return {}
        return {name: self._seen.pose(seen[0])}

    def _to_be_seen(self) -> list[SightedObject]:
        """Objects that are worth another viewpoint; none only if all are accurate enough."""
        shares = _MARKER_SHARES if self.ports.is_by_marker else (1.0, 1.0)
        return [one for one in self._seen.objects if not self._is_known(one, *shares)]

    def _next_of(
        self, choice: Viewpoints, unknown: list[SightedObject], *, pending: bool = False
    ) -> Pose | None:
        """Next pose of the camera, from which the least known object becomes known."""
        middle = np.mean([obj.position for obj in unknown], axis=0)
        least = max(unknown, key=lambda obj: obj.best.sigma_m)
        expected = self._seen.expected(least)
        return choice.choose(expected, middle, self._viewing_distance(middle), pending=pending)

    def _viewing_distance(self, middle: Vector) -> float:
        """Distance of a viewpoint, m: larger than requested to view several objects at once."""
        apart = max(float(np.linalg.norm(one.position - middle)) for one in self._seen.objects)
        return max(self.ports.distance, 3.0 * apart, 5.0 * self._seen.shape.extent)

    def _is_known(self, obj: SightedObject, share: float = 1.0, angle_share: float = 1.0) -> bool:
        """Whether its standard deviations are at most fractions of those requested."""
        ports = self.ports
        sigma_rad = self._seen.sigma_rad(obj)
        if obj.best.sigma_m > share * ports.accuracy:
            return False
        if sigma_rad > angle_share * ports.angle_accuracy:
            return False
        # All of that assumes the declared size: from one viewpoint, a larger object looks the same
        # as one that is nearer.
        return self._seen.size_of(obj).is_known

    def _has_its_size(self, obj: SightedObject) -> bool:
        return self._seen.other_size(obj) is None

    def _from_base(self, obj: SightedObject) -> float:
        base = self.arm.kinematics.base.position
        return float(np.linalg.norm(obj.position - base))

    def _report(self, found: list[SightedObject]) -> None:
        poses = [self._seen.pose(obj) for obj in found]
        best = self._seen.fit(found[0])
        if self.ports.object is not None:
            alike = None if self.ports.is_by_marker else self._seen.shape.canonical
            self.arm.known.located(self.ports.object, poses[0], alike)
        self.output("pose", _pose_spec(poses[0]))
        self.output("covariance", tuple(map(tuple, best.covariance.tolist())))
        self.output("poses", tuple(map(_pose_spec, poses)))
        self.output("count", len(poses))
        self.metrics |= {
            "found": len(poses),
            "views": len(found[0].views),
            "sigma_m": found[0].best.sigma_m,
            "sigma_rad": self._seen.sigma_rad(found[0]),
            "size_ratio": self._seen.size_of(found[0]).ratio,
            "residual_px": best.residual_px,
        }
        self._score(poses)

    def _score(self, poses: list[Pose]) -> None:
        """Compare the nearest estimate with the true pose, for the metrics only."""
        name = self.ports.score or self.ports.object
        if name is None or name not in self.arm.world.objects:
            return
        truth = self.arm.world.object_pose(name)
        away, turned = min(self._seen.shape.away(pose, truth) for pose in poses)
        self.metrics |= {"located_error_m": away, "located_turned_rad": turned}

    def _refuse_unseen(self) -> None:
        seen = self._seen
        images = "one image" if self.ports.frames == 1 else f"{self.ports.frames} images"
        before = "".join(
            f"; {name} is in {max(round(100.0 * share), 1)} % of the image, and may hide it"
            for name, share in self._arms_seen.items()
        )
        raise Failure(
            "NOT_SEEN",
            f"nothing of this color and shape in {images}; {seen.others}{before}",
            frames=self.ports.frames,
            unlike=seen.unlike,
            beyond_share=seen.beyond,
        )

    def _refuse_other_size(self, objects: list[SightedObject]) -> None:
        """Fail if one of the objects has a size other than the declared one.

        Raises:
            Failure: ``WRONG_SIZE``.
        """
        declared = " by ".join(f"{1e3 * edge:.1f}" for edge in self._seen.shape.size)
        for obj in objects:
            size = self._seen.other_size(obj)
            if size is None:
                continue
            measured = " by ".join(f"{1e3 * edge:.1f}" for edge in size.size)
            raise Failure(
                "WRONG_SIZE",
                f"the detected {self._seen.shape.kind} measures {measured} mm, not {declared} mm: "
                f"{size.ratio:.3f} ± {size.sigma:.3f} times the declared size",
                size_ratio=size.ratio,
                size_sigma=size.sigma,
                views=len(obj.views) + len(obj.astray),
            )

    def _refuse_inaccurate(self) -> None:
        best = min(self._seen.objects, key=lambda one: one.best.sigma_m)
        sigma_rad = self._seen.sigma_rad(best)
        size = self._seen.size_of(best)
        # From one viewpoint, a larger object farther away looks the same.
        known_size = f"to {100 * size.sigma:.1f} %" if size.sigma < 1.0 else "not at all"
        viewpoints = "one viewpoint" if len(best.views) == 1 else f"{len(best.views)} viewpoints"
        shows = "image shows" if len(best.astray) == 1 else "images show"
        unseen = self._viewpoints - len(best.views) - len(best.astray)
        others = "another one" if unseen == 1 else f"{unseen} others"
        raise Failure(
            "INACCURATE",
            f"from {viewpoints} the object is known to "
            f"{1e3 * best.best.sigma_m:.1f} mm and {np.degrees(sigma_rad):.1f}°, "
            f"its size {known_size}"
            + (f"; {len(best.astray)} {shows} it elsewhere" if best.astray else "")
            + (f"; from {others} it was not seen: {self._seen.others}" if unseen > 0 else ""),
            views=len(best.views),
            rejected=len(best.astray),
            sigma_m=best.best.sigma_m,
            sigma_rad=sigma_rad,
            size_sigma=size.sigma,
        )


def _pose_spec(pose: Pose) -> PoseSpec:
    """A pose in the form of a port value."""
    x, y, z = pose.position.tolist()
    a, b, c, d = pose.quaternion.tolist()
    return PoseSpec(xyz=(x, y, z), quat=(a, b, c, d))
