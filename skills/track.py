"""Track a colored target, in a plane or in space, with the wrist camera alone."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal, Self

from pydantic import model_validator

from bt_dualarm import (
    Color,
    Duration,
    EndConditions,
    Failure,
    FollowingError,
    ObjectName,
    PlaneOrFree,
    PlaneTracking,
    PortModel,
    Skill,
    Speed,
    TrackingEnd,
    TrackingGains,
    TrackingScore,
    port,
    refuse_lost,
)


class Track(Skill):
    """Keep a colored target at the image center by moving the camera in a plane or in space.

    Only images and joint sensors are used. Without a target the arm stops, then searches within
    ``search_radius`` of the predicted target position.
    """

    class Ports(PortModel):
        color: Color = port("yellow", "color of the target: a name or HSV ranges")
        plane: PlaneOrFree = port(
            "yz",
            "plane in which the tool moves, at constant orientation; `free` for all directions of "
            "space, at `distance` from the target: needs target_size",
        )
        orientation: Literal["kept", "facing"] = port(
            "kept",
            "orientation of the camera: kept, or facing the target as the arm turns with it, which "
            "needs `plane: free`",
        )
        controller: Literal["predictive", "proportional"] = port(
            "predictive", "predict the target over the latency, or control the image error"
        )
        distance: float = port(
            0.35,
            "depth of the target in front of the camera, which a free plane keeps",
            unit="m",
            gt=0.02,
            le=5,
        )
        target_size: float | None = port(
            None,
            "edge of a cubic target with a face parallel to the plane, or to the image of a free "
            "one, to measure its depth",
            unit="m",
            gt=0.001,
            le=1,
        )
        gain_u: float = port(
            0.05,
            "proportional: step along the plane's first axis per unit error",
            unit="m",
            ge=0,
            le=10,
        )
        gain_v: float = port(
            0.04,
            "proportional: step along the plane's second axis per unit error",
            unit="m",
            ge=0,
            le=10,
        )
        dead_band: float = port(
            0.01, "proportional: image error that is ignored (1: the edge)", ge=0, le=1
        )
        speed: Speed = port(1.0, "fraction of the arm's limits")
        reach: float = port(
            0.3, "largest distance of the tool from its start", unit="m", ge=0.001, le=2
        )
        duration: Duration | None = port(
            None, "time with the target in view after which it succeeds", gt=0
        )
        until_still: Duration | None = port(
            None,
            "rest time of the target, after a motion of 1 cm, after which it succeeds",
            gt=0,
        )
        wait: Duration = port(60.0, "longest wait for the target to come into view", gt=0)
        reach_timeout: Duration = port(
            60.0, "longest wait for a target in view that is farther away than `reach`", gt=0
        )
        move_timeout: Duration = port(
            60.0, "with until_still: longest wait for a target within reach to move", gt=0
        )
        rest_timeout: Duration = port(
            600.0, "with until_still: longest time of following until the target rests", gt=0
        )
        lost_timeout: Duration = port(3.0, "longest time without the target", gt=0)
        max_error: float | None = port(
            None,
            "largest root mean square distance of the target from the image center, from the "
            "arrival of the tool to the end; by default a fifth of the target's width, at least "
            "2 mm",
            unit="m",
            ge=1e-4,
            le=2,
        )
        search_radius: float = port(
            0.05,
            "radius of the search around the predicted target position",
            unit="m",
            ge=0,
            le=0.5,
        )
        score: ObjectName | None = port(
            None, "object whose true path the metrics compare with; not used for control"
        )

        @model_validator(mode="after")
        def _free_needs_the_size(self) -> Self:
            if self.plane.plane is not None and self.orientation == "facing":
                raise ValueError("orientation: facing needs plane: free")
            if self.plane.plane is None and self.controller == "proportional":
                raise ValueError("a free plane needs controller: predictive")
            if self.plane.plane is None and self.target_size is None:
                raise ValueError("a free plane needs target_size, which tells the depth")
            return self

    failures = {
        "NO_CAMERA": "the arm has no camera that moves with it, or it does not face the plane",
        "NOT_SEEN": "the target did not come into view in time, or went out of it before it came "
        "within reach",
        "NOT_MOVED": "with until_still: the target has been at rest for longer than move_timeout",
        "NOT_STILL": "with until_still: the target has not come to rest within rest_timeout",
        "LOST": "the target was out of view, or not recognized, for longer than lost_timeout, or "
        "for most of the time since it was last followed",
        "NOT_FOLLOWING": "the target was farther from the image center than max_error; `cause` is "
        "speed, latency, reach, occlusion, guard or jitter",
        "UNREACHABLE": "the target was out of reach for longer than reach_timeout",
        "IN_COLLISION": "the arm or a held object would touch something on its further path",
        "TRACKING_ERROR": "the arm was blocked or could not follow",
        "BUSY": "another leaf moves the arm",
    }
    example = "track: {color: yellow, plane: yz, controller: predictive, duration: 5.0}"
    needs_camera = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Wait for the target, track it until the end that the ports define."""
        ports = self.ports
        # The motion of a halted leaf may still be braking: plane, orientation and `reach` are those
        # of where it ends.
        yield from self.arm.come_to_rest()
        tracking = PlaneTracking(
            self.arm,
            color=ports.color,
            plane=ports.plane.plane,
            speed=ports.speed,
            distance=ports.distance,
            target_size=ports.target_size,
            gains=TrackingGains(ports.gain_u, ports.gain_v, ports.dead_band)
            if ports.controller == "proportional"
            else None,
            reach=ports.reach,
            search_radius=ports.search_radius,
            error=FollowingError(
                ports.max_error,
                ports.lost_timeout,
                proportional=ports.controller == "proportional",
            ),
            facing=ports.orientation == "facing",
        )
        score = TrackingScore(self.arm, tracking.axes, ports.score)
        try:
            yield from self._wait_for_target(tracking)
            yield from self._follow(tracking, score)
            yield from self.arm.halt()
            yield from self._confirm_at_rest(tracking)
            tracking.error.refuse_above_bound()
            score.refuse_above_bound(tracking)
        finally:
            tracking.close()
            self.metrics |= {**score.metrics(tracking), **tracking.metrics()}
            for name, positions in score.paths().items():
                self.record(name, score.times, positions)
            plane = ports.plane.plane
            self.record("error_in_plane_m" if plane else "error_m", score.times, score.errors())
            if plane:
                self.record("plane_normal", self.time, plane.normal)

    def _wait_for_target(self, tracking: PlaneTracking) -> Iterator[None]:
        began = self.time
        while not tracking.locked:
            if self.time - began > self.ports.wait:
                waited = self.time - began
                reason = f"no target in {waited:.1f} s{tracking.status.not_it}"
                raise Failure("NOT_SEEN", reason, waited_s=waited)
            yield

    def _follow(self, tracking: PlaneTracking, score: TrackingScore) -> Iterator[float | None]:
        ports = self.ports
        conditions = EndConditions(
            duration=ports.duration,
            until_still=ports.until_still,
            wait=ports.wait,
            reach_timeout=ports.reach_timeout,
            move_timeout=ports.move_timeout,
            rest_timeout=ports.rest_timeout,
            lost_timeout=ports.lost_timeout,
            reach=ports.reach,
        )
        end = TrackingEnd(conditions, tracking.error, self.time)
        tracking.begin()
        while True:
            yield end.progress
            self.arm.check()
            tracking.watch()
            score.sample(tracking)
            if end.is_over(tracking.status):
                return

    def _confirm_at_rest(self, tracking: PlaneTracking) -> Iterator[None]:
        """Wait for an image after the stop: the target may have left while the arm braked."""
        stopped_at = self.time
        while tracking.seen_at < stopped_at:
            refuse_lost(tracking.status, self.ports.lost_timeout)
            yield
