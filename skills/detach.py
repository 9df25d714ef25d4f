"""Let go of an attached object."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

from bt_dualarm import Duration, Failure, ObjectName, PortModel, Pose, Skill, port

_REST_S = 0.1
_STILL_M, _STILL_RAD = 1e-4, 1e-3
"""Farthest that what rests was from where it is now, in the last ``_REST_S``: a tool that trembles
on it, or an edge that it rocks on, moves it to and fro at any speed, but nowhere."""


class Detach(Skill):
    """Let go of an object and see it come to rest where it was left."""

    class Ports(PortModel):
        object: ObjectName = port(..., "object to let go of; one that is not held is no failure")
        tolerance: float = port(
            0.01, "farthest it may move while it comes to rest", unit="m", ge=1e-3, le=1.0
        )
        settle: Duration = port(1.0, "longest that coming to rest may take", gt=0, le=30)

    failures = {
        "NOT_THERE": "the object is not in the world",
        "NOT_AT_REST": "the object fell, slid or still moves",
    }
    example = "detach: {object: cube}"
    ports: Ports

    def run(self) -> Iterator[None]:
        """Release, then watch the object until it rests."""
        world, name = self.arm.world, self.ports.object
        if name not in world.objects:
            raise Failure("NOT_THERE", f"object {name!r} is not in the world")
        left_at = world.object_pose(name)
        self.arm.detach(name)
        began = self.arm.time
        been: deque[tuple[float, Pose]] = deque()
        while True:
            yield
            if name not in world.objects:
                raise Failure("NOT_THERE", f"object {name!r} was taken out of the world")
            rested = _rests(been, self.arm.time, world.object_pose(name))
            if rested or self.arm.time - began > max(self.ports.settle, _REST_S):
                break
        if name in self.arm.held:
            raise Failure("NOT_AT_REST", f"{name!r} was attached again")
        moved = world.object_pose(name).distance(left_at)
        self.metrics["moved_m"] = moved
        if moved > self.ports.tolerance or not rested:
            raise Failure(
                "NOT_AT_REST",
                f"{name!r} moved {1000 * moved:.1f} mm after it was let go"
                + ("" if rested else f", and still moves after {self.ports.settle:g} s"),
                moved_m=moved,
            )


def _rests(been: deque[tuple[float, Pose]], now: float, pose: Pose) -> bool:
    """Take where a thing is in, and tell whether it has been there for long enough.

    Args:
        been: Where it was and when, in s; of these as many stay as are asked for the next time.
        now: Time in s.
        pose: Where it is.
    """
    been.append((now, pose))
    while len(been) > 1 and now - been[1][0] >= _REST_S:
        been.popleft()
    return now - been[0][0] >= _REST_S and all(
        pose.distance(was) <= _STILL_M and pose.angle(was) <= _STILL_RAD for _, was in been
    )
