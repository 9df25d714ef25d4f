"""Placing: lower until contact, release, retreat, and test whether the object came along."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
import scipy

from bt_dualarm.arm.arm import Arm
from bt_dualarm.arm.branches import MOST_BRANCHES, beginning_at
from bt_dualarm.arm.known_objects import Released
from bt_dualarm.arm.past_others import PastOthers
from bt_dualarm.collision.checker import Contact
from bt_dualarm.collision.support import MARGIN_M, Support, support_below
from bt_dualarm.core.errors import Failure, Number
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.core.rotations import from_rotation_vectors, product
from bt_dualarm.planning.path_search import Planner
from bt_dualarm.sim.grippers import Attachment
from bt_dualarm.sim.object_body import body_of
from bt_dualarm.sim.world import World
from bt_dualarm.skill.grip import Grip
from bt_dualarm.skill.guarded_move import guarded_descent, until_contact
from bt_dualarm.skill.left_standing import LeftStanding
from bt_dualarm.skill.retreat import RetreatTo, is_beyond, plan_retreat, possible_retreats
from bt_dualarm.skill.symmetry import goals_alike, poses_alike
from bt_dualarm.spec.node_types import PortModel, port
from bt_dualarm.spec.values import Angle, Duration, Speed
from bt_dualarm.trajectory.overlap import OverlappedMotion
from bt_dualarm.trajectory.trajectory import Trajectory

_UP: Final = np.array((0.0, 0.0, 1.0))

_MEANT_RAD: Final = np.radians(20.0)
"""Tilt up to which an object is set down on the side that is nearest to being down."""

_TIPS_RAD: Final = np.radians(2.0)
"""Tilt from which a goal without an orientation is leveled: noise tilts objects by less."""

_NEARING_M_S: Final = 0.02
"""Highest speed at a height at which contact is possible, but not expected, m/s: 50 N at most."""

_NARROWER_M: Final = 0.005  # opening below the object's width to which the fingers close
_MET_M: Final = 0.0025  # opening above that at which they have met the object
_LASTS_S: Final = 0.05  # required duration of the hold: a drive pushes before its fingers move
_BOUNCES_S: Final = 1.0  # further time for fingers that bounce off an object to come to rest
_FEELS_S: Final = 0.25  # time in addition to the closing time; a vacuum reaches 86 % after 0.1 s


def came_along(
    arm: Arm, held: Attachment, width: float, object_pose: Pose
) -> Generator[float, None, bool]:
    """Test with the gripper, clear of the released object, whether that sticks to it.

    An object that sticks to a pad is still between the pads: these close with their minimum force
    to a little less than its width, and either touch it or not. A cup applies its vacuum again: an
    object on its lip seals. Weight is a weaker sign, since joint friction and model errors amount
    to 2 N in `lab`. An object that hangs elsewhere on the hand is not detected.

    The gripper is left in its final state. If the placed object still reaches between the pads,
    nothing is tested. Yields once per tick.

    Args:
        arm: Arm whose gripper has released the object.
        held: Attachment before the release.
        width: Opening of the fingers when they held it, m.
        object_pose: Pose in the world at which it was released.

    Returns:
        Whether something is in the gripper.
    """
    gripper = arm.gripper
    description = arm.gripper.description
    if held.object not in arm.world.objects or not is_beyond(arm, held.object, object_pose):
        return False
    if description.fingers:
        goal = max(width - _NARROWER_M, 0.0)
        if width - goal <= _MET_M + description.resolution:
            return False  # too thin to be detected
        gripper.command(goal, force=description.force.least)
        lasts = _FEELS_S + 2.0 * (gripper.width - goal) / description.speed.most
    else:
        gripper.command(0.0, force=min(gripper.commanded.force, held.most_force))
        goal = 0.0
        lasts = _FEELS_S
    began = arm.time
    since = arm.time
    while True:
        is_open = bool(description.fingers) and gripper.width > goal + _MET_M
        if arm.time - began > (lasts + _BOUNCES_S if is_open else lasts):
            return is_open
        if description.fingers and not is_open:
            return False  # what sticks to a pad would have stopped the fingers at its width
        if not gripper.holding:
            since = arm.time
        elif arm.time - since >= _LASTS_S:
            return True
        yield 1.0


LEAST_ROOM_M: Final = 0.0015
"""Least opening on each side of the object at its release, where there is room for it, m."""

_BEGINS_M: Final = 0.00075
"""Opening on each side of it at which the retreat begins: that rises by 0.3 mm in its first 0.05 s,
in which the fingers open farther."""

_ROOMS: Final = (0.01, 0.007, 0.005, 0.0035, 0.0025, LEAST_ROOM_M)
"""Openings on each side of it at the release, the preferred one first, m: fingers that open into a
wall press against it, and would drag it along as they retreat."""
_TIGHT_M: Final = 0.0008
"""Opening on each side of it where there is no room for `LEAST_ROOM_M`."""

_LOOSE_M: Final = 0.0005
"""Opening on each side of it with which fingers that a wall stops can leave it as well."""

_FREE_M: Final = 0.0055  # height above the goal down to which the path must be free
_LEARNED_S: Final = 0.1  # time for a compliant arm to learn its friction before contact
_BEHIND_M: Final = 0.001  # distance behind its set-point at which the tool has made contact

_EXPECTED_M_S: Final = 0.002
"""Highest speed where contact is expected, m/s."""

_SURE_M: Final = 0.00055
"""Height above the expected contact from which it may occur: a declared pose may be off by half a
millimeter."""

_SAME_SURE_M: Final = 0.0002
"""The same for an object that is to stand on what it stood on when it was picked: the arm touches
it within 0.1 mm of where it expects it, in `lab` and `rough`."""

_AS_STOOD_RAD: Final = np.radians(2.0)
"""Largest angle between the upward axes of an object for it to stand as it stood."""

_NEARING_S: Final = 0.05
"""Increase of height over that of the highest speed, s: a contact is the less likely, and may be
the harder, the higher it is above the expected one."""

_LIKELY_M: Final = 0.001
"""Distance below the goal down to which the descent is one motion with what is above it."""

_BLEND_S: Final = 0.1
"""Longest overlap of that motion with the search for a support farther down, s."""

_EXPECTED_M: Final = 0.0007
"""Distance from the goal within which a short stop counts as contact: the tool moves smoothly
there, at least half as far as its set-point in each 0.06 s, even with the friction of `rough`."""

_ABOVE_M: Final = 0.008
"""Height above the goal below which the descent is straight: the motion before it has ended. A
compliant arm that still moves sideways 6 mm above it ends 0.5 mm off in `rough`."""

LOWEST_M: Final = 0.008  # minimum height above the goal at which the descent begins
_CLEAR_M: Final = 0.003  # clearance to the height at which the descent is still free
_LOWER: Final = (0.7, 0.5, 0.35, 0.25)  # fractions of the height to try if it is not free
_NEAR_M: Final = 0.0015  # height above the goal beyond which a contact may be joint friction
_AS_EXPECTED_M: Final = 0.05  # distance, and angle, from a pose expected when the grasp was chosen
_AS_EXPECTED_RAD: Final = 0.3  # up to which its configuration is tried
_FALSE: Final = 3  # further descents before a contact beyond that height counts

_ON_CARRIER_N: Final = 1.5  # contact force on a carrier in another arm's hand
_ON_CARRIER_M: Final = 0.001
"""Distance below a carrier in another arm's hand at which the object is released, whether contact
was detected or not: a tray gives way there under hardly more than the object's weight."""

