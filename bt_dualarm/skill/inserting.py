"""Insertion of a held peg: search of its hole by touch, and the push to the bottom."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Generator, Iterator, Mapping
from typing import Final

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.core.errors import Failure, Number
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.skill.grip import Grip
from bt_dualarm.skill.guarded_move import TOUCHDOWN_M_S, guarded_descent, until_contact
from bt_dualarm.skill.skill import unit_vector
from bt_dualarm.spec.node_types import PortModel, port
from bt_dualarm.spec.values import Direction, Speed
from bt_dualarm.trajectory.overlap import OverlappedMotion
from bt_dualarm.trajectory.set_points import TrajectorySource
from bt_dualarm.trajectory.trajectory import Trajectory

# The first touch
_UNSURE_M: Final = 0.0025  # height above the expected rim from which the peg is lowered
_UNLIKELY_M: Final = 0.0015  # height above it above which a contact has to withstand the force
_HIGH_M: Final = 0.0003  # height above the expected rim above which a contact may be a false one
_SAME_M: Final = 0.00015  # distance that a descent covers in vain on the rim
_FALSE: Final = 5  # contacts until one counts that may be false
_DEEP_M: Final = 0.005  # depth below the expected rim at which the first descent ends
_INSIDE_M: Final = 0.0025  # depth below it at which the peg is in the hole

# Hops
_LEARNED_M: Final = 0.0006  # height above the rim up to which the arm learns what lifting takes
_LEARNED_M_S: Final = 0.004  # speed at which it does
_LIFT_M: Final = (0.00012, 0.0003)  # height above the rim at which the peg moves sideways, bounds
_LIFT_DEVIATIONS: Final = 4.0  # the same in standard deviations of the tool about its set-point
_AIR_M: Final = 0.00004  # height of the rising set-point from which the arm is stiff
_SOFT_M: Final = 0.00002  # distance that the set-point sinks before it is compliant
_DIP_M: Final = 0.00014  # depth of the set-point below the rim at the end of a hop
_SUNK_M: Final = 0.00008  # depth of the peg below the rim at which it has begun to enter
_BANDWIDTH: Final = 50.0
"""Bandwidth of the arm in contact, rad/s: 20 N/mm at a UR5's tool. Softer, friction moves the peg
off its position; stiffer, the last 0.1 mm press too hard."""
_HOP: Final = 0.5  # fraction of the limits off the rim; faster, the arms of `rough` shake
_BRISK: Final = 0.5  # fraction of the acceleration and jerk limits of a descent
_OVERLAP_UP: Final = 0.5  # largest fraction of the rise during which it moves sideways already
_OVERLAP_DOWN: Final = 0.8  # largest fraction of the sideways motion during which it sinks already
_HANGS_M: Final = 0.00015  # height above the rim at which friction keeps the peg off it
_BREAKS_AWAY_S: Final = 0.1  # time in which the joints break away at the beginning of a descent
_OFF_RIM_M: Final = 0.00005  # height above the rim above which a descent was free
_FREE_TICKS: Final = 10  # last ticks of a free descent over which compensations are averaged
_TOUCHES: Final = 5  # contacts whose median is the height of the rim
_PASSES: Final = 3  # passes of the search, each between the positions of the ones before

# The push
_ENTER_M: Final = 0.0008  # further depth that shows whether the peg is in the hole
_ENTER_M_S: Final = 0.003  # speed at which it is covered
_ENTER_BEHIND_M: Final = 0.00045  # distance behind the set-point at which it is on the rim
_ENTERED_M: Final = 0.0006  # depth below the rim at which it is in the hole
_IN_HOLE_M_S: Final = 0.008  # highest speed in the hole: 20 N if the peg gets stuck
_NEAR_BOTTOM_M: Final = 0.001  # height above the bottom from which contact is expected
_CALM: Final = 0.3  # fraction of the acceleration and jerk limits of these motions
_STANDS: Final = 0.5  # share of the pushing force, and of the tolerance, that shows the bottom
_PUSH_BANDWIDTH: Final = 40.0  # bandwidth in the hole, whose walls center a soft arm, rad/s
_FRICTION_IN_HOLE: Final = 0.7  # share of the joints' friction that is compensated there
_PUSHES: Final = 4  # attempts to push a peg that gets stuck
_BLEND_S: Final = 0.08  # longest overlap of its parts, s
_LEAVE: Final = 0.1  # fraction of the limits with which a peg that is not in leaves the rim


class InsertingPorts(PortModel):
    """Ports of skills that insert."""

    direction: Direction = port((0.0, 0.0, -1.0), "direction of insertion, world axes")
    depth: float = port(0.03, "depth of the inserted peg in the hole", unit="m", ge=0.005, le=0.3)
    radius: float = port(
        0.0018,
        "position uncertainty of the hole; radius of the search",
        unit="m",
        ge=0,
        le=0.02,
    )
    pitch: float = port(
        0.0004, "distance of neighboring positions of the search", unit="m", ge=1e-4, le=0.005
    )
    force: float = port(
        6.0, "contact force at which the rim is detected first", unit="N", ge=1, le=100
    )
    push: float = port(
        12.0, "contact force at which the bottom is detected", unit="N", ge=1, le=200
    )
    tolerance: float = port(
        0.003, "largest distance from the bottom at the end", unit="m", ge=1e-4, le=0.05
    )
    down_speed: Speed = port(
        0.1, "fraction of the arm's limits where contact is expected, at 2 mm/s at most"
    )


class HoleAxes:
    """Axes of a hole: the one out of it, and two across.

    Args:
        inward: Direction of insertion in the world, of unit length, of shape (3,).

    Attributes:
        out: The opposite direction: heights in the hole are measured along it, m.
        across: Two directions at right angles to it and to each other, of shape (2, 3).
    """

    def __init__(self, inward: Vector) -> None:
        self.out: Final = -inward
        axis = np.eye(3)[int(np.argmin(np.abs(inward)))]
        first = axis - (axis @ inward) * inward
        first /= np.linalg.norm(first)
        self.across: Final[Matrix] = np.array((first, np.cross(self.out, first)))

    def pose(self, bottom: Pose, beside: Vector, height: float) -> Pose:
        """Pose beside the bottom, by an offset of shape (2,), and above it; m."""
        return bottom.shifted(beside @ self.across + height * self.out)

    def offset(self, pose: Pose, bottom: Pose) -> tuple[Vector, float]:
        """Offset of a pose beside the bottom, of shape (2,), and its height above it, m."""
        offset = pose.position - bottom.position
        return self.across @ offset, float(offset @ self.out)


class Inserting:
    """Search of a hole by touch, and insertion of one held peg.

    The first descent ends at the rim of the hole. It shows how high the rim is, and which torques
    compensate the joints' friction and the model errors of the descending arm; a short rise shows
    those of the rising one. Then the peg hops from position to position: up, sideways and down in
    one motion that ends slightly below the rim. With the torques known, the arm need not learn them
    before each contact. It is stiff, and therefore precise, while the peg is in the air, and
    compliant in contact. Where the peg sinks, it follows, and is pushed to the bottom.

    Args:
        arm: Arm whose gripper holds the peg, which is above its hole.
        ports: Ports of the skill.
        peg: Name of the peg.
        grip: Monitor of the peg.
        bottom: Pose of the tool in the world with the peg at its goal.
        metrics: Metrics of the skill, to be filled.

    Attributes:
        failures: Failure codes of inserting and their meaning.
    """

    failures: Final[Mapping[str, str]] = {
        "NO_CONTACT": "no bottom was detected in the hole",
        "NOT_FOUND": "the peg did not enter at any position of the search",
        "JAMMED": "the peg got stuck before it was fully inserted",
        "SLIPPED": "the peg slid between the fingers",
        "DROPPED": "the peg was lost",
    }

    def __init__(
        self,
        arm: Arm,
        ports: InsertingPorts,
        peg: str,
        grip: Grip,
        bottom: Pose,
        metrics: dict[str, Number],
    ) -> None:
        self._arm = arm
        self._ports = ports
        self._peg = frozenset({peg})
        self._axes = HoleAxes(unit_vector(ports.direction))
        self._bottom = bottom
        self._metrics = metrics
        self._grip = grip
        self._compliance = arm.controller.compliance

    def through(self) -> Generator[float | None, None, None]:
        """Search the hole, push the peg in, and check its depth; yields the progress once per tick.

        Raises:
            Failure: ``NOT_FOUND``, ``NO_CONTACT``, ``JAMMED``; as `Grip.look` and motions.
        """
        yield from self._search()
        height = self._height
        self._metrics |= {"height_off_m": height}
        if height > self._ports.tolerance:
            raise Failure(
                "JAMMED",
                f"the peg stuck {1e3 * height:.1f} mm before it was fully inserted",
                height_off_m=height,
                force_n=self._metrics["push_n"],
            )

    def _search(self) -> Generator[float | None, None, None]:
        """Touch the rim, then hop along a spiral until the peg enters."""
        ports = self._ports
        at = np.zeros(2)
        rim = yield from self._first_touch()
        if rim < ports.depth - _INSIDE_M:
            self._metrics |= {"search_places": 1, "found_beside_m": 0.0}
            if (yield from self._push_in(at, ports.depth)):
                return
            rim = self._height  # it is caught at the edge
        yield from self._learn_rise(rim)
        # The peg may be held a little higher or lower than estimated, and slide in the fingers. A
        # single touch may be a joint that sticks above the rim.
        touches = deque([rim] * (_TOUCHES // 2 + 1), _TOUCHES)
        first = rim + _HANGS_M
        count = 1
        places = positions(ports.radius, ports.pitch)[1:]
        first_pass = places[: len(places) // _PASSES]
        others = places[len(first_pass) :]
        # Where friction misleads the hops, each position is touched again, slowly.
        turns = ((first_pass, False), (first_pass, True), (others, False))
        for offset, is_slow in [(one, is_slow) for part, is_slow in turns for one in part]:
            count += 1
            # A peg that slides into the fingers lowers the tool; nothing raises it.
            rim = min(float(np.median(touches)), first)
            height = yield from self._hop(at, offset, rim)
            at = offset
            if is_slow or height > rim + _HANGS_M:
                height = yield from self._touch(offset)
            if height > rim - _SUNK_M:
                touches.append(height)
                continue
            inside = self._measured
            beside = float(np.linalg.norm(inside))
            self._metrics |= {"search_places": count, "found_beside_m": beside}
            if (yield from self._push_in(inside, rim)):
                return
            at, _ = self._axes.offset(self._arm.commanded_tool_pose, self._bottom)
            yield from self._leave(at, rim)
        yield from self._arm.relax()
        raise Failure(
            "NOT_FOUND",
            f"none of {count} positions within {1e3 * ports.radius:.1f} mm admits the peg",
            places=count,
            radius_m=ports.radius,
        )

    def _first_touch(self) -> Generator[float | None, None, float]:
        """Lower the peg at the expected position; returns its height, m, at contact or inside."""
        arm = self._arm
        ports = self._ports
        self._grip.firm_for(ports.force)  # before the peg comes near the rim
        middle = np.zeros(2)
        high = self._at(middle, ports.depth + _UNSURE_M)
        if arm.commanded_tool_pose.distance(high) > 1e-6:
            motion = arm.begin(
                arm.time_path(arm.line_on(high), 0.3),
                may_touch=True,
                compliant=self._compliance.active,
            )
            while not motion.done:
                yield 0.3
                self._check()
        height = yield from self._touch(middle)
        for _ in range(_FALSE):
            if height < ports.depth + _HIGH_M:
                break
            # It may be a joint that sticks: then the next descent goes farther.
            before = height
            yield from arm.relax(stays_compliant=True)
            likely = height < ports.depth + _UNLIKELY_M
            height = yield from self._touch(middle, lightly=likely)
            if height > before - _SAME_M:
                break
        self._rising = self._descending  # until a rise shows what it takes
        return height

    def _touch(self, at: Vector, *, lightly: bool = True) -> Generator[float | None, None, float]:
        """Lower the peg slowly until contact, and learn which torques a descent takes.

        Args:
            at: Position relative to the goal, of shape (2,), m.
            lightly: As `guarded_descent`.

        Returns:
            Its height at contact or inside, m.
        """
        ports = self._ports
        began = self._arm.time
        descent: list[tuple[float, Vector]] = []

        def look() -> None:
            self._grip.look()
            if self._arm.time - began > _BREAKS_AWAY_S:
                descent.append((self._height, self._compliance.compensation))

        yield from guarded_descent(
            self._arm,
            self._at(at, ports.depth - _DEEP_M),
            ports.down_speed,
            self._grip.firm_for(ports.force),
            look,
            lightly=lightly,
        )
        self._descending = self._landing = self._compliance.compensation
        # From contact to its detection, the arm begins to take the contact force for friction: 1 N,
        # by which every hop presses harder. An arm that knows its friction poorly needs that, or
        # friction keeps the peg off some positions, which are then passed by.
        free = [torques for height, torques in descent if height > self._height + _OFF_RIM_M]
        if free and not self._arm.world.nominal[self._arm.name].estimates_payload:
            self._landing = np.mean(free[-_FREE_TICKS:], axis=0)
        return self._height

    def _learn_rise(self, rim: float) -> Iterator[float]:
        """Lift the peg slowly, and learn the torques that compensate friction in a rise.

        It also shows how much the tool shakes, and how high it has to be to stay off the rim.

        Args:
            rim: Height of the tool above its goal with the peg on the rim, m.
        """
        arm = self._arm
        high = arm.line_on(self._at(np.zeros(2), rim + _LEARNED_M))
        timed, _ = arm.slow_path(high, 1.0, _LEARNED_M_S, _CALM)
        motion = arm.begin(timed, may_touch=True, compliant=True)
        learned: list[Vector] = []
        behind: list[float] = []
        while not motion.done:
            # The set-point is still below the rim, from which a stiff arm pulls the peg off.
            if self._commanded_height > rim - _LIFT_M[0]:
                self._compliance.active = False
            if self._height > rim + _DIP_M:
                learned.append(self._compliance.compensation)
                behind.append(self._commanded_height - self._height)
            yield 0.3
            self._check()
        self._rising = np.mean(learned, axis=0) if learned else self._compliance.compensation
        shakes = float(np.std(behind)) if behind else 0.0
        self._lift = float(np.clip(_LIFT_DEVIATIONS * shakes, *_LIFT_M))

    def _hop(self, start: Vector, end: Vector, rim: float) -> Generator[float | None, None, float]:
        """Move from one position of the search to another; returns the height there, m.

        Args:
            start: Position before, relative to the goal, of shape (2,), m.
            end: Position after.
            rim: Height of the tool above its goal with the peg on the rim, m.
        """
        arm = self._arm
        compliance = self._compliance
        in_contact = compliance.active
        rise = Trajectory.rest(arm.setpoint.q, arm.period)
        high = self._commanded_height
        if in_contact:
            high = rim + self._lift
            rise = arm.time_path(arm.line_on(self._at(start, high)), _HOP)
            compliance.soften(bandwidth=_BANDWIDTH, compensation=self._rising)
        aside = arm.line_after(rise.end, self._at(end, high))
        down = arm.line_after(aside[-1], self._at(end, rim - _DIP_M))
        shift = arm.time_path(aside, _HOP)
        lower, _ = arm.slow_path(down, self._ports.down_speed, TOUCHDOWN_M_S, _BRISK)
        whole = OverlappedMotion.of(rise)
        whole = arm.overlapped(whole, shift, _HOP, _OVERLAP_UP * rise.duration, self._peg)
        whole = arm.overlapped(whole, lower, _HOP, _OVERLAP_DOWN * shift.duration, self._peg)
        shifted_s = whole.ends_s[1]
        motion = arm.begin(whole.motion, may_touch=True, compliant=in_contact)
        while not motion.done:
            height = self._commanded_height
            if motion.parameter.s >= shifted_s:
                if height < rim + self._lift - _SOFT_M and not compliance.active:
                    compliance.soften(bandwidth=_BANDWIDTH, compensation=self._landing)
            elif height > rim + _AIR_M:
                compliance.active = False
            yield 0.5
            self._check()
        return self._height

    def _push_in(self, at: Vector, rim: float) -> Generator[float | None, None, bool]:
        """Follow the peg into the hole, and push it to the bottom.

        The arm moves to the position that it has measured, so that it does not press on a wall. A
        peg that gets stuck is relieved of all forces, which moves it off the wall, and pushed again
        from there.

        Args:
            at: Position relative to the goal, of shape (2,), m.
            rim: Height of the tool above its goal with the peg on the rim, m.

        Returns:
            Whether the peg was in the hole; otherwise it is on the rim.

        Raises:
            Failure: ``NO_CONTACT`` with the bottom.
        """
        arm = self._arm
        ports = self._ports
        push = self._grip.firm_for(ports.push)
        low = min(rim - ports.depth, 0.0) - ports.tolerance
        near = max(rim - ports.depth + _NEAR_BOTTOM_M, low)
        is_in = False
        for _ in range(_PUSHES):
            enter = max(self._commanded_height - _ENTER_M, low)
            rows = arm.line_on(self._at(at, enter))
            timed, top = arm.slow_path(rows, ports.down_speed, _ENTER_M_S, _CALM)
            whole = OverlappedMotion.of(timed)
            for height, speed, most_m_s in (
                (near, 1.0, _IN_HOLE_M_S),
                (low, ports.down_speed, TOUCHDOWN_M_S),
            ):
                if height < enter:
                    rows = arm.line_after(rows[-1], self._at(at, height))
                    timed, top = arm.slow_path(rows, speed, most_m_s, _CALM)
                    whole = arm.overlapped(whole, timed, _CALM, _BLEND_S, self._peg)
            self._compliance.soften(bandwidth=_PUSH_BANDWIDTH, compensation=self._pushing)
            motion = arm.begin(whole.motion, may_touch=True, compliant=True)
            if not is_in:
                is_in = yield from self._enter(motion, whole.ends_s[0], rim)
                if not is_in:
                    return False
            felt, most = yield from until_contact(
                arm,
                motion,
                whole.motion.duration,
                -self._axes.out,
                top,
                push,
                self._grip.look,
            )
            stands = not felt and self._stands_on_bottom(most, push)
            if not felt and not stands:
                how = f"with {most:.3g} of the {push:.3g} N of `push` at most"
                if most > push:
                    how = f"with {most:.3g} N, and what stopped it yielded"
                raise Failure(
                    "NO_CONTACT",
                    f"no bottom was detected at the full depth of the peg: it was pushed {how}",
                    force_n=most,
                    height_off_m=self._height,
                )
            self._metrics |= {"push_n": most}
            yield from arm.relax()
            if stands or self._height <= near:
                break
            at = self._measured
        return True

    def _enter(
        self, motion: TrajectorySource, until_s: float, rim: float
    ) -> Generator[float | None, None, bool]:
        """Follow the beginning of a push; returns whether the peg is in the hole.

        Args:
            motion: Running motion.
            until_s: Time of the motion as planned at which the peg has to be in the hole, s.
            rim: Height of the tool above its goal with the peg on the rim, m.
        """
        while motion.parameter.s < until_s:
            yield 0.6
            self._check()
            behind = self._height - self._commanded_height
            if behind > _ENTER_BEHIND_M and self._height > rim - _ENTERED_M:
                break
        if self._height <= rim - _ENTERED_M:
            return True
        yield from self._arm.halt()
        return False

    def _leave(self, at: Vector, rim: float) -> Iterator[float]:
        """Lift a peg that is not in the hole, but may be caught at its edge."""
        arm = self._arm
        rows = arm.line_on(self._at(at, rim + self._lift))
        self._compliance.soften(bandwidth=_BANDWIDTH, compensation=self._rising)
        motion = arm.begin(arm.time_path(rows, _LEAVE), may_touch=True, compliant=True)
        while not motion.done:
            yield 0.5
            self._check()
        self._compliance.active = False

    def _stands_on_bottom(self, most: float, push: float) -> bool:
        """Whether something holds the peg up at its goal, as the soft arm pushes its hardest.

        A weak arm does not reach the force that counts as contact within the tolerance.

        Args:
            most: Largest force that was felt, N.
            push: Force that counts as contact, N.
        """
        tolerance = self._ports.tolerance
        held_up = self._height - self._commanded_height
        return (
            most >= _STANDS * push
            and held_up >= _STANDS * tolerance
            and abs(self._height) <= tolerance
        )

    @property
    def _pushing(self) -> Vector:
        """Torques that compensate less friction than in a descent, of shape (dof,), N m.

        At the bottom friction no longer opposes the motion: what compensated it would press.
        """
        middle = 0.5 * (self._descending + self._rising)
        return middle + _FRICTION_IN_HOLE * (self._descending - middle)

    def _check(self) -> None:
        self._arm.check()
        self._grip.look()

    def _at(self, beside: Vector, height: float) -> Pose:
        """Pose of the tool in the world, off its goal: beside, of shape (2,), and above; m."""
        return self._axes.pose(self._bottom, beside, height)

    @property
    def _measured(self) -> Vector:
        """Position of the tool beside its goal, from the encoders, of shape (2,), m."""
        return self._axes.offset(self._arm.tool_pose, self._bottom)[0]

    @property
    def _height(self) -> float:
        """Height of the tool above its goal, from the encoders, m."""
        return self._axes.offset(self._arm.tool_pose, self._bottom)[1]

    @property
    def _commanded_height(self) -> float:
        return self._axes.offset(self._arm.commanded_tool_pose, self._bottom)[1]


def positions(radius: float, pitch: float) -> list[Vector]:
    """Positions of a search from inside to outside, then again between those, and once more.

    They form a triangular lattice, which covers the plane with the fewest circles (Kershner, The
    number of circles covering a set, Amer. J. Math. 1939): no point is farther than
    ``pitch / sqrt(3)`` from one of them. One ring follows the other, so that neighbors come after
    each other. Further passes help where friction kept the peg off a position.

    Args:
        radius: Largest distance from the center, m.
        pitch: Distance of neighbors, m.

    Returns:
        Offsets from the center, each of shape (2,), m; the center first.
    """
    corners = [np.array((np.cos(angle), np.sin(angle))) for angle in np.arange(7) * np.pi / 3.0]
    rings = int(np.ceil(radius / (pitch * np.cos(np.pi / 6.0)))) + 1
    lattice = [np.zeros(2)]
    for ring in range(1, rings + 1):
        for first, second in itertools.pairwise(corners):
            lattice += [pitch * ((ring - i) * first + i * second) for i in range(ring)]
    between = pitch / np.sqrt(3.0) * np.array((np.cos(np.pi / 6.0), np.sin(np.pi / 6.0)))
    shifts = [number * between for number in range(_PASSES)]
    return [
        at + shift
        for shift in shifts
        for at in lattice
        if float(np.linalg.norm(at + shift)) <= radius + 1e-9
    ]
