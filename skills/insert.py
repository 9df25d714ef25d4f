"""Insert a peg that the gripper holds into its hole, by contact."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import ExitStack

import numpy as np

from bt_dualarm import (
    HANDS_APART_M,
    Angle,
    CarriedPose,
    Failure,
    Grip,
    KnownShape,
    ObjectName,
    PortModel,
    Pose,
    Skill,
    Speed,
    Trajectory,
    Vector,
    guarded_descent,
    port,
    shared_grasp,
)

_CLEAR_M = 0.004  # height above the rim from which the peg is lowered
_HOP_M = 0.001  # height above the rim from which the peg is lowered at a position of the search
_HIGH_M = 0.0005  # a contact sensed within so much of the beginning of a descent is a false one
_UNSURE_M = 0.002  # height above the expected rim from which it is lowered the first time
_NEAR_BOTTOM_M = 0.003  # height above the bottom from which contact is expected
_FALSE = 3  # descents at one position of the search before a false contact counts
_PASSES = 2  # passes of the search; the second searches between the positions of the first
_IN_M = 0.0025  # depth below the rim at which the peg is in the hole
_STARTS = 3  # free branches of the inverse kinematics among which the planner chooses
_TRIES = 12  # blocked branches after which the search for free ones ends
_GOLDEN = np.pi * (3.0 - np.sqrt(5.0))  # golden angle, rad


class Insert(Skill):
    """Insert a held peg into its hole: lower it, search in a spiral, push it down."""

    class Ports(PortModel):
        object: ObjectName = port(..., "peg; the gripper must hold it")
        at: CarriedPose = port(..., "pose of the peg when it is fully inserted")
        depth: float = port(
            0.03, "depth of the inserted peg in the hole", unit="m", ge=0.005, le=0.3
        )
        into: ObjectName | None = port(
            None,
            "object, held by another arm with `hold_still`, that is a side of the hole: the peg "
            "and the hand may touch it",
        )
        radius: float = port(
            0.0018,
            "position uncertainty of the hole; radius of the search",
            unit="m",
            ge=0,
            le=0.02,
        )
        pitch: float = port(
            0.00018, "distance of neighboring positions of the search", unit="m", ge=1e-4, le=0.005
        )
        force: float = port(
            6.0, "contact force at which the rim is detected", unit="N", ge=1, le=100
        )
        push: float = port(
            12.0, "contact force at which the bottom is detected", unit="N", ge=1, le=200
        )
        tolerance: float = port(
            0.003, "largest distance from the bottom at the end", unit="m", ge=1e-4, le=0.05
        )
        angle_tolerance: Angle = port(
            5.0, "largest rotation error of the peg at the end, up to its symmetry", ge=0.1, le=90
        )
        speed: Speed = port(0.3, "fraction of the arm's limits up to the hole")
        down_speed: Speed = port(0.003, "fraction of the arm's limits where contact is expected")

    failures = {
        "NOT_HELD": "the gripper does not hold the peg",
        "NO_CONTACT": "no bottom was detected in the hole",
        "NOT_FOUND": "the peg did not enter at any position of the search",
        "JAMMED": "the peg got stuck before it was fully inserted",
        "SLIPPED": "the peg slid between the fingers",
        "DROPPED": "the peg was lost",
        "NOT_INSERTED": "the peg is not where the arm estimates it: it moved in the gripper",
    }
    example = (
        "insert: {object: cube, at: {xyz: [0.25, -0.45, 0.425], rpy: [0, 0, 0]}, depth: 0.012}"
    )
    needs_gripper = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Move above the hole, search it by contact with the rim, push down, check the depth."""
        arm = self.arm
        name = self.ports.object
        held = arm.world.attachments.find(arm.name, name)
        if held is None or name not in arm.gripper.held:
            raise Failure("NOT_HELD", f"{arm.name} does not hold {name!r}")
        in_tool = arm.robot.tool.inverse @ held.relative
        goal = self.ports.at.pose_from(arm.commanded_tool_pose @ in_tool)
        bottom = goal @ in_tool.inverse
        grip = Grip(arm, name)
        into = self.ports.into
        with ExitStack() as shared:
            for holder in () if into is None else arm.world.attachments.holders(into):
                if into is not None and holder != arm.name:
                    shared.enter_context(shared_grasp(arm, holder, into, HANDS_APART_M))
            try:
                yield from self._go_above(bottom, grip)
                offset = yield from self._search(bottom, grip)
                yield from self._push_down(_moved(bottom, offset, 0.0), grip)
            except Failure as failure:
                if failure.code == "SLIPPED":
                    yield from grip.judge(failure)
                raise
        self._score(name, goal)

    def _score(self, name: str, goal: Pose) -> None:
        """Check the true pose of the peg: no sensor measures how it turned or slid in the gripper.

        The horizontal tolerance includes the position uncertainty of the hole.

        Raises:
            Failure: ``NOT_INSERTED``.
        """
        if name not in self.arm.world.objects:
            raise Failure("NOT_INSERTED", f"object {name!r} was removed from the world")
        ports = self.ports
        spec = self.arm.world.objects[name]
        true = self.arm.world.object_pose(name)
        error = true.position - goal.position
        beside = float(np.linalg.norm(error[:2]))
        turned = KnownShape.of(spec).angle(true, goal)
        self.metrics |= {"inserted_error_m": true.distance(goal), "inserted_turned_rad": turned}
        if (
            abs(error[2]) > ports.tolerance
            or beside > ports.radius + ports.tolerance
            or turned > ports.angle_tolerance
        ):
            raise Failure(
                "NOT_INSERTED",
                f"{name!r} is {1e3 * beside:.1f} mm beside and {1e3 * error[2]:.1f} mm above its "
                f"goal, rotated by {np.degrees(turned):.1f}°",
                beside_m=beside,
                height_off_m=float(error[2]),
                turned_rad=turned,
            )

    def _go_above(self, bottom: Pose, grip: Grip) -> Iterator[float]:
        """Move above the hole, in a branch that also reaches the bottom from there."""
        arm = self.arm
        ports = self.ports
        for progress in arm.past_others(ports.speed).along(lambda: self._plan_above(bottom)):
            yield 0.3 * (progress or 0.0)
            grip.look()

    def _plan_above(self, bottom: Pose) -> Generator[None, None, Trajectory]:
        arm = self.arm
        ports = self.ports
        peg = frozenset({self.ports.object})
        above = _moved(bottom, np.zeros(2), ports.depth + _CLEAR_M)
        deepest = _moved(bottom, np.zeros(2), -ports.tolerance)
        starts: list[Vector] = []
        refusals: list[Failure] = []
        for down, _ in arm.lines(above, bottom, deepest):
            try:
                arm.refuse_collision(down[-1], ignore=peg)  # fingers that hold the peg too low
            except Failure as failure:
                refusals.append(
                    failure.with_traceback(None)
                )  # a traceback would keep this frame alive
            else:
                starts.append(down[0])
            yield
            if len(starts) == _STARTS or len(refusals) == _TRIES:
                break
        if not starts:
            raise refusals[0]
        return (yield from arm.plan(starts, ports.speed))

    def _search(self, bottom: Pose, grip: Grip) -> Generator[float | None, None, Vector]:
        """Search the hole by hops along a spiral; returns its offset from the goal, (2,), m."""
        arm = self.arm
        ports = self.ports
        force = grip.firm_for(ports.force)
        rim = lowest = ports.depth  # height of the tool above its pose at the bottom
        start = rim + _UNSURE_M
        count = 0
        for count, offset in enumerate(_spiral(ports.radius, ports.pitch), start=1):
            height = yield from self._probe(bottom, offset, start, lowest, force, grip)
            if height < lowest - _IN_M:
                beside = float(np.linalg.norm(offset))
                self.metrics |= {"search_places": count, "found_beside_m": beside}
                return offset
            # The peg may be held a little higher or lower than estimated, and slide in the fingers.
            rim = height if count == 1 else min(rim, height)
            lowest = min(lowest, rim)
            start = rim + _HOP_M
        yield from arm.relax()
        raise Failure(
            "NOT_FOUND",
            f"none of {count} positions within {1e3 * ports.radius:.1f} mm admits the peg",
            places=count,
            radius_m=ports.radius,
        )

    def _probe(
        self, bottom: Pose, offset: Vector, start: float, rim: float, force: float, grip: Grip
    ) -> Generator[float | None, None, float]:
        """Lower the peg at an offset; returns its height, m, at contact or in the hole.

        Args:
            bottom: Pose of the tool in the world with the peg at its goal.
            offset: Offset from there, of shape (2,), m.
            start: Height from which it is lowered, m.
            rim: Lowest height of the rim, m: well below it, the peg is in the hole.
            force: Contact force, N.
            grip: Monitor of the grip.
        """
        high = _moved(bottom, offset, start)
        deep = _moved(bottom, offset, rim - 2.0 * _IN_M)
        down_speed = self.ports.down_speed
        for _ in range(_FALSE):
            yield from self._hop(high, grip)
            yield from guarded_descent(self.arm, deep, down_speed, force, grip.look, lightly=True)
            if self._height(bottom) < start - _HIGH_M:
                break  # otherwise the friction of a joint was taken for a contact
        return self._height(bottom)

    def _hop(self, pose: Pose, grip: Grip) -> Iterator[float]:
        """Move up, then sideways, without contact."""
        arm = self.arm
        here = self.arm.commanded_tool_pose
        up = Pose(np.array((*here.position[:2], pose.position[2])), here.quaternion)
        for start, end in ((here, up), (up, pose)):  # compliant while the peg still touches the rim
            if start.distance(end) < 1e-6:
                continue
            motion = arm.begin(
                arm.time_path(arm.line_on(end), 0.3), may_touch=True, compliant=start is here
            )
            while not motion.done:
                yield 0.5
                arm.check()
                grip.look()

    def _push_down(self, bottom: Pose, grip: Grip) -> Iterator[float | None]:
        """Push to the bottom, once: a second push would make a stuck peg slide in the fingers."""
        arm = self.arm
        ports = self.ports
        push = grip.firm_for(ports.push)
        low = _moved(bottom, np.zeros(2), -ports.tolerance)
        near = _moved(bottom, np.zeros(2), _NEAR_BOTTOM_M)
        felt, most = yield from guarded_descent(
            arm,
            low,
            ports.down_speed,
            push,
            grip.look,
            near=near if self._height(bottom) > 2.0 * _NEAR_BOTTOM_M else None,
            ignore=frozenset({ports.object}),
        )
        if not felt:
            raise Failure("NO_CONTACT", "no bottom was detected at the full depth of the peg")
        yield from arm.relax()
        height = self._height(bottom)
        self.metrics |= {"push_n": most, "height_off_m": height}
        if height > ports.tolerance:
            raise Failure(
                "JAMMED",
                f"the peg stuck {1e3 * height:.1f} mm before it was fully inserted",
                height_off_m=height,
                force_n=most,
            )

    def _height(self, bottom: Pose) -> float:
        return float(self.arm.tool_pose.position[2] - bottom.position[2])


def _spiral(radius: float, pitch: float) -> Iterator[Vector]:
    """Offsets of the search, of shape (2,), m: outward in a spiral, then again between those.

    The second pass helps where friction kept the peg off a position in the first. The offsets form
    a sunflower spiral, which has uniform density (Vogel, Math. Biosci. 1979).
    """
    count = 1 + int((radius / pitch) ** 2)
    for turn in range(_PASSES * count):
        number = turn % count + turn // count / _PASSES
        angle = number * _GOLDEN
        yield pitch * np.sqrt(number) * np.array((np.cos(angle), np.sin(angle)))


def _moved(pose: Pose, beside: Vector, height: float) -> Pose:
    """Pose translated in the world: sideways by ``beside``, of shape (2,), and up; m."""
    return Pose(pose.position + np.array((*beside, height)), pose.quaternion)
