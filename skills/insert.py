"""Put a peg that the gripper holds into its hole, by touch."""

from __future__ import annotations

from collections.abc import Generator, Iterator

import numpy as np

from bt_dualarm import (
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
)

_CLEAR_M = 0.004  # above the rim, from where it is lowered
_HOP_M = 0.0015  # by which it is raised from one place of the search to the next
_HIGH_M = 0.001  # above the rim: that was no touch
_FALSE = 3
_PASSES = 2  # of the search, the second between the places of the first
_IN_M = 0.0025  # below the rim: it is in the hole
_STARTS = 3  # branches of the inverse kinematics that a plan may choose from
_TRIES = 12  # branches that are looked at, until none counts as free
_GOLDEN = np.pi * (3.0 - np.sqrt(5.0))


class Insert(Skill):
    """Put a peg that the gripper holds into its hole: lower, search in a spiral, push down."""

    class Ports(PortModel):
        object: ObjectName = port(..., "peg; the gripper must hold it")
        at: CarriedPose = port(..., "pose of the peg when it is all the way in")
        depth: float = port(0.03, "how deep it is in then", unit="m", ge=0.005, le=0.3)
        radius: float = port(0.0018, "how far the hole may be off", unit="m", ge=0, le=0.02)
        pitch: float = port(
            0.00018, "distance of neighbouring places of the search", unit="m", ge=1e-4, le=0.005
        )
        force: float = port(6.0, "force by which the rim is felt", unit="N", ge=1, le=100)
        push: float = port(12.0, "force by which the bottom is felt", unit="N", ge=1, le=200)
        tolerance: float = port(
            0.003, "largest distance from the bottom at the end", unit="m", ge=1e-4, le=0.05
        )
        angle_tolerance: Angle = port(
            5.0, "largest turn of the peg at the end, as far as one can be seen", ge=0.1, le=90
        )
        speed: Speed = port(0.3, "share of the arm's limits on the way there")
        down_speed: Speed = port(0.003, "share of the arm's limits where it may touch")

    failures = {
        "NOT_HELD": "the gripper does not hold the peg",
        "NO_CONTACT": "no bottom was felt in the hole",
        "NOT_FOUND": "no place of the search lets the peg in",
        "JAMMED": "the peg stuck before it was all the way in",
        "SLIPPED": "the peg slid between the fingers",
        "DROPPED": "the peg was lost",
        "NOT_INSERTED": "the peg is not where the arm believes it to be: it moved in the hand",
    }
    example = (
        "insert: {object: cube, at: {xyz: [0.25, -0.45, 0.425], rpy: [0, 0, 0]}, depth: 0.012}"
    )
    needs = ("scipy.interpolate",)
    needs_gripper = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Go above, feel for the rim, search, push down, look how deep it is."""
        arm, name = self.arm, self.ports.object
        held = arm.world.attachments.find(arm.name, name)
        if held is None or name not in arm.gripper.held:
            raise Failure("NOT_HELD", f"{arm.name} does not hold {name!r}")
        in_tool = arm.robot.tool.inverse @ held.relative
        goal = self.ports.at.pose_from(arm.commanded_tool_pose @ in_tool)
        bottom = goal @ in_tool.inverse
        grip = Grip(arm, name)
        try:
            yield from self._go_above(bottom, grip)
            place = yield from self._find(bottom, grip)
            yield from self._push_down(_moved(bottom, place, 0.0), grip)
        except Failure as failure:
            if failure.code == "SLIPPED":
                yield from grip.judge(failure)
            raise
        self._score(name, goal)

    def _score(self, name: str, goal: Pose) -> None:
        """Look where the peg truly is: no sensor tells how it is turned, or slid, in the hand.

        Beside its goal it may be by as much as the hole may be off.

        Raises:
            Failure: ``NOT_INSERTED``.
        """
        if name not in self.arm.world.objects:
            raise Failure("NOT_INSERTED", f"object {name!r} was taken out of the world")
        ports, spec = self.ports, self.arm.world.objects[name]
        true = self.arm.world.object_pose(name)
        off = true.position - goal.position
        beside = float(np.linalg.norm(off[:2]))
        turned = KnownShape(spec.shape, spec.size).angle(true, goal)
        self.metrics |= {"inserted_error_m": true.distance(goal), "inserted_turned_rad": turned}
        if (
            abs(off[2]) > ports.tolerance
            or beside > ports.radius + ports.tolerance
            or turned > ports.angle_tolerance
        ):
            raise Failure(
                "NOT_INSERTED",
                f"{name!r} is {1e3 * beside:.1f} mm beside and {1e3 * off[2]:.1f} mm above its "
                f"place in the hole, turned by {np.degrees(turned):.1f}°",
                beside_m=beside,
                height_off_m=float(off[2]),
                turned_rad=turned,
            )

    def _go_above(self, bottom: Pose, grip: Grip) -> Iterator[float]:
        """Go to above the hole, in a branch in which the arm gets down to its bottom from there."""
        arm, ports = self.arm, self.ports
        for progress in arm.past_others(ports.speed).along(lambda: self._plan_above(bottom)):
            yield 0.3 * (progress or 0.0)
            grip.look()

    def _plan_above(self, bottom: Pose) -> Generator[None, None, Trajectory]:
        arm, ports, peg = self.arm, self.ports, frozenset({self.ports.object})
        above = _moved(bottom, np.zeros(2), ports.depth + _CLEAR_M)
        deepest = _moved(bottom, np.zeros(2), -ports.tolerance)
        starts: list[Vector] = []
        refusals: list[Failure] = []
        for down, _ in arm.lines(above, bottom, deepest):
            try:
                arm.refuse_collision(down[-1], ignore=peg)  # fingers too low on it
            except Failure as failure:
                refusals.append(failure.with_traceback(None))  # that refers to this frame
            else:
                starts.append(down[0])
            yield
            if len(starts) == _STARTS or len(refusals) == _TRIES:
                break
        if not starts:
            raise refusals[0]
        return (yield from arm.plan(starts, ports.speed))

    def _find(self, bottom: Pose, grip: Grip) -> Generator[float | None, None, Vector]:
        """Where the peg goes in: by hops, outwards in a spiral; (2,), m from where it should."""
        arm, ports = self.arm, self.ports
        force = grip.firm_for(ports.force)
        rim, count = ports.depth, 0  # height of the tool above its place at the bottom
        for count, place in enumerate(_places(ports.radius, ports.pitch), start=1):
            height = yield from self._feel(bottom, place, rim, force, grip)
            if height < rim - _IN_M:
                beside = float(np.linalg.norm(place))
                self.metrics |= {"search_places": count, "found_beside_m": beside}
                return place
            rim = min(rim, height)  # it may have slid in the fingers a little
        yield from arm.relax()
        raise Failure(
            "NOT_FOUND",
            f"none of {count} places within {1e3 * ports.radius:.1f} mm lets the peg in",
            places=count,
            radius_m=ports.radius,
        )

    def _feel(
        self, bottom: Pose, place: Vector, rim: float, force: float, grip: Grip
    ) -> Generator[float | None, None, float]:
        """Height at which the peg touches at a place, or to which it goes in, m."""
        high, deep = (_moved(bottom, place, rim + way) for way in (_HOP_M, -2.0 * _IN_M))
        down_speed = self.ports.down_speed
        for _ in range(_FALSE):
            yield from self._hop(high, grip)
            yield from guarded_descent(self.arm, deep, down_speed, force, grip.look, lightly=True)
            if self._height(bottom) < rim + _HIGH_M:
                break  # higher up, friction of a joint was taken for a touch
        return self._height(bottom)

    def _hop(self, pose: Pose, grip: Grip) -> Iterator[float]:
        """Up, and beside, without touching."""
        arm, here = self.arm, self.arm.commanded_tool_pose
        up = Pose(np.array((*here.position[:2], pose.position[2])), here.quaternion)
        for start, end in ((here, up), (up, pose)):  # up it leans on the rim still
            if start.distance(end) < 1e-6:
                continue
            motion = arm.begin(
                arm.time_path(arm.line_on(end), 0.1), may_touch=True, compliant=start is here
            )
            while not motion.done:
                yield 0.5
                arm.check()
                grip.look()

    def _push_down(self, bottom: Pose, grip: Grip) -> Iterator[float | None]:
        """To the bottom, once: pushed anew, a peg that is stuck would slide in the fingers."""
        arm, ports = self.arm, self.ports
        push = grip.firm_for(ports.push)
        low = _moved(bottom, np.zeros(2), -ports.tolerance)
        felt, most = yield from guarded_descent(arm, low, ports.down_speed, push, grip.look)
        if not felt:
            raise Failure("NO_CONTACT", "no bottom was felt where the peg should be all the way in")
        yield from arm.relax()
        height = self._height(bottom)
        self.metrics |= {"push_n": most, "height_off_m": height}
        if height > ports.tolerance:
            raise Failure(
                "JAMMED",
                f"the peg stuck {1e3 * height:.1f} mm before it was all the way in",
                height_off_m=height,
                force_n=most,
            )

    def _height(self, bottom: Pose) -> float:
        return float(self.arm.tool_pose.position[2] - bottom.position[2])


def _places(radius: float, pitch: float) -> Iterator[Vector]:
    """Places of the search, of shape (2,), m: evenly outwards, then once more between those.

    Friction may have held the peg beside a place the first time. They lie as seeds of a sunflower
    do (Vogel, Math. Biosci. 1979).
    """
    count = 1 + int((radius / pitch) ** 2)
    for turn in range(_PASSES * count):
        number = turn % count + turn // count / _PASSES
        angle = number * _GOLDEN
        yield pitch * np.sqrt(number) * np.array((np.cos(angle), np.sin(angle)))


def _moved(pose: Pose, beside: Vector, height: float) -> Pose:
    """A pose, moved in the world: beside of shape (2,), and up; m."""
    return Pose(pose.position + np.array((*beside, height)), pose.quaternion)
