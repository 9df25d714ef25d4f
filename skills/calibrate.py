"""Find out where the wrist camera really sits, by a mark that stands still."""

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

_FEWEST = 6
_NO_WAY = {"UNREACHABLE", "JOINT_LIMIT", "IN_COLLISION", "NO_PLAN", "SINGULAR"}


def _radians(*degrees: float) -> list[float]:
    return [float(angle) for angle in np.radians(degrees)]


@dataclass(frozen=True)
class _Place:
    """A place of the camera: turns about the mark, a share of the distance, a look beside it.

    Turns are in degrees: across and along the image, and about the line of sight.
    """

    across: float = 0.0
    along: float = 0.0
    roll: float = 0.0
    share: float = 1.0
    beside: tuple[float, float] = (0.0, 0.0)

    def scaled(self, share: float) -> _Place:
        """The same with its turns multiplied: where that is out of reach, another may not be."""
        turns = (share * self.across, share * self.along, share * self.roll)
        beside = (share * self.beside[0], share * self.beside[1])
        return _Place(*turns, self.share, beside)

    def camera(self, mark: Vector, first: MarkView, distance: float) -> Pose:
        """The pose of the camera in the world."""
        middle = Pose(mark, first.camera.quaternion)
        around = Pose.from_rpy((0, 0, 0), _radians(self.across, self.along, self.roll))
        away = Pose.from_rpy((0, 0, -self.share * distance), _radians(*self.beside, 0.0))
        return middle @ around @ away


_PLACES = (
    _Place(across=14),
    _Place(along=14, beside=(12, 0)),
    _Place(along=-14, share=1.2),
    _Place(across=-14, beside=(0, 12)),
    _Place(roll=28, share=0.75),
    _Place(roll=-28, share=0.8),
    _Place(across=10, along=10, share=1.25, beside=(-12, 0)),
    _Place(across=-10, along=10, beside=(0, -12)),
    _Place(share=1.2, beside=(10, 10)),
)


class Calibrate(Skill):
    """Look at a still mark, best a ball, from around it, and correct the camera's mount by it."""

    class Ports(PortModel):
        color: Color = port("yellow", "what the mark looks like: a name or HSV ranges")
        distance: float = port(
            0.35, "roughly, of the mark from the camera", unit="m", gt=0.05, le=2
        )
        speed: Speed = port(0.5, "share of the arm's limits")
        max_residual: float = port(
            1.0, "largest root mean square of what is left in the images", unit="px", gt=0, le=50
        )

    failures = {
        "NO_CAMERA": "the arm has no camera of its own",
        "NOT_SEEN": "the mark was not seen, or from too few places",
        "NOT_STILL": "no mount explains the images: the mark moved, or there are several",
        "TRACKING_ERROR": "the arm was blocked or could not follow",
        "BUSY": "another leaf moves the arm",
    }
    example = "calibrate: {color: yellow, distance: 0.35, speed: 1.0}"
    needs_camera = True
    needs = ("scipy.optimize",)
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Look from places that can be reached, solve, go back, believe it from now on."""
        arm, looks = self.arm, MarkViews(self.arm, self.ports.color)
        yield from arm.think()  # what was halted before may still be on its way
        start = arm.setpoint.q
        first = yield from looks.look()
        if first is None:
            raise Failure("NOT_SEEN", "the mark is not in the picture")
        camera_in_tool = arm.tool_pose.inverse @ first.camera
        ray = np.array((*(first.pixel / first.focal_px), 1.0))
        mark = first.camera.apply(self.ports.distance * ray)
        views = [first]
        for number, place in enumerate(_PLACES):
            for instead in (place, place.scaled(-1.0), place.scaled(0.5)):
                camera = instead.camera(mark, first, self.ports.distance)
                tool = camera @ camera_in_tool.inverse
                if (yield from self._reaches(tool, number / len(_PLACES))):
                    seen = yield from looks.look()
                    if seen is not None:
                        views.append(seen)
                        break
        yield from arm.travel([start], self.ports.speed)
        self._correct(views, mark)

    def _reaches(self, pose: Pose, progress: float) -> Generator[float | None, None, bool]:
        """Go to a pose of the tool; returns whether there is a way."""
        try:
            goals = self.arm.kinematics.solutions(pose, self.arm.setpoint.q)
            for _ in self.arm.travel(goals, self.ports.speed):
                yield progress
        except Failure as failure:
            if failure.code not in _NO_WAY:
                raise
            return False
        return True

    def _correct(self, views: list[MarkView], mark: Vector) -> None:
        if len(views) < _FEWEST:
            raise Failure(
                "NOT_SEEN",
                f"the mark was seen from {len(views)} places, of {_FEWEST} at least",
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