_OFF_M: Final = 0.003  # length of the compliant start of the retreat
_SAME_RAD: Final = 0.02  # rotation of the tool up to which it is still on its retreat
_LOWERING: Final = (0.8, 0.45, 0.3)  # fractions of the speed below the approach height
SEARCH_M: Final = 0.015  # default depth of the search for a support below the goal
_TOLERANCE_M: Final = 0.008  # default of the largest error
_HEADING_RAD: Final = np.radians(15.0)  # steps of the headings to try where any will do
_SAME_HEADING: Final = 1e-3  # rotation that makes no difference to a heading, rad
_BRANCHES: Final = 3  # free branches of the inverse kinematics among which the planner chooses
_EFFORT: Final = 2  # time to check a free one, in those of one that is refused: two take 8 ms


class SettingDownPorts(PortModel):
    """Ports of skills that place."""

    height: float = port(
        0.05,
        "height above the goal at which the descent begins, or less",
        unit="m",
        ge=0.01,
        le=0.3,
    )
    force: float = port(
        5.0, "contact force at which the support is detected", unit="N", ge=1, le=100
    )
    search: float = port(
        SEARCH_M,
        "distance below the goal down to which the support is searched",
        unit="m",
        ge=0.001,
        le=0.1,
    )
    retreat: float = port(0.08, "length of the retreat", unit="m", ge=0.01, le=0.3)
    tolerance: float = port(
        _TOLERANCE_M,
        "largest height error at contact, and largest position error at the end",
        unit="m",
        ge=1e-3,
        le=0.1,
    )
    angle_tolerance: Angle = port(
        5.0, "largest rotation error at the end, up to the object's symmetry", ge=0.1, le=90
    )
    settle: Duration = port(2.0, "longest time to come to rest", gt=0, le=30)
    speed: Speed = port(0.5, "fraction of the arm's limits up to the descent")
    down_speed: Speed = port(
        0.1, "fraction of the arm's limits where contact is expected, at 2 mm/s at most"
    )
    planner: Planner = port("RRTConnect", "planner to use if the straight path is blocked")


@dataclass(frozen=True, eq=False)
class _Descent:
    """Planned descent to a pose of the tool.

    Attributes:
        goal: Pose of the object in the world.
        tool: Pose of the tool in the world with the object at its goal.
        height: Height above that at which the descent begins, m.
        branches: Configurations down to near the goal, of shape (n, dof), rad, for each feasible
            branch of the inverse kinematics; the preferred one first.
        turned: Rotation of the object from its goal into itself, rad.
    """

    goal: Pose
    tool: Pose
    height: float
    branches: list[Matrix]
    turned: float = 0.0


def other_headings(
    world: World,
    name: str,
    goal: Pose,
    frames: Sequence[Pose],
    above: float = _TOLERANCE_M,
    below: float = SEARCH_M,
) -> Iterator[Pose]:
    """Poses of an object rotated about the vertical from a goal, up to its symmetry.

    First those in which one of some frames is in line with what the object will stand on: between
    the walls of a bin, hand or object may fit in no others. Then the multiples of 15°, the smallest
    first.

    Args:
        world: World of the arm.
        name: Name of the object.
        goal: Its pose in the world.
        frames: Poses in the world, with the object at the goal, that rotate with it.
        above: Distance above the goal in which a support is looked for, m.
        below: Distance below it, m.
    """
    lined_up: list[float] = []
    support = support_below(world, name, goal, above, below)
    if support is not None:
        for frame in frames:
            axes = frame.rotation_matrix[:2]
            lying = int(np.argmax(np.linalg.norm(axes, axis=0)))
            heading = float(np.arctan2(axes[1, lying], axes[0, lying]))
            lined_up.extend(support.heading - heading + np.arange(4) * (np.pi / 2.0))
    grid = np.arange(1, round(np.pi / _HEADING_RAD) + 1) * _HEADING_RAD
    alike = poses_alike(world.objects[name], goal)
    most = min((0.5 * abs(turn) for turn, _ in alike if turn), default=np.pi)
    for turns in (np.array(lined_up), np.column_stack((grid, -grid)).ravel()):
        wrapped = np.round((turns + np.pi) % (2.0 * np.pi) - np.pi, 6)
        for turn in dict.fromkeys(sorted(wrapped.tolist(), key=abs)):
            if _SAME_HEADING < abs(turn) <= most + _SAME_HEADING:
                rotation = from_rotation_vectors(turn * _UP[None])
                yield Pose(goal.position, product(rotation, goal.quaternion[None])[0])


