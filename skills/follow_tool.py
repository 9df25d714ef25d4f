"""Keep a transform to the tool of another arm."""

from __future__ import annotations

import math
from collections.abc import Iterator

from bt_dualarm import (
    CellWait,
    Duration,
    Failure,
    OtherArmName,
    PortModel,
    Pose,
    PoseSpec,
    Skill,
    Speed,
    ToolFollowing,
    port,
)

_ARRIVED_S = 0.2  # the tool has arrived after this time within max_error
_ARRIVAL_S = 10.0  # longest time to arrive after the planned motion, as the other arm may move
_NEAR = (0.002, 0.01)  # m and rad; no planned motion is needed this close to the transform
_CATCHABLE = (0.05, 0.3)  # likewise, after a planned motion: the other arm may be moving
_APPROACHES = 10  # planned motions at most
_STILL = (5e-4, 2e-3)  # m and rad; apparent motion of a tool at rest
_MOVED_M = 0.01  # the other tool's rest counts only after this much motion


class FollowTool(Skill):
    """Keep a transform to the tool of another arm, wherever that arm moves.

    The other arm slows motions that begin meanwhile to what this one can follow. Without
    ``duration`` and ``until_still`` it follows until the tree of the other arm has ended.
    """

    class Ports(PortModel):
        arm: OtherArmName = port(..., "arm whose tool is followed")
        offset: PoseSpec | None = port(
            None,
            "pose of this tool in the frame of the other one; by default the current pose, and "
            "without an orientation the present orientation",
        )
        duration: Duration | None = port(None, "following time after which it succeeds", gt=0)
        until_still: Duration | None = port(
            None,
            "rest time of the other tool, after a motion of 1 cm, after which it succeeds",
            gt=0,
        )
        max_error: float = port(
            0.005,
            "largest measured distance of the tool from the transform, once it has arrived",
            unit="m",
            ge=1e-4,
            le=0.5,
        )
        lost_timeout: Duration = port(0.5, "longest time beyond max_error", gt=0)
        speed: Speed = port(1.0, "fraction of the arm's limits while it follows")
        approach_speed: Speed = port(0.3, "fraction of the arm's limits up to the transform")

    failures = {
        "INVALID_TARGET": "the other arm is not in the world, or follows this one",
        "UNREACHABLE": "the transform is out of reach",
        "NOT_FOLLOWING": "the tool was farther from the transform than max_error",
        "PARTNER_GONE": "the other arm was removed",
    }
    example = "follow_tool: {arm: arm2, duration: 2.0}"
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Move to the transform, keep it, and measure the error until the end."""
        ports = self.ports
        arm = self.arm
        if ports.arm not in arm.world.arms or ports.arm == arm.name:
            raise Failure("INVALID_TARGET", f"there is no other arm {ports.arm!r} in the world now")
        offset = self._offset()
        yield from self._approach(offset)
        following = arm.follow_tool(ports.arm, offset, ports.speed)
        error = _Error()
        wait = self.context.cell.shared.depend(
            self.context.cell.arm,
            self.context.name,
            f"tool {ports.arm}",
            has_timeout=ports.duration is not None,
        )
        try:
            yield from self._follow(following, offset, error, wait)
        finally:
            self.context.cell.shared.end(wait)
            self.metrics |= error.metrics()
        yield from arm.halt()

    def _offset(self) -> Pose:
        other = self.arm.commanded_tool_pose_of(self.ports.arm)
        present = other.inverse @ self.arm.commanded_tool_pose
        return present if self.ports.offset is None else self.ports.offset.pose_from(present)

    def _approach(self, offset: Pose) -> Iterator[float | None]:
        """Move to the transform as it is now, and again if the other arm has moved meanwhile."""
        arm = self.arm
        near = _NEAR
        for _ in range(_APPROACHES):
            goal = arm.commanded_tool_pose_of(self.ports.arm) @ offset
            here = arm.commanded_tool_pose
            away = here.distance(goal)
            if away < near[0] and here.angle(goal) < near[1]:
                return
            goals = arm.configurations(goal)
            yield from arm.travel(goals, self.ports.approach_speed, turns=True)
            arm.world.arms.require(self.ports.arm)
            near = _CATCHABLE
        raise Failure(
            "NOT_FOLLOWING",
            f"{self.ports.arm} was {away:.2f} m ahead after {_APPROACHES} approaches: let it rest "
            "until this arm follows",
            error_m=away,
        )

    def _follow(
        self, following: ToolFollowing, offset: Pose, error: _Error, wait: CellWait
    ) -> Iterator[float | None]:
        ports = self.ports
        arm = self.arm
        cell = self.context.cell.shared
        began = within_since = beyond_since = self.time
        rest = _Rest(arm.tool_pose_of(ports.arm), self.time)
        while True:
            done = (self.time - began) / ports.duration if ports.duration and error.counts else 0.0
            yield min(1.0, done) if ports.duration else None
            arm.check()
            arm.world.arms.require(ports.arm)
            if following.refusal is not None:
                raise following.refusal
            # Without a duration it ends with the other arm, unless nothing will move that any more.
            ends_with_it = ports.until_still is None or rest.has_moved
            if wait.failure is not None and not (ends_with_it and cell.has_ended(ports.arm)):
                raise wait.failure
            other = arm.tool_pose_of(ports.arm)
            rest.take(other, self.time)
            if ports.until_still is not None and rest.has_moved:
                wait.has_timeout = True  # the other arm may wait for the end of this: it rests then
            off_m = error.take(arm.tool_pose, other @ offset)
            if off_m <= ports.max_error:
                beyond_since = self.time
            else:
                within_since = self.time
            if not error.counts:
                if self.time - within_since >= _ARRIVED_S:
                    error.counts = True
                    began = self.time
                elif self.time - began > _ARRIVAL_S:
                    raise self._lost(following, off_m, f"has not arrived in {_ARRIVAL_S:g} s")
                continue
            if self.time - beyond_since > ports.lost_timeout:
                raise self._lost(following, off_m, f"was too far away for {ports.lost_timeout:g} s")
            if off_m > ports.max_error:
                continue
            if ports.duration is not None and self.time - began >= ports.duration:
                return
            if ports.until_still is not None and rest.still_for(self.time) >= ports.until_still:
                return
            if ports.duration is None and ports.until_still is None and cell.has_ended(ports.arm):
                return

    def _lost(self, following: ToolFollowing, off_m: float, how: str) -> Failure:
        """Failure of a tool that is not at the transform, with the reason."""
        off = f"it {how}: {1e3 * off_m:.1f} mm from the transform"
        numbers = {"error_m": off_m, "max_error_m": self.ports.max_error}
        if following.residual_m > 0.5 * self.ports.max_error:
            return Failure(
                "UNREACHABLE",
                f"{off}, of which {1e3 * following.residual_m:.1f} mm are out of reach",
                **numbers,
            )
        behind = math.degrees(following.behind_rad)
        return Failure(
            "NOT_FOLLOWING",
            f"{off}; joint {following.behind_joint} is {behind:.1f}° behind, at the limits of its "
            "speed or acceleration",
            **numbers,
        )


class _Rest:
    """How long the other tool has been at rest after a motion, from its encoders."""

    def __init__(self, tool: Pose, time: float) -> None:
        self._first = tool
        self._anchor = tool
        self._since = time
        self.has_moved = False

    def take(self, tool: Pose, time: float) -> None:
        """Process a measurement."""
        self.has_moved = self.has_moved or tool.distance(self._first) > _MOVED_M
        if tool.distance(self._anchor) > _STILL[0] or tool.angle(self._anchor) > _STILL[1]:
            self._anchor = tool
            self._since = time

    def still_for(self, time: float) -> float:
        """Seconds since the last motion; 0 before the first one."""
        return time - self._since if self.has_moved else 0.0


class _Error:
    """Distance of the tool from the transform from the encoders, from the arrival on."""

    def __init__(self) -> None:
        self.counts = False
        self._squares = 0.0
        self._count = 0
        self._most_m = 0.0
        self._most_rad = 0.0

    def take(self, tool: Pose, goal: Pose) -> float:
        """Process a measurement; returns the distance in m."""
        off = tool.distance(goal)
        if self.counts:
            self._squares += off * off
            self._count += 1
            self._most_m = max(self._most_m, off)
            self._most_rad = max(self._most_rad, tool.angle(goal))
        return off

    def metrics(self) -> dict[str, float]:
        """Root mean square and maximum; empty before the arrival."""
        if self._count == 0:
            return {}
        return {
            "follow_rms_m": (self._squares / self._count) ** 0.5,
            "follow_max_m": self._most_m,
            "follow_max_rad": self._most_rad,
        }
