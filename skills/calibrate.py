"""Calibrate the mount of the wrist camera by a mark that does not move (hand-eye calibration)."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass

import numpy as np

from bt_dualarm import (
    Color,
    Failure,
    MarkView,
    MarkViews,
    PortModel,
    Pose,
    Skill,
    Speed,
    Vector,
    hand_eye,
    port,
)

_FEWEST = 6  # views of the mark that determine the six numbers of the mount with some redundancy
_UNREACHED = {"UNREACHABLE", "JOINT_LIMIT", "IN_COLLISION", "NO_PLAN", "SINGULAR"}


def _radians(*degrees: float) -> list[float]:
    return [float(angle) for angle in np.radians(degrees)]


@dataclass(frozen=True)
class _Viewpoint:
    """Pose of the camera relative to the mark and the first view.

    Attributes:
        across: Rotation about the mark, about the image's horizontal axis, in degrees.
        along: The same about the image's vertical axis.
        roll: The same about the line of sight.
        share: Distance as a fraction of the first one.
        beside: Rotations of the camera in place, in degrees, which move the mark off the center.
    """

    across: float = 0.0
    along: float = 0.0
    roll: float = 0.0
    share: float = 1.0
    beside: tuple[float, float] = (0.0, 0.0)

    def scaled(self, share: float) -> _Viewpoint:
        """The same viewpoint with its rotations multiplied."""
        turns = (share * self.across, share * self.along, share * self.roll)
        beside = (share * self.beside[0], share * self.beside[1])
        return _Viewpoint(*turns, self.share, beside)

    def camera(self, mark: Vector, first: MarkView, distance: float) -> Pose:
        """Pose of the camera in the world."""
        middle = Pose(mark, first.camera.quaternion)
        around = Pose.from_rpy((0, 0, 0), _radians(self.across, self.along, self.roll))
        away = Pose.from_rpy((0, 0, -self.share * distance), _radians(*self.beside, 0.0))
        return middle @ around @ away


_VIEWPOINTS = (
    _Viewpoint(across=14),
    _Viewpoint(along=14, beside=(12, 0)),
    _Viewpoint(along=-14, share=1.2),
    _Viewpoint(across=-14, beside=(0, 12)),
    _Viewpoint(roll=28, share=0.75),
    _Viewpoint(roll=-28, share=0.8),
    _Viewpoint(across=10, along=10, share=1.25, beside=(-12, 0)),
    _Viewpoint(across=-10, along=10, beside=(0, -12)),
    _Viewpoint(share=1.2, beside=(10, 10)),
)


class Calibrate(Skill):
    """View a stationary mark, preferably a sphere, from several sides; correct the camera mount."""

    class Ports(PortModel):
        color: Color = port("yellow", "color of the mark: a name or HSV ranges")
        distance: float = port(
            0.35, "rough distance of the mark from the camera", unit="m", gt=0.05, le=2
        )
        speed: Speed = port(0.5, "fraction of the arm's limits")
        max_residual: float = port(
            1.0, "largest root-mean-square reprojection error", unit="px", gt=0, le=50
        )

    failures = {
        "NO_CAMERA": "the arm has no camera that moves with it",
        "NOT_SEEN": "the mark was not seen, or from too few viewpoints",
        "NOT_STILL": "no mount explains the images: the mark moved, or there are several marks",
        "TRACKING_ERROR": "the arm was blocked or could not follow",
        "BUSY": "another leaf moves the arm",
    }
    example = "calibrate: {color: yellow, distance: 0.35, speed: 1.0}"
    needs_camera = True
    needs = ("scipy.optimize",)
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """View the mark from reachable viewpoints, solve, return, and correct the nominal model."""
        arm = self.arm
        mark_views = MarkViews(self.arm, self.ports.color)
        yield from arm.think()  # the motion of a halted leaf may still be braking
        start = arm.setpoint.q
        first = yield from mark_views.look()
        if first is None:
            raise Failure("NOT_SEEN", "the mark is not in the image")
        camera_in_tool = arm.tool_pose.inverse @ first.camera
        ray = np.array((*(first.pixel / first.focal_px), 1.0))
        mark = first.camera.apply(self.ports.distance * ray)
        views = [first]
        for number, viewpoint in enumerate(_VIEWPOINTS):
            # If a viewpoint is out of reach, its mirror image or half the rotation may not be.
            for variant in (viewpoint, viewpoint.scaled(-1.0), viewpoint.scaled(0.5)):
                camera = variant.camera(mark, first, self.ports.distance)
                tool = camera @ camera_in_tool.inverse
                if (yield from self._reaches(tool, number / len(_VIEWPOINTS))):
                    seen = yield from mark_views.look()
                    if seen is not None:
                        views.append(seen)
                        break
        yield from arm.travel([start], self.ports.speed)
        self._correct(views, mark)

    def _reaches(self, pose: Pose, progress: float) -> Generator[float | None, None, bool]:
        """Move the tool to a pose; returns whether that was possible."""
        try:
            goals = self.arm.configurations(pose)
            for _ in self.arm.travel(goals, self.ports.speed, turns=True):
                yield progress
        except Failure as failure:
            if failure.code not in _UNREACHED:
                raise
            return False
        return True

    def _correct(self, views: list[MarkView], mark: Vector) -> None:
        if len(views) < _FEWEST:
            viewpoints = "one viewpoint" if len(views) == 1 else f"{len(views)} viewpoints"
            raise Failure(
                "NOT_SEEN",
                f"the mark was seen from {viewpoints}; at least {_FEWEST} are needed",
                views=len(views),
            )
        found = hand_eye(views, mark)
        self.metrics |= {
            "views": len(views),
            "residual_before_px": found.before_px,
            "residual_px": found.residual_px,
            "shift_m": float(np.linalg.norm(found.correction.position)),
            "turn_rad": found.correction.angle(Pose.identity()),
        }
        if found.residual_px > self.ports.max_residual:
            raise Failure(
                "NOT_STILL",
                f"the images leave {found.residual_px:.1f} px that no mount explains",
                residual_px=found.residual_px,
            )
        self.arm.correct_camera(found.correction)