@dataclass(frozen=True)
class _Expected:
    """Where the held object is expected to touch its support.

    Attributes:
        height: Height of the tool above that with the object at its goal, m.
        sure: Height above that from which contact may occur, m.
    """

    height: float = 0.0
    sure: float = _SURE_M


class SettingDown:
    """Placing of one held object.

    Args:
        arm: Arm whose gripper holds it.
        ports: Ports of the skill.
        held: Attachment of the object.
        metrics: Metrics of the skill, to be filled.
        any_heading: Whether the object may be rotated about the vertical where it cannot be set
            down as its goal says.

    Attributes:
        failures: Failure codes of placing and their meaning.
        goal: Pose of the object in the world that it is lowered to.
    """

    failures: Final[Mapping[str, str]] = {
        "NOT_SUPPORTED": "on the declared support it would tip over, slide or roll away",
        "NOT_REACHED": "what it touched is above its goal, or too far below it",
        "NO_CONTACT": "no support was detected below it",
        "NOT_OPEN": "the fingers did not open",
        "SLIPPED": "the object slid between the fingers during the motion",
        "DROPPED": "the object was lost during the motion",
        "NOT_PLACED": "it is not at its goal at the end: it fell, slid, was moved, sticks to the "
        "gripper, or was not held as estimated",
    }

    def __init__(
        self,
        arm: Arm,
        ports: SettingDownPorts,
        held: Attachment,
        metrics: dict[str, Number],
        *,
        any_heading: bool = False,
    ) -> None:
        self._arm = arm
        self._any_heading = any_heading
        self._ports = ports
        self._metrics = metrics
        self._held = held
        self._name = held.object
        self._in_tool = arm.robot.tool.inverse @ held.relative
        self._force = ports.force
        self._search = ports.search
        self._carrier = ""
        self._contact = _Expected()
        self._room = _ROOMS[0]
        self._needs_room = True
        self._is_cramped = False
        self._opens = False

    def through(self, goal: Pose) -> Generator[float | None, None, Pose]:
        """Move above a pose, lower the object until contact, open, retreat.

        Yields the progress once per tick; returns the estimated pose in the world at the release.

        Args:
            goal: Pose of the object in the world.

        Raises:
            Failure: ``NOT_SUPPORTED`` before it moves, ``NO_CONTACT``, ``NOT_REACHED``,
                ``NOT_OPEN``, ``SLIPPED``, ``DROPPED``; ``NOT_PLACED`` if it sticks to the gripper;
                as motions.
        """
        arm = self._arm
        self.goal = goal
        grip = Grip(self._arm, self._name)
        grip.look()
        began_s = arm.time
        found = self._support_at(goal)
        attachments = arm.world.attachments
        if found is not None and found.carrier:
            self._carrier = found.carrier
            self._force = min(self._force, _ON_CARRIER_N)
            self._search = min(self._search, max(found.below, 0.0) + _ON_CARRIER_M)
            attachments.place_on(arm.name, self._name, self._carrier)
        try:
            yield from self._go_down(goal, grip, began_s)
        except BaseException as failure:
            attachments.place_on(arm.name, self._name, self._held.carrier)
            if isinstance(failure, GeneratorExit) and self._opens:
                self._let_go(grip.width, self._touched @ self._in_tool)
            if isinstance(failure, Failure) and failure.code == "SLIPPED":
                yield from grip.judge(failure)
            raise
        object_pose = self._touched @ self._in_tool
        self._metrics["believed_error_m"] = object_pose.distance(self.goal)
        yield from self._release(grip.width, object_pose)
        return object_pose

    def level(self, goal: Pose) -> Pose:
        """The goal; if the object would tip there, the nearest one in which it stands.

        For a goal without an orientation of its own: an arm that was halted in the middle of a
        motion holds an object tilted, or upside down, as no plan would have ended. It stands on the
        side that is nearly down, otherwise as it stood where the gripper picked it. The
        position is that of the object's frame, or one that follows from its lowest point in the
        tilted pose, such as a goal on something: of both, the one nearer to a support counts. A bar
        that another arm has handed over upright is laid down if the goal has that height.

        Args:
            goal: Pose of the object in the world.
        """
        axes = goal.rotation_matrix
        nearest = int(np.argmax(np.abs(axes[2])))
        with suppress(Failure):
            support = self._support_at(goal)
            # A tilted object may be too high for what it would stand on upright.
            is_upright = np.abs(axes[2, nearest]) > math.cos(_TIPS_RAD)
            if support is None and is_upright:
                return self._on_other_side(goal) or goal
            if support is not None and support.tilt < _TIPS_RAD:
                return goal
        upward = [np.eye(3)[nearest] * np.sign(axes[2, nearest])]
        if self._held.lay is not None:
            is_meant = np.abs(axes[2, nearest]) > math.cos(_MEANT_RAD)
            upward.insert(int(is_meant), self._held.lay.rotation_matrix[2])
        for up in upward:
            found = self._standing(goal, up)
            if found is not None:
                return found
        return self._on_other_side(goal) or goal

    def _on_other_side(self, goal: Pose) -> Pose | None:
        """The goal with another side of the object down, if it stands on that at this height.

        Args:
            goal: Pose of the object in the world, in which it is too tall or not tall enough.

        Returns:
            The pose; None if it stands on no other side.
        """
        axes = goal.rotation_matrix
        others = np.argsort(-np.abs(axes[2]))[1:].tolist()
        upward = [sign * axes[:, axis] for axis in others for sign in (1.0, -1.0)]
        if self._held.lay is not None:  # as it stood before, if that is one of them
            before = goal.turn(self._held.lay.rotation_matrix[2])
            upward.sort(key=lambda up: -round(float(up @ before), 3))
        for up in upward:
            turn, _ = scipy.spatial.transform.Rotation.align_vectors(_UP, up)
            pose = Pose.from_rotation(goal.position, turn * goal.rotation)
            with suppress(Failure):
                if self._support_at(pose) is not None:
                    return pose
        return None

    def _standing(self, goal: Pose, up: Vector) -> Pose | None:
        """The goal after the smallest rotation that makes an axis of the object point up.

        Args:
            goal: Pose of the object in the world.
            up: The axis, of shape (3,).

        Returns:
            The pose; None if the object does not stand in that.
        """
        turn, _ = scipy.spatial.transform.Rotation.align_vectors(_UP, goal.turn(up))
        leveled = Pose.from_rotation(goal.position, turn * goal.rotation)
        solid = body_of(self._arm.world.objects[self._name]).solid
        depths = [solid.reach(pose.inverse.turn(-_UP)) for pose in (goal, leveled)]
        found: list[tuple[float, Pose]] = []
        for pose in (leveled, leveled.raised(depths[1] - depths[0])):
            with suppress(Failure):
                support = self._support_at(pose)
                if support is not None:
                    found.append((abs(support.below), pose))
        return min(found, key=lambda one: one[0])[1] if found else None

    def stays_at(self, goal: Pose, within_m: float | None = None) -> Iterator[float]:
        """Wait until the released object rests, and check its true pose, as a referee.

        Yields the progress once per tick.

        Args:
            goal: Pose of the object in the world.
            within_m: Largest position error, m; by default the tolerance of the ports.

        Raises:
            Failure: ``NOT_PLACED``, see `LeftStanding`.
        """
        ports = self._ports
        within = ports.tolerance if within_m is None else within_m
        yield from self._left.until_placed(
            goal, within, ports.angle_tolerance, ports.settle, self._metrics
        )

    def _support_at(self, goal: Pose) -> Support | None:
        """Check that it would rest at the goal, by the shapes that plans use.

        Returns:
            The support; None if none is declared: contact has to show it.

        Raises:
            Failure: ``NOT_SUPPORTED``.
        """
        ports = self._ports
        name = self._name
        found = support_below(self._arm.world, name, goal, ports.tolerance, ports.search)
        if found is None:
            return None
        if found.topples:
            why = (
                "would roll over: in this orientation it stands on a round side, and its center "
                "of mass is not in balance above it; give `at` an orientation in which it lies"
            )
        elif found.rolls:
            why = "would roll away: the support is not level"
        elif found.tilt > ports.angle_tolerance:
            why = (
                f"would tip by {np.degrees(found.tilt):.0f}°: its center of mass is not "
                f"{1e3 * MARGIN_M:.0f} mm or more inside its support polygon"
            )
        elif found.slides:
            why = (
                f"would slide down a slope of {np.degrees(found.slope):.0f}° with a coefficient of "
                f"friction of {found.friction:.2g}"
            )
        else:
            return found
        raise Failure(
            "NOT_SUPPORTED",
            f"{name!r} {why}",
            tilt_rad=found.tilt,
            slope_rad=found.slope,
            friction=found.friction,
        )

    def _expected_contact(self, goal: Pose) -> _Expected:
        """Where the object will touch its support.

        An object that stood on the same thing when the gripper picked it touches that again where
        it left it: what is wrong with its declared or seen height, and with that of the support,
        is the same both times.

        Args:
            goal: Pose of the object in the world.
        """
        lay = self._held.lay
        if lay is None or self._carrier:
            return _Expected()
        up = lay.rotation_matrix[2] @ goal.rotation_matrix[2]
        if up < math.cos(_AS_STOOD_RAD):
            return _Expected()
        stood, stands = (
            support_below(self._arm.world, self._name, pose, _LIKELY_M, _LIKELY_M)
            for pose in (lay, goal)
        )
        if stood is None or stands is None or stood.bodies != stands.bodies:
            return _Expected()
        height = stood.below - stands.below
        return _Expected(height, _SAME_SURE_M) if abs(height) < _LIKELY_M / 2.0 else _Expected()

    def _go_down(self, goal: Pose, grip: Grip, began_s: float) -> Iterator[float | None]:
        """Move above the goal, in a branch that allows descent and retreat, and lower the object.

        It is one motion without a stop, unless other arms are near: then the arm waits above the
        goal until they are out of the way.

        Args:
            goal: Pose of the object in the world.
            grip: Grip on the object.
            began_s: Simulated time at which planning began, s.
        """
        arm = self._arm
        ports = self._ports
        move = arm.past_others(ports.speed)
        descents: list[_Descent] = []
        turned: list[Matrix] = []  # the same descents, with joints rotated by whole turns
        began = [began_s]

        def above() -> Generator[None, None, Trajectory]:
            descents[:] = [(yield from self._descent(goal, move))]
            self._contact = self._expected_contact(descents[0].goal)
            starts = [rows[0] for rows in descents[0].branches]
            turned[:] = arm.turned(descents[0].branches)
            first_s = began.pop() if began else None
            return (
                yield from arm.plan(
                    starts,
                    ports.speed,
                    planner=ports.planner,
                    began_s=first_s,
                    turned=[rows[0] for rows in turned],
                )
            )

        def down(q: Vector) -> Matrix:
            return beginning_at(q, [*descents[0].branches, *turned])

        def whole() -> Generator[None, None, Trajectory]:
            begin = OverlappedMotion.of((yield from above()))
            return self._lowered(begin, down(begin.motion.end), descents[0].tool)

        def rest() -> Generator[None, None, Trajectory]:
            begin = OverlappedMotion.of(Trajectory.rest(arm.setpoint.q, arm.period))
            rows = arm.line_on(descents[0].tool.raised(_FREE_M))
            yield from move.checked(rows, known_free=True)
            return self._lowered(begin, rows, descents[0].tool)

        follow = partial(self._touch_down, grip, lambda: descents[0].tool)
        if not arm.controller.neighbors:
            yield from move.along(whole, follow)
        else:
            for progress in move.to_line(above, lambda: down(arm.setpoint.q)):
                yield 0.3 * (progress or 0.0)
                grip.look()
            yield from replace(move, give_way=False).along(rest, follow)
        (descent,) = descents
        self.goal = descent.goal
        if self.goal is not goal:
            self._metrics["heading_rad"] = goal.angle(self.goal)
        if descent.height < ports.height:
            self._metrics["lowered_from_m"] = descent.height
        if descent.turned:
            self._metrics["spun_rad"] = descent.turned

    def _lowered(self, begin: OverlappedMotion, down: Matrix, tool: Pose) -> Trajectory:
        """A motion and the descent after it: the slower, the nearer contact may be.

        Args:
            begin: Motion to the beginning of the descent.
            down: Configurations from there to `_FREE_M` above the goal, of shape (n, dof), rad.
            tool: Pose of the tool in the world with the object at its goal.
        """
        arm = self._arm
        ports = self._ports
        self._room, _ = self._room_at(arm.line_after(down[-1], tool)[-1], arm.gripper.width)
        low = arm.line_after(down[-1], tool.raised(-min(_LIKELY_M, self._search)))
        rows = np.vstack((down, low[1:]))
        start = float(arm.kinematics.forward(rows[0]).position[2] - tool.position[2])
        self._top = min(_EXPECTED_M_S, arm.least_speed(low, ports.down_speed))

        sure = self._contact.height + self._contact.sure

        def most_m_s(lengths: Vector) -> Vector:
            height = start - lengths
            near = np.clip(self._top + (height - sure) / _NEARING_S, self._top, _NEARING_M_S)
            bound: Vector = np.where(height > _FREE_M, np.inf, near)
            return bound

        def beside(motion: Trajectory) -> float:
            """Time of a descent during which the motion before it may still end, s."""
            return self._time_at(motion, tool, _ABOVE_M)

        # A slower descent may leave more of the limits to the overlap.
        descents = [arm.slowing_path(rows, share * ports.speed, most_m_s) for share in _LOWERING]
        whole = min(
            (arm.overlapped(begin, one, ports.speed, beside(one)) for one in descents),
            key=lambda one: one.motion.duration,
        )
        if self._search <= _LIKELY_M:
            return whole.motion
        # Seconds long, and hardly ever used: alone, it takes a fraction of the computing time.
        rest = arm.line_after(low[-1], tool.raised(-self._search))
        search, _ = arm.slow_path(rest, ports.down_speed, self._top, ports.speed)
        return arm.overlapped(whole, search, ports.speed, _BLEND_S, frozenset({self._name})).motion

    def _time_at(self, motion: Trajectory, tool: Pose, height: float) -> float:
        """Time at which a motion that ends in a descent is the last time above a height, s.

        Args:
            motion: The motion.
            tool: Pose of the tool in the world with the object at its goal.
            height: Height of the tool above that, m.
        """
        lowest = tool.position[2] + height

        def is_below(index: int) -> bool:
            return bool(self._arm.kinematics.matrix(motion.q[index])[2, 3] <= lowest)

        # Above, the tool may rise; where the search ends, it is below.
        step = max(len(motion) // 64, 1)
        first = len(motion) - 1
        while first - step >= 0 and is_below(first - step):
            first -= step
        while first > 0 and is_below(first - 1):
            first -= 1
        return first * motion.dt

    def _touch_down(
        self, grip: Grip, tool: Callable[[], Pose], motion: Trajectory, wait_s: float
    ) -> Iterator[float | None]:
        """Execute the motion of `_lowered` until contact with the support."""
        arm = self._arm
        ports = self._ports
        free_s = self._time_at(motion, tool(), _FREE_M)
        force = grip.firm_for(self._force)
        running = arm.begin(motion)
        # Compliant a little earlier than contact is possible: until then the arm has learned its
        # friction and model errors, for which it would otherwise take the contact force.
        comply_s = max(free_s - _LEARNED_S, 0.0)
        watch = arm.watch(running, until_s=comply_s)
        while running.parameter.s < comply_s:
            yield 0.6 * running.parameter.s / max(comply_s, 1e-9)
            arm.check()
            watch.look(arm.time)
            arm.refuse_when_held_up(running, wait_s)
            grip.look()
        arm.expect_contact()
        down = np.array((0.0, 0.0, -1.0))

        def look() -> None:
            grip.look()
            arm.refuse_when_held_up(running, wait_s)

        def is_expected() -> bool:
            return abs(self._height_of(arm.tool_pose, tool()) - self._contact.height) < _EXPECTED_M

        def touched() -> None:
            self._touched = arm.tool_pose
            # The fingers open while the arm brakes.
            if abs(self._height(tool())) <= min(_NEAR_M, ports.tolerance):
                self._open(grip.width)
                self._opens = True

        felt, most = yield from until_contact(
            arm,
            running,
            motion.duration,
            down,
            self._top,
            force,
            look,
            lightly=True,
            behind_m=_BEHIND_M,
            is_expected=is_expected,
            touched=touched,
        )
        low = tool().raised(-self._search)
        for descents in range(_FALSE, -1, -1):
            if not felt:
                yield from arm.settle()
                found = self._support_at(tool() @ self._in_tool) if self._carrier else None
                if found is not None and found.carrier == self._carrier:
                    touched()
                    height = self._height(tool())
                    break
                why = f"no support was felt {1e3 * self._search:.0f} mm below its goal"
                if self._carrier:
                    why = f"{self._carrier!r} is no longer below it, and {why}"
                raise Failure("NO_CONTACT", why)
            height = self._height(tool())
            if height <= _NEAR_M or not descents:
                break
            felt, next_n = yield from guarded_descent(
                arm, low, ports.down_speed, force, grip.look, lightly=True
            )
            most = max(most, next_n)
            self._touched = arm.tool_pose
        self._metrics |= {"impact_n": most, "height_off_m": height}
        if abs(height) > ports.tolerance:
            yield from arm.relax()
            raise Failure(
                "NOT_REACHED",
                f"it touched something {1e3 * height:.1f} mm above its goal"
                if height > 0.0
                else f"what it touched is {-1e3 * height:.1f} mm below its goal",
                height_off_m=height,
                force_n=most,
            )

    def _descent(self, goal: Pose, move: PastOthers) -> Generator[None, None, _Descent]:
        """Descent to a goal, see `_roomy_descent`.

        Where any heading will do, others are tried after that of the goal.
        """
        try:
            return (yield from self._roomy_descent(goal, move))
        except Failure as failure:
            refusal = failure.with_traceback(None)
        arm = self._arm
        if self._any_heading and not move.may_leave(refusal):
            ports = self._ports
            frames = goal @ self._in_tool.inverse, goal
            within = ports.tolerance, ports.search
            for other in other_headings(arm.world, self._name, goal, frames, *within):
                yield
                with suppress(Failure):
                    self._support_at(other)
                    return (yield from self._roomy_descent(other, move))
        raise refusal

    def _roomy_descent(self, goal: Pose, move: PastOthers) -> Generator[None, None, _Descent]:
        """Descent to a goal, where the fingers can open if possible; see `_any_descent`."""
        self._needs_room = True
        self._is_cramped = False
        try:
            return (yield from self._any_descent(goal, move))
        except Failure:
            if not self._is_cramped:
                raise
        self._needs_room = False
        return (yield from self._any_descent(goal, move))

    def _any_descent(self, goal: Pose, move: PastOthers) -> Generator[None, None, _Descent]:
        """Descent to a goal: as requested, from a lower height, or with a round object rotated.

        The one requested is preferred, then the smallest rotation, then the largest height. If
        another arm that may leave is in the way of the one requested, no lower height is tried for
        it; the arm waits instead. Yields once for each branch that is checked.

        Args:
            goal: Pose of the object in the world.
            move: Motion above the goal.

        Raises:
            Failure: That of the descent requested, see `_branches_down`, if there is no other; that
                of a rotated one, if another arm that may leave is in the way only there.
        """
        height = self._ports.height
        upright = goal @ self._in_tool.inverse
        try:
            return _Descent(
                goal, upright, height, (yield from self._branches_down(upright, height))
            )
        except Failure as failure:
            # A traceback would keep this frame alive.
            refusals = [failure.with_traceback(None)]
        waits = move.may_leave(refusals[0])
        for turned, alike in goals_alike(self._arm.world, self._name, goal):
            if waits and not turned:
                continue
            tool = alike @ self._in_tool.inverse
            yield
            try:
                branches = yield from self._branches_down(tool, LOWEST_M)
                lowest = _Descent(goal, tool, LOWEST_M, branches, turned)
            except Failure as failure:
                refusals.append(failure.with_traceback(None))
                # Every higher descent contains this one. But a redundant arm has endless branches:
                # those tried here need not include the one that is free.
                if not (turned and self._arm.kinematics.dof > 6):
                    continue
                try:
                    branches = yield from self._branches_down(tool, height)
                except Failure:
                    continue
                return _Descent(goal, tool, height, branches, turned)
            for share in (1.0, *_LOWER) if turned else _LOWER:
                try:
                    branches = yield from self._branches_down(tool, share * height)
                    begin = height
                    if share < 1.0:
                        begin = max(share * height - _CLEAR_M, LOWEST_M)
                        branches = yield from self._branches_down(tool, begin)
                except Failure:
                    continue
                return _Descent(goal, tool, begin, branches, turned)
            return lowest
        # Another arm may leave: the requested pose may be beyond reach, but not its equals.
        raise max(refusals, key=lambda one: move.may_leave(one) + move.may_clear(one))

    def _branches_down(self, tool: Pose, height: float) -> Generator[None, None, list[Matrix]]:
        """Straight descent to a pose of the tool, see `_branches_near`.

        Near the set-point, otherwise near the configuration with which the grasp was chosen.
        """
        arm = self._arm
        try:
            return (yield from self._branches_near(tool, height))
        except Failure as failure:
            refusal = failure.with_traceback(None)
        expected = arm.known.goals.get(self._name)
        if expected is not None:
            there = arm.kinematics.forward(expected)
            if there.distance(tool) < _AS_EXPECTED_M and there.angle(tool) < _AS_EXPECTED_RAD:
                yield
                with suppress(Failure):
                    return (yield from self._branches_near(tool, height, expected))
        raise refusal

    def _branches_near(
        self, tool: Pose, height: float, near: Vector | None = None
    ) -> Generator[None, None, list[Matrix]]:
        """Straight descent to a pose of the tool, in branches that allow search and retreat.

        The arm and the held object are collision-free down to `_FREE_M`, and the arm alone on
        the retreat. Branches in which only another retreat is possible, see `_retreats`, count
        where there are no others, or where something rides on the object: an arm that has to keep
        that upright can hardly leave its branch. Yields once per tick, for three to six branches.

        Args:
            tool: Pose of the tool in the world.
            height: Height above it at which the descent begins, m.
            near: Configuration to which the branches are near, as for `Motions.lines`.

        Returns:
            For each branch configurations down to `_FREE_M`, of shape (n, dof), rad; the preferred
            branch first.

        Raises:
            Failure: That of the preferred branch, if there is none: ``IN_COLLISION``,
                ``PATH_BROKEN``, ``SINGULAR``, ``UNREACHABLE`` or ``INVALID_TARGET``.
        """
        arm = self._arm
        held = frozenset({self._name})
        corners = [tool.raised(above) for above in (height, _FREE_M, 0.0, -self._search)]
        found: list[Matrix] = []
        narrow: list[Matrix] = []
        refusals: list[Failure] = []
        retreats = self._retreats(tool)
        effort = 0
        for down, low, _ in arm.lines(*corners, near=near):
            try:
                arm.refuse_collision_along(down)
                self._refuse_without_room(low[-1])
                for retreat in retreats:
                    try:
                        out = arm.line_after(low[-1], retreat.end)
                        arm.refuse_collision_along(out, ignore=held)
                        retreat.refuse_links(arm, out)
                    except Failure:
                        if retreat is retreats[-1]:
                            raise
                    else:
                        (found if retreat is retreats[0] else narrow).append(down)
                        break
                effort += _EFFORT
            except Failure as failure:
                refusals.append(failure.with_traceback(None))
                if arm.is_of_hand(failure):
                    break
                effort += 1
            if len(found) == _BRANCHES or len(refusals) == MOST_BRANCHES:
                break
            if effort >= 3 * _EFFORT:
                effort = 0
                yield
        if narrow and (not found or arm.world.passengers_of(self._name)):
            found = [*found, *narrow]
        if not found:
            raise refusals[0]
        return found[:_BRANCHES]

    def _room_at(self, q: Vector, width: float) -> tuple[float, Contact | None]:
        """Opening on each side of the object with which the fingers touch nothing, from `_ROOMS`.

        Args:
            q: Configuration with the object at its goal, of shape (dof,), rad.
            width: Opening of the fingers around the object, m.

        Returns:
            The opening; if the smallest of them is too wide, `_TIGHT_M`, and what is in its way.
        """
        arm = self._arm
        if not arm.gripper.description.fingers:
            return _ROOMS[0], None
        checker = arm.checker(frozenset({self._name}))
        checker.open_fingers(width)
        if checker.contact(q) is not None:  # so it is not the opening that makes them touch
            return _ROOMS[0], None
        beside: Contact | None = None
        for room in _ROOMS:
            checker.open_fingers(min(width + 2.0 * room, arm.gripper.description.stroke))
            beside = checker.contact(q)
            if beside is None:
                return room, None
        return _TIGHT_M, beside

    def _refuse_without_room(self, q: Vector) -> None:
        """Check that the fingers can leave the object in a configuration of shape (dof,), rad.

        Raises:
            Failure: ``IN_COLLISION`` with what is beside them.
        """
        beside = self._room_at(q, self._arm.gripper.width)[1] if self._needs_room else None
        if beside is not None:
            self._is_cramped = True
            raise beside.failure()

    def _retreats(self, tool: Pose) -> list[RetreatTo]:
        """Retreats from a pose of the tool to try, the one requested first."""
        return possible_retreats(self._arm, tool, self._name, self._in_tool, self._ports.retreat)

    def _height(self, tool: Pose) -> float:
        """Height above a pose at which the tool made contact, from the encoders, m."""
        return self._height_of(self._touched, tool)

    @staticmethod
    def _height_of(pose: Pose, tool: Pose) -> float:
        """Height of a pose above another one, m."""
        return float(pose.position[2] - tool.position[2])

    def _release(self, width: float, object_pose: Pose) -> Iterator[float | None]:
        """Open, retreat, and check that the object did not come along.

        The retreat begins as soon as there is `_BEGINS_M` on each side of the object. An object
        that is still in the gripper is attached again.

        Args:
            width: Opening of the fingers when they held it, m.
            object_pose: Pose of the object in the world at the release.

        Raises:
            Failure: ``NOT_OPEN``; ``NOT_PLACED`` if it sticks to the gripper; as motions.
        """
        arm = self._arm
        self._open(width)
        try:
            yield from self._until_apart(width)
        except GeneratorExit:
            self._let_go(width, object_pose)
            raise
        self._let_go(width, object_pose)
        yield from self._leave(self._retreats(arm.commanded_tool_pose), width, object_pose)

    def _until_apart(self, width: float) -> Iterator[float]:
        """Wait until the fingers, which held the object at ``width`` (m), are clear of it.

        They need not open as far as commanded: a wall beside the object may be in their way. They
        then stop pressing against it, or the retreat would lift it.

        Raises:
            Failure: ``NOT_OPEN``.
        """
        gripper = self._arm.gripper
        if not gripper.description.fingers:
            yield from gripper.until_open()
            return
        has_room = self._room >= LEAST_ROOM_M
        try:
            for _ in gripper.until_open():
                if has_room and gripper.width >= width + 2.0 * _BEGINS_M:
                    return
                yield 0.85
            if has_room:
                return
        except Failure:
            if gripper.width < width + 2.0 * _LOOSE_M:
                raise
        gripper.command(0.5 * (gripper.width + width))
        yield from gripper.until_open()

    def _let_go(self, width: float, object_pose: Pose) -> None:
        """Detach the object, also where the leaf is halted: the hand opens all the same."""
        arm = self._arm
        arm.gripper.let_go(self._name)
        arm.known.released = Released(self._held, width, object_pose, arm.commanded_tool_pose)

    def resume(self, released: Released) -> Iterator[float | None]:
        """Leave an object as after its release, where an earlier leaf was halted or failed then.

        Yields once per tick.

        Args:
            released: The object, which is where it was released.

        Raises:
            Failure: ``NOT_OPEN``; ``NOT_PLACED`` if it sticks to the gripper; as motions.
        """
        arm = self._arm
        self._room, _ = self._room_at(arm.setpoint.q, released.width)
        self._open(released.width)
        yield from arm.come_to_rest()
        yield from self._until_apart(released.width)
        tool = arm.commanded_tool_pose
        left = self._ports.retreat - released.tool.distance(tool)
        retreats: list[RetreatTo] = []
        if left > _OFF_M and released.tool.angle(tool) < _SAME_RAD:
            in_tool = tool.inverse @ released.pose
            retreats = possible_retreats(arm, tool, self._name, in_tool, left)
        yield from self._leave(retreats, released.width, released.pose)

    def _leave(
        self, retreats: Sequence[RetreatTo], width: float, object_pose: Pose
    ) -> Iterator[float | None]:
        """Retreat, if there are any retreats to try, and check that the object did not come along.

        Other arguments and failures as `_release`.
        """
        arm = self._arm
        self._left = LeftStanding(arm, self._name)
        move = replace(arm.past_others(self._ports.speed, frozenset({self._name})), give_way=False)

        def planned() -> Generator[None, None, Trajectory]:
            return plan_retreat(move, retreats, self._metrics)

        self._test: Generator[float, None, bool] | None = None
        self._sticks: bool | None = None
        if retreats:
            yield from move.along(planned, partial(self._retreat, width, object_pose))
        else:
            self._test = came_along(arm, self._held, width, object_pose)
        while self._test is not None and self._sticks is None:
            yield 1.0
            self._continue_test(width)
        if self._sticks:
            self._refuse_sticking()

    def _retreat(
        self, width: float, object_pose: Pose, motion: Trajectory, wait_s: float
    ) -> Iterator[float | None]:
        """Execute the retreat: compliant at first, as the tool may still be in contact."""
        arm = self._arm
        start = arm.commanded_tool_pose
        running = arm.begin(motion, may_touch=True, compliant=True)
        watch = arm.watch(running, frozenset({self._name}))
        in_contact = True
        while not running.done:
            yield 0.85 + 0.15 * running.progress
            arm.check()
            self._left.look()
            if in_contact and arm.commanded_tool_pose.distance(start) >= _OFF_M:
                in_contact = False
                arm.expect_no_contact()
            if not in_contact:
                watch.look(arm.time)
                arm.refuse_when_held_up(running, wait_s)
                if self._test is None and self._is_beyond(object_pose):
                    self._test = came_along(arm, self._held, width, object_pose)
            self._continue_test(width)
        yield from arm.settle()
        if self._test is None:
            self._test = came_along(arm, self._held, width, object_pose)

    def _is_beyond(self, object_pose: Pose) -> bool:
        return self._left.is_there and is_beyond(self._arm, self._name, object_pose)

    def _continue_test(self, width: float) -> None:
        """Continue the test whether the object stuck to the gripper; open again at its end."""
        if self._test is None or self._sticks is not None:
            return
        try:
            next(self._test)
        except StopIteration as end:
            self._sticks = bool(end.value)
            if not self._sticks:
                self._open(width)

    def _open(self, width: float) -> None:
        """Command the fingers to leave `_room` on each side of an object of a width, m."""
        gripper = self._arm.gripper
        description = gripper.description
        gripper.command(
            min(width + 2.0 * self._room, description.stroke) if description.fingers else 1.0
        )

    def _refuse_sticking(self) -> None:
        """Attach an object that sticks to the gripper again, and fail."""
        arm = self._arm
        gripper = self._arm.gripper
        name = self._name
        pose = arm.tool_pose @ self._in_tool
        if gripper.why_not(name, pose) is None:
            gripper.hold(name, pose, self._held.most_force, mass_declared=self._held.mass_declared)
        met = "the fingers have met" if gripper.description.fingers else "the cup seals on"
        raise Failure(
            "NOT_PLACED",
            f"{name!r} stuck to the gripper: {met} it again",
            width_m=gripper.width,
            force_n=gripper.force,
        )
