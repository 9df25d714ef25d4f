"""Open or close a door, drawer, lid or lever that the arm holds."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from dataclasses import replace

import numpy as np

from bt_dualarm import (
    Failure,
    Grip,
    HandForce,
    JointName,
    JointPosition,
    MovedPart,
    ObjectName,
    PortModel,
    Pose,
    Skill,
    Speed,
    Vector,
    port,
)

_FELT_S = 0.06  # for which the force has to exceed its limit: a reading may be wrong
_EDGE_S = 0.15  # at the start of a motion, in which the joints of the arm break away
_STILL_M = 0.0005  # motion of the held point in `_STILL_S` below which the joint is blocked
_STILL_S = 0.06
_SETTLES_S = 2.0  # at most, in which friction may keep the part from its goal
_SLIDES_M = 0.03  # motion of an object that is not fixed, at the tool, which ends the attempt
_NEAR = 0.6  # fraction of the tolerance within which it is there: pulled on, it may jump beyond
_PULL_N_M_S = 1e4  # rate at which the pull grows with the distance from the set-point


class Operate(Skill):
    """Move a joint of an object, such as a door or drawer, by the part that the arm holds."""

    class Ports(PortModel):
        object: ObjectName = port(..., "object with the joint")
        joint: JointName = port(..., "joint to move; the arm holds one of the parts that it moves")
        to: JointPosition = port(..., "position of the joint at the end")
        force: float = port(
            40.0,
            "force on the hand, along or across its path, at which it stops",
            unit="N",
            ge=2,
            le=200,
        )
        tolerance: float = port(
            0.005, "largest distance of the held point from its goal", unit="m", ge=5e-4, le=0.1
        )
        speed: Speed = port(0.1, "fraction of the arm's limits")
        tool_speed: float = port(0.12, "highest speed of the tool", unit="m/s", ge=0.005, le=0.5)

    failures = {
        "NOT_HELD": "the arm holds none of the parts that the joint moves",
        "NOT_THERE": "the object is not in the world",
        "INVALID_TARGET": "the object has no such joint, or the position is not in its range",
        "BLOCKED": "the joint does not move any further with the allowed force",
        "FORCE_LIMIT": "the part moves, but needs more than the allowed force",
        "NOT_REACHED": "the joint is not at its goal, although the arm has moved there",
        "OBJECT_MOVED": "the object, which is not fixed, slides or tips instead",
        "SLIPPED": "the part slid between the fingers",
        "DROPPED": "the arm has lost the part",
    }
    example = "operate: {object: cabinet, joint: slide, to: 0.15}"
    needs_held = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Plan the whole path of the handle, follow it softly, compare the joint with the goal."""
        arm = self.arm
        ports = self.ports
        part = MovedPart(arm, ports.object, ports.joint)
        goal = part.target(ports.to)
        if part.name not in arm.held:
            reason = f"{arm.name} holds no part that {ports.joint!r} of {ports.object!r} moves"
            raise Failure("NOT_HELD", reason)
        arm.refuse_shared()
        self._part = part
        self._hand = HandForce(arm)
        self._most_n = 0.0
        self._along = np.zeros(3)
        self._way = float(np.sign(goal - part.position))
        self._last = self.time
        has_gripper = arm.name in arm.world.grippers and part.name in arm.gripper.held
        grip = Grip(arm, part.name) if has_gripper else None
        began = part.position
        yield from arm.think()
        try:
            force = ports.force if grip is None else grip.firm_for(ports.force)
            yield from self._hand.soften()
            for progress in self._move(goal, force, grip):
                yield 0.9 * progress
            yield from self._hand.rest(lambda: self._hold(goal))
            # Without the spring of a soft arm that was behind, the part may have moved back.
            rested = self.time
            while self._away(goal) > _NEAR * ports.tolerance and self.time - rested < _SETTLES_S:
                yield 0.95
                arm.check()
                self._hold(goal)
        except Failure as failure:
            if failure.code == "SLIPPED" and grip is not None:
                yield from grip.judge(failure)
            self._note_moved_object()
            raise
        finally:
            self.metrics["pull_force_n"] = self._most_n
        reached = part.position
        away = self._away(goal)
        self.metrics["joint_error_m"] = away
        self._note_moved_object()
        if part.spec.type == "hinge":
            self.metrics |= {"joint_before_rad": began, "joint_rad": reached}
        else:
            self.metrics |= {"joint_before_m": began, "joint_m": reached}
        if away > ports.tolerance:
            spec = part.spec
            yield from self._hand.rest()  # nothing else would end the pull
            raise Failure(
                "NOT_REACHED",
                f"{part.name} is at {spec.in_words(reached)}, {1e3 * away:.1f} mm of its path from "
                f"{spec.in_words(goal)}",
                away_m=away,
            )

    def _refuse_moved_object(self) -> None:
        """Refuse to go on pulling at an object that slides or tips.

        Raises:
            Failure: ``OBJECT_MOVED``.
        """
        moved = self._part.owner_moved_m
        if moved is not None and moved > _SLIDES_M:
            raise Failure(
                "OBJECT_MOVED",
                f"{self.ports.object} moved by {1e3 * moved:.0f} mm instead of its joint: it is "
                "too light, or the joint is too stiff; another arm may hold it",
                object_moved_m=moved,
            )

    def _note_moved_object(self) -> None:
        """Measure whether the object itself has moved, if it is not fixed."""
        moved = self._part.forget_if_moved(self.ports.tolerance)
        if moved is not None:
            self.metrics["object_moved_m"] = moved

    def _move(self, goal: float, limit: float, grip: Grip | None) -> Iterator[float]:
        """Follow the path of the joint softly from where it is to its goal.

        It waits for other arms that are in the way, but does not move aside for them.

        Raises:
            Failure: ``BLOCKED``, ``FORCE_LIMIT``, ``SLIPPED``, ``DROPPED``; as planning.
        """
        arm = self.arm
        ports = self.ports
        part = self._part
        start = arm.commanded_tool_pose
        path = part.path(goal)
        poses = [moved @ start for moved in path.moves]
        if max(start.distance(pose) for pose in poses) < 1e-5:
            return
        rows = arm.kinematics.follow_on(poses, arm.setpoint.q, changes_posture=True)

        def checked() -> Generator[None, None, None]:
            yield from ()
            path.refuse_contact(arm, rows)

        move = replace(arm.past_others(ports.speed), give_way=False)
        for _ in move.when_clear(checked):
            yield 0.0
            arm.check()
        timed, _ = arm.slow_path(rows, ports.speed, ports.tool_speed, ports.speed)
        motion = arm.begin(timed, may_touch=True, compliant=True)
        began = self._last = self.time
        exceeded: float | None = None
        past = [(self.time, part.position)]
        set_point = self._set_points(start)
        near = _NEAR * ports.tolerance
        while not motion.done or (
            self._away(goal) > near and self.time - began < timed.duration + _SETTLES_S
        ):
            yield motion.progress
            arm.check()
            arm.refuse_when_held_up(motion)
            if grip is not None:
                grip.look()
            self._refuse_moved_object()
            past.append((self.time, part.position))
            while self.time - past[0][0] > _STILL_S:
                past.pop(0)
            self._along = self._direction(poses, motion.progress)
            self._pull_on(set_point() - past[-1][1])
            felt = self._felt(self._along)
            if self.time - began < _EDGE_S or felt <= limit:
                exceeded = None
            elif exceeded is None:
                exceeded = self.time
            if self.time - began >= _EDGE_S:
                self._most_n = max(self._most_n, felt)
            if exceeded is not None and self.time - exceeded > _FELT_S:
                if self._away(goal) <= ports.tolerance:
                    # It is there; a goal near the end of the range presses against the stop.
                    for _ in arm.halt(give_way=True):
                        yield 1.0
                    return
                moved = self._lever * abs(past[-1][1] - past[0][1])
                yield from self._stop(felt, moved)

    def _stop(self, felt: float, moved: float) -> Iterator[float]:
        """Stop, and end the force; always raises."""
        arm = self.arm
        for _ in arm.halt(give_way=True):
            yield 1.0
        for _ in self._hand.rest():
            yield 1.0
        part = self._part
        where = part.spec.in_words(part.position)
        numbers = {"force_n": felt, f"joint_{part.spec.si_unit}": part.position}
        if moved < _STILL_M:
            raise Failure("BLOCKED", f"{part.name} is blocked at {where}: {felt:.0f} N", **numbers)
        raise Failure("FORCE_LIMIT", f"{part.name} needs {felt:.0f} N at {where}", **numbers)

    def _hold(self, goal: float) -> None:
        """Give way sideways, and pull on what has left its goal; once per tick.

        The farther an object that slides is pulled along, the less its joint has moved.

        Raises:
            Failure: ``OBJECT_MOVED``.
        """
        self._refuse_moved_object()
        behind = goal - self._part.position
        is_near = self._lever * abs(behind) <= _NEAR * self.ports.tolerance
        is_firm = self._felt(self._along) > self.ports.force
        self._pull_on(0.0 if is_near or is_firm else behind)

    def _pull_on(self, behind: float) -> None:
        """Give way sideways, and pull along the path; once per tick.

        Softly followed, the part stays behind by what friction takes.

        Args:
            behind: What is left to the position where the joint should be, rad or m.
        """
        self._hand.ease(self._along)
        rate = _PULL_N_M_S * self._lever * self._way * behind
        self.arm.yield_to((self.time - self._last) * rate * self._along)
        self._last = self.time

    def _set_points(self, start: Pose) -> Callable[[], float]:
        """Position of the joint, rad or m, at the arm's last set-point, as a function.

        Args:
            start: Commanded pose of the tool at the present position of the joint.
        """
        spec = self._part.spec
        frame = self.arm.known.pose(self.ports.object).pose
        grasped = start.inverse @ frame @ spec.displacement(self._part.position)
        return lambda: spec.position_of(frame.inverse @ self.arm.commanded_tool_pose @ grasped)

    @staticmethod
    def _direction(poses: list[Pose], progress: float) -> Vector:
        """Unit vector in the world along the path of the tool, of shape (3,)."""
        index = min(int(progress * (len(poses) - 1)), len(poses) - 2)
        step = poses[index + 1].position - poses[index].position
        return np.asarray(step / max(float(np.linalg.norm(step)), 1e-9), float)

    def _felt(self, direction: Vector) -> float:
        """Larger one of the forces against the motion and across it, N, by the fingertips.

        Without them, the force against the motion alone is fitted to the external joint torques,
        relative to the joints' efforts: a full wrench is not observable near a singularity.
        """
        arm = self.arm
        force = self._hand.measured
        if force is not None:
            against = -float(force @ direction)
            return max(against, float(np.linalg.norm(force + against * direction)))
        lever = direction @ arm.world.nominal[arm.name].tool_jacobian_at(arm.q)[:3]
        shares = lever / arm.robot.limits.effort**2
        return -float(shares @ arm.external_torque) / max(float(shares @ lever), 1e-12)

    def _away(self, goal: float) -> float:
        """Distance of the held point along its path from where it is at a joint position, m."""
        return self._lever * abs(goal - self._part.position)

    @property
    def _lever(self) -> float:
        """Motion of the held point per unit of the joint: its distance from a hinge's axis, m."""
        spec = self._part.spec
        if spec.type == "slide":
            return 1.0
        frame = self.arm.known.pose(self.ports.object).pose
        point = frame.inverse.apply(self.arm.tool_pose.position) - np.array(spec.anchor)
        return float(np.linalg.norm(np.cross(spec.direction, point)))
