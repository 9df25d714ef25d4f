"""Let go of an attached object."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bt_dualarm import Duration, Failure, ObjectName, PortModel, Skill, port

_STILL = 0.01  # m/s and rad/s
_REST_S = 0.1  # still for so long: what was let go in the air is slow, too, for a moment


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
        began = still_since = self.arm.time
        while True:
            yield
            if name not in world.objects:
                raise Failure("NOT_THERE", f"object {name!r} was taken out of the world")
            speed = float(np.abs(world.object_velocity(name)).max())
            if speed > _STILL:
                still_since = self.arm.time
            rested = self.arm.time - still_since >= _REST_S
            if rested or self.arm.time - began > max(self.ports.settle, _REST_S):
                break
        if name in self.arm.held:
            raise Failure("NOT_AT_REST", f"{name!r} was attached again")
        moved = world.object_pose(name).distance(left_at)
        self.metrics["moved_m"] = moved
        if moved > self.ports.tolerance or not rested:
            raise Failure(
                "NOT_AT_REST",
                f"{name!r} moved {1000 * moved:.1f} mm after it was let go",
                moved_m=moved,
                speed=speed,
            )
