"""Placing: lower until contact, release, retreat, and the referee's test of the result."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.arm.arm import Arm, MoveTo
from bt_dualarm.arm.payload import jaw_measures
from bt_dualarm.collision.support import MARGIN_M, Support, support_below
from bt_dualarm.core.errors import Failure, Number
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.perception.shape_fit import KnownShape
from bt_dualarm.planning.path_search import Planner
from bt_dualarm.sim.grippers import Attachment
from bt_dualarm.skill.grasp_search import poses_alike
from bt_dualarm.skill.grip import Grip, TouchSense
from bt_dualarm.spec.node_types import PortModel, port
from bt_dualarm.spec.values import Angle, Duration, Speed
from bt_dualarm.trajectory.overlap import OverlappedMotion
from bt_dualarm.trajectory.set_points import TrajectorySource
from bt_dualarm.trajectory.trajectory import Trajectory

TOUCHDOWN_M_S: Final = 0.002
"""Highest speed at contact, m/s: with an effective mass of 6 to 8 kg at the tool it makes 7 N in
the first 2 ms."""

NEARING_M_S: Final = 0.02
"""Highest speed at a height at which contact is possible, but not expected, m/s: 50 N at most."""

# A tool has stopped if, over a time window, it covers less than a fraction of its set-point's
# distance while the set-point is faster than a fraction of its highest speed.
_COMPARED_S: Final = 0.08
_SHORT_S: Final = 0.06  # enough where contact is expected
_LONG_S: Final = 0.13
_VERY_LONG_S: Final = (
    0.5  # by then joints have broken away, however uneven the set-point's speed is
)
_UNEXPECTED_M_S: Final = 0.006  # highest speed of a guarded descent before contact is expected
_BRISK: Final = 0.1  # a guarded descent begins with this fraction of the acceleration limits
_STEADY: Final = 0.75  # fraction of the highest speed, which varies along the path
_SLOW: Final = 0.3  # the same for the longest window
_STOPPED: Final = 0.35  # fraction of the distance; a joint that sticks briefly leaves more
_LONG_STOPPED: Final = 0.2


def guarded_descent(
    arm: Arm,
    end: Pose,
    speed: float,
    force: float,
    look: Callable[[], None],
    *,
    lightly: bool = False,
    near: Pose | None = None,
    ignore: frozenset[str] = frozenset(),
) -> Generator[float, None, tuple[bool, float]]:
    """Compliant straight motion that stops on contact (guarded move); yields the progress.

    Contact is detected if a force against the motion rises and the tool lags its steadily moving
    set-point: friction alone does not cause both.

    Args:
        arm: Arm that moves.
        end: Pose of the tool in the world at the end.
        speed: Fraction of its limits, above 0 to 1, and no more than `TOUCHDOWN_M_S`.
        force: Contact force that ends the motion, N.
        look: Check that is called once per tick, and may raise.
        lightly: Whether a stop of 0.13 s counts as contact, however small the force is.
        near: Pose during the descent down to which no contact is expected: three times as fast.
        ignore: Names of objects that may touch something during the descent.

    Returns:
        Whether there was contact, and the largest force until the arm was at rest, N.
    """
    along = _direction(arm.commanded_tool_pose, end)
    if near is None:
        timed, top = arm.slow_path(arm.line_on(end), speed, TOUCHDOWN_M_S, _BRISK)
    else:
        rows = arm.line_on(near)
        first, _ = arm.slow_path(rows, _BRISK, _UNEXPECTED_M_S, _BRISK)
        low = arm.line_after(rows[-1], end)
        second, top = arm.slow_path(low, speed, TOUCHDOWN_M_S, _BRISK)
        begin = OverlappedMotion.of(first)
        # At rest in between, friction of the joints would count as contact.
        timed = arm.overlapped(begin, second, _BRISK, 0.5 * first.duration, ignore).motion
    motion = arm.begin(timed, may_touch=True, compliant=True)
    return (
        yield from until_contact(
            arm, motion, motion.trajectory.duration, along, top, force, look, lightly=lightly
        )
    )


def until_contact(
    arm: Arm,
    motion: TrajectorySource,
    until_s: float,
    along: Vector,
    top: float,
    force: float,
    look: Callable[[], None],
    *,
    lightly: bool = False,
    behind_m: float = np.inf,
    is_expected: Callable[[], bool] | None = None,
    touched: Callable[[], None] | None = None,
) -> Generator[float, None, tuple[bool, float]]:
    """Follow a part of a compliant motion until contact; yields the progress once per tick.

    Args:
        arm: Arm that moves.
        motion: Running motion.
        until_s: Time of the motion as planned at which the part ends, s.
        along: Direction of the tool's motion in the world, of unit length, of shape (3,).
        top: Speed of the tool on this part, m/s: at much lower speed no contact is detected.
        force: As `guarded_descent`.
        look: As `guarded_descent`.
        lightly: As `guarded_descent`.
        behind_m: Distance of the tool behind its set-point that counts as contact, m: only where
            the joints had broken away before the arm became compliant.
        is_expected: Whether contact is expected where the tool is: a stop of 0.06 s counts then.
        touched: Called at the contact, before the arm brakes.

    Returns:
        Whether there was contact, after which the arm is at rest, and the largest force, N.
    """
    sense = TouchSense(arm, along)
    lag = Lag(arm, along, _STEADY * top)
    while not motion.done and motion.parameter.s < until_s:
        yield motion.progress
        arm.check()
        look()
        lag.look(motion.parameter.scale)
        stops = lag.stops and is_expected is not None and is_expected()
        felt = sense.force(stands=lag.has_stopped or lag.stands or stops)
        meant = arm.commanded_tool_pose.position
        is_behind = float((meant - arm.tool_pose.position) @ along) > behind_m
        if not (lag.is_steady or lag.stands or is_behind or stops):
            sense.most = 0.0
        elif is_behind or stops or (felt > force and lag.has_stopped) or (lightly and lag.stands):
            most = sense.most
            if touched is not None:
                touched()
            for _ in arm.halt():
                yield 1.0
                sense.force(stands=True)
            return True, sense.most if touched is None else most
    return False, sense.most


def _direction(start: Pose, end: Pose) -> Vector:
    offset = end.position - start.position
    along: Vector = offset / max(float(np.linalg.norm(offset)), 1e-9)
    return along


_LEAST_SCALE: Final = 0.25
"""Time scale of a descent below which no contact is detected: the guard slows to 0.3 at least."""


class Lag:
    """Detection of a tool that has stopped while its set-point moves on.

    Args:
        arm: Arm with the tool.
        along: Direction of the motion in the world, of unit length, of shape (3,).
        steady_m_s: Speed of the set-point above which a stop is detectable, m/s.

    Attributes:
        is_steady: Whether the set-point is fast enough.
        has_stopped: Whether the tool has stopped.
        stands: Whether it has stopped for a longer time.
        stops: Whether it has come to a stop for a short time: joints that stick do so as well.
    """

    def __init__(self, arm: Arm, along: Vector, steady_m_s: float) -> None:
        self._arm = arm
        self._along = along
        self._steady_m_s = steady_m_s
        self._past = deque[tuple[float, float, float]]()
        self.is_steady = self.has_stopped = self.stands = self.stops = False

    def look(self, scale: float) -> None:
        """Take a sample; to be called once per tick.

        Args:
            scale: Time scale of the motion, which is less than 1 near another arm.
        """
        arm = self._arm
        past = self._past
        # While the guard holds a motion, it is unknown whether the tool would continue.
        steady_m_s = max(scale, _LEAST_SCALE) * self._steady_m_s
        meant = float(arm.commanded_tool_pose.position @ self._along)
        past.append((arm.time, meant, float(arm.tool_pose.position @ self._along)))
        while len(past) > 2 and arm.time - past[1][0] >= _VERY_LONG_S:
            past.popleft()
        self.is_steady, share = self._share(_COMPARED_S, steady_m_s)
        self.has_stopped = self.is_steady and share < _STOPPED
        was_steady, share = self._share(_SHORT_S, steady_m_s)
        self.stops = was_steady and share < _LONG_STOPPED
        was_steady, share = self._share(_LONG_S, steady_m_s)
        was_going, slow_share = self._share(_VERY_LONG_S, _SLOW * steady_m_s)
        self.stands = (was_steady and share < _LONG_STOPPED) or (
            was_going and slow_share < _LONG_STOPPED
        )

    def _share(self, seconds: float, least_m_s: float) -> tuple[bool, float]:
        """Whether the set-point is fast enough; fraction of its distance covered by the tool."""
        now, meant_now, here = self._past[-1]
        ago = [one for one in self._past if now - one[0] >= seconds]
        if not ago:
            return False, 1.0
        then, meant_then, was = ago[-1]
        distance = meant_now - meant_then
        return distance >= least_m_s * (now - then), (here - was) / max(distance, 1e-9)


REST_S: Final = 0.25
"""Simulated seconds for which an object has to keep its pose, to be at rest."""

_BODY: Final = int(mujoco.mjtObj.mjOBJ_BODY)
_STILL_M = 1e-4
_STILL_SHARE = 1e-3
"""Largest displacement of any point of an object at rest within `REST_S`, in m and as a fraction of
the distance of its farthest corner: the ends of a beam move more. Poses are compared, not
velocities, since a vibrating tool or an edge makes an object oscillate without displacing it: every
12 ms, MuJoCo 4.0.0 finds one contact instead of four of a box that reaches over an edge, and turns
a bar of 30 mm by 1 mrad about its long axis, forever. Its edges move by less than 0.04 mm."""


class LeftStanding:
    """Referee for an object that an arm has released.

    No sensor of the arm measures what happens to the object. The referee uses the true state: it
    scores the outcome, and turns a false SUCCESS into a failure. No motion of the arm depends on
    it.

    Args:
        arm: Arm that releases the object.
        name: Name of the object, which is in the world.
        still_share: Largest displacement of a point of it at rest, as a fraction of the distance of
            its farthest corner.

    Attributes:
        rests: Whether the object is at rest.
    """

    def __init__(self, arm: Arm, name: str, still_share: float = _STILL_SHARE) -> None:
        self._arm = arm
        self._name = name
        self._still_share = still_share
        self._corners = deque[tuple[float, Matrix]]()
        self.rests = False

    @property
    def pose(self) -> Pose:
        """True pose of the object in the world."""
        return self._arm.world.object_pose(self._name)

    @property
    def is_there(self) -> bool:
        """Whether the object is in the world."""
        return self._name in self._arm.world.objects

    def look(self) -> None:
        """Take a sample; to be called once per tick."""
        if not self.is_there:
            self.rests = False
            return
        now = self._arm.time
        corners = self._box_corners()
        self._corners.append((now, corners))
        while len(self._corners) > 1 and now - self._corners[1][0] >= REST_S:
            self._corners.popleft()
        reach = 0.5 * float(np.linalg.norm(corners[-1] - corners[0]))
        still = max(_STILL_M, self._still_share * reach)
        self.rests = now - self._corners[0][0] >= REST_S and all(
            np.linalg.norm(corners - were, axis=1).max() <= still for _, were in self._corners
        )

    def _box_corners(self) -> Matrix:
        """Corners of its bounding box in the world, of shape (8, 3), m: they move farthest."""
        solid = self._arm.world.object_solid(self._name)
        sides = [(-solid.reach(-axis), solid.reach(axis)) for axis in np.eye(3)]
        pose = self.pose
        corners: Matrix = np.array([*itertools.product(*sides)]) @ pose.rotation_matrix.T
        return corners + pose.position

    def until_rest(self, longest: float) -> Iterator[float]:
        """Wait until it rests or is gone, or ``longest`` seconds have passed; once per tick."""
        until = self._arm.time + max(longest, REST_S)
        while self.is_there and not self.rests and self._arm.time <= until:
            yield 1.0
            self.look()

    def away_from(self, goal: Pose) -> tuple[float, float]:
        """Distance, m, and angle, rad, from a pose, up to the symmetry of the object."""
        pose = self.pose
        spec = self._arm.world.objects[self._name]
        return pose.distance(goal), KnownShape.of(spec).angle(pose, goal)

    def refuse_unless_at(
        self, goal: Pose, tolerance: float, angle_tolerance: float, *, touched: bool = False
    ) -> None:
        """Check that it rests at a pose, free of the arm.

        Args:
            goal: Pose in the world.
            tolerance: Largest distance from there, m.
            angle_tolerance: Largest angle from there, rad.
            touched: Whether the arm's tool may still touch it.

        Raises:
            Failure: ``NOT_PLACED`` with both.
        """
        label = repr(self._name)
        if not self.is_there:
            raise Failure("NOT_PLACED", f"object {label} was removed from the world")
        away, turned = self.away_from(goal)
        numbers = {"placed_error_m": away, "placed_turned_rad": turned}
        how = f"{label} is {1e3 * away:.1f} mm and {np.degrees(turned):.1f}° from its goal"
        if not self.rests:
            raise Failure("NOT_PLACED", f"{how}, and still moves", **numbers)
        if away > tolerance or turned > angle_tolerance:
            raise Failure("NOT_PLACED", f"{how}, at rest", **numbers)
        if not touched and is_borne_by(self._arm, self._name):
            raise Failure("NOT_PLACED", f"{how}, but the tool still holds or touches it", **numbers)


def is_borne_by(arm: Arm, name: str) -> bool:
    """Whether an object truly touches an arm's tool, or is tied to the arm."""
    return arm.world.touches(arm.name, name) or is_tied_to(arm, name)


def is_tied_to(arm: Arm, name: str) -> bool:
    """Whether an equality constraint ties an object to an arm, as glue would."""
    world = arm.world
    model = world.model
    data = world.data
    body = world.arms[arm.name]
    own = {int(model.geom_bodyid[geom]) for geom in body.geom_ids} | {body.tool_body}
    its = world.object_body(name)
    for tie in np.flatnonzero(data.eq_active).tolist():
        pair = {int(model.eq_obj1id[tie]), int(model.eq_obj2id[tie])}
        if model.eq_objtype[tie] == _BODY and its in pair and pair & own:
            return True
    return False


def stands_without(arm: Arm, name: str) -> bool:
    """Whether something other than an arm bears at least half of an object's weight."""
    world = arm.world
    if not world.objects[name].is_free:
        return True
    if any(one.object == name and one.arm != arm.name for one in world.attachments):
        return True
    model = world.model
    data = world.data
    geoms = world.payload_geoms(name)
    own = world.arms[arm.name].geom_ids
    force = np.empty(6)
    borne = 0.0
    for number, pair in enumerate(data.contact.geom.tolist()):
        if not own & set(pair) and (pair[0] in geoms) != (pair[1] in geoms):
            mujoco.mj_contactForce(model, data, number, force)
            upward = float(force[:3] @ data.contact.frame[number].reshape(3, 3)[:, 2])
            borne += upward if pair[1] in geoms else -upward  # forces act on the second geom
    riders = (one.object for one in world.passengers_of(name))
    mass = sum(model.body_subtreemass[world.object_body(one)] for one in (name, *riders))
    weight = float(mass * -model.opt.gravity[2])
    return borne >= 0.5 * weight


_NARROWER_M: Final = 0.005  # opening below the object's width to which the fingers close
_MET_M: Final = 0.0025  # opening above that at which they have met the object
_BESIDE_M: Final = 0.005  # clearance of fingertips or lip from the placed object
_LASTS_S: Final = 0.05  # required duration of the hold: a drive pushes before its fingers move
_BOUNCES_S: Final = 1.0  # further time for fingers that bounce off an object to come to rest
_FEELS_S: Final = 0.25  # time in addition to the closing time; a vacuum reaches 86 % after 0.1 s


def came_along(
    arm: Arm, held: Attachment, width: float, lies: Pose
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
        lies: Pose in the world at which it was released.

    Returns:
        Whether something is in the gripper.
    """
    gripper = arm.gripper
    page = arm.gripper.page
    if held.object not in arm.world.objects or not _is_beyond(arm, held.object, lies):
        return False
    if page.fingers:
        goal = max(width - _NARROWER_M, 0.0)
        if width - goal <= _MET_M + page.resolution:
            return False  # too thin to be detected
        gripper.command(goal, force=page.force.least)
        lasts = _FEELS_S + 2.0 * (gripper.width - goal) / page.speed.most
    else:
        gripper.command(0.0, force=min(gripper.commanded.force, held.most_force))
        goal = 0.0
        lasts = _FEELS_S
    began = arm.time
    since = arm.time
    while True:
        is_open = bool(page.fingers) and gripper.width > goal + _MET_M
        if arm.time - began > (lasts + _BOUNCES_S if is_open else lasts):
            return is_open
        if page.fingers and gripper.at_rest and gripper.width <= goal + page.resolution:
            return False
        if not gripper.holding:
            since = arm.time
        elif arm.time - since >= _LASTS_S:
            return not page.fingers or is_open
        yield 1.0


def _is_beyond(arm: Arm, name: str, lies: Pose) -> bool:
    """Whether an object at a pose in the world reaches neither between the pads nor to the cup."""
    return _distance_beyond(arm, name, arm.tool_pose.inverse @ lies) > _BESIDE_M


def _distance_beyond(arm: Arm, name: str, in_tool: Pose) -> float:
    """Distance of an object beyond the fingertips or the cup along the tool's axis, m.

    Args:
        arm: Arm with the gripper.
        name: Name of the object.
        in_tool: Pose of the object in the tool's frame.

    Returns:
        The distance; negative if the object reaches between the fingers.
    """
    declared = arm.world.objects[name]
    page = arm.gripper.page
    back = in_tool.rotation_matrix.T @ np.array((0.0, 0.0, -1.0))
    nearest = float(in_tool.position[2]) - arm.world.object_solid(name).reach(back)
    return nearest - (jaw_measures(page, declared.friction).tip if page.fingers else 0.0)


_ROOM_M: Final = 0.01  # minimum opening on each side of the object at the release
_APART_M: Final = 0.0015  # opening on each side of it at which the retreat begins
_FREE_M: Final = 0.006  # height above the goal down to which the path must be free
_LEARNED_S: Final = 0.1  # time for a compliant arm to learn its friction before contact
_BEHIND_M: Final = 0.001  # distance behind its set-point at which the tool has made contact

_EXPECTED_M_S: Final = 0.002
"""Highest speed where contact is expected, m/s."""

_SURE_M: Final = 0.00055
"""Height above the goal from which contact is expected. An arm that has seen the object touches the
support within 0.2 mm of where it expects it; a declared pose may be off by half a millimeter."""

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

_LOWEST_M: Final = 0.008  # minimum height above the goal at which the descent begins
_CLEAR_M: Final = 0.003  # clearance to the height at which the descent is still free
_LOWER: Final = (0.7, 0.5, 0.35, 0.25)  # fractions of the height to try if it is not free
_NEAR_M: Final = 0.0015  # height above the goal beyond which a contact may be joint friction
_FALSE: Final = 3  # descents until a contact beyond that height counts
_SPARE_M: Final = 0.005  # by which a shorter retreat is longer than the object requires
_ON_CARRIER_N: Final = 1.5  # contact force on a carrier in another arm's hand
_ON_CARRIER_M: Final = 0.001
"""Distance below a carrier in another arm's hand at which the object is released, whether contact
was detected or not: a tray gives way there under hardly more than the object's weight."""

_COMES_FREE: Final = 0.5  # share of a motion straight up that must be along the tool's axis
_VERTICAL: Final = 0.999  # the same for a tool that points straight down: it is all of it
_HORIZONTAL: Final = 0.1  # sine of the slope up to which fingers close horizontally
_OFF_M: Final = 0.003  # length of the compliant start of the retreat
_LOWERING: Final = (0.8, 0.45, 0.3)  # fractions of the speed below the approach height
_BRANCHES: Final = 3  # free branches of the inverse kinematics among which the planner chooses
_TRIES: Final = 12  # blocked branches after which the search for free ones ends


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
        0.015,
        "distance below the goal down to which the support is searched",
        unit="m",
        ge=0.001,
        le=0.1,
    )
    retreat: float = port(0.08, "length of the retreat", unit="m", ge=0.01, le=0.3)
    tolerance: float = port(
        0.008,
        "largest height error at contact, and largest position error at the end",
        unit="m",
        ge=1e-3,
        le=0.1,
    )
    angle_tolerance: Angle = port(
        5.0, "largest rotation error at the end, up to the object's symmetry", ge=0.1, le=90
    )
    settle: Duration = port(1.0, "longest time to come to rest", gt=0, le=30)
    speed: Speed = port(0.5, "fraction of the arm's limits up to the descent")
    down_speed: Speed = port(
        0.1, "fraction of the arm's limits where contact is expected, at 2 mm/s at most"
    )
    planner: Planner = port("RRTConnect", "planner to use if the straight path is blocked")


@dataclass(frozen=True, eq=False)
class _Descent:
    """Planned descent to a pose of the tool.

    Attributes:
        tool: Pose of the tool in the world with the object at its goal.
        height: Height above that at which the descent begins, m.
        branches: Configurations down to near the goal, of shape (n, dof), rad, for each feasible
            branch of the inverse kinematics; the preferred one first.
        turned: Rotation of the object from its goal into itself, rad.
    """

    tool: Pose
    height: float
    branches: list[Matrix]
    turned: float = 0.0


@dataclass(frozen=True, eq=False)
class RetreatTo:
    """Straight retreat of the open hand from a placed object.

    Attributes:
        end: Pose of the tool in the world at its end.
        length: Its length along the tool's axis, m.
        by_object: Whether it could touch the object, so that it has to be checked against that.
    """

    end: Pose
    length: float
    by_object: bool = False


def possible_retreats(
    arm: Arm, tool: Pose, name: str, in_tool: Pose, asked: float
) -> list[RetreatTo]:
    """Retreats of an open hand from an object, in the order in which to try them.

    After the one requested they are straight up, where the fingers close horizontally and come
    free, and along the tool's axis only as far as frees the object.

    Args:
        arm: Arm with the gripper.
        tool: Pose of the tool in the world.
        name: Name of the object.
        in_tool: Pose of the object in the tool's frame.
        asked: Length of the retreat that is requested, m.
    """
    axes = tool.rotation_matrix
    found = [RetreatTo(tool @ Pose.from_rpy((0.0, 0.0, -asked)), asked)]
    comes_free = -float(axes[2, 2])
    if (
        arm.gripper.page.fingers
        and _COMES_FREE < comes_free < _VERTICAL
        and abs(axes[2, 1]) < _HORIZONTAL
    ):
        found.append(RetreatTo(_raised(tool, asked), comes_free * asked, by_object=True))
    beyond = _distance_beyond(arm, name, in_tool)
    shortest = _SPARE_M + max(_BESIDE_M - beyond, 0.0)
    if shortest < asked:
        found.append(RetreatTo(tool @ Pose.from_rpy((0.0, 0.0, -shortest)), shortest))
    return found


def plan_retreat(
    move: MoveTo, retreats: Sequence[RetreatTo], metrics: dict[str, Number]
) -> Generator[None, None, Trajectory]:
    """Plan the first possible retreat; yields once per tick.

    Args:
        move: Motion of the arm, which may touch the object.
        retreats: Retreats to try, see `possible_retreats`.
        metrics: Metrics of the leaf; get the length of the retreat if it is not the first one.

    Raises:
        Failure: That of the last retreat, or of one that another arm blocks: as planning.
    """
    arm = move.arm
    for retreat in retreats:
        try:
            rows = arm.line_on(retreat.end)
            yield from move.checked(rows, known_free=False)
            if retreat.by_object:
                arm.refuse_collision_along(rows)
        except Failure as failure:
            if retreat is retreats[-1] or move.may_clear(failure):
                raise
        else:
            if retreat is not retreats[0]:
                metrics["retreated_m"] = retreat.length
            break
    return arm.time_path(rows, move.speed)


class SettingDown:
    """Placing of one held object.

    Args:
        arm: Arm whose gripper holds it.
        ports: Ports of the skill.
        held: Attachment of the object.
        metrics: Metrics of the skill, to be filled.

    Attributes:
        failures: Failure codes of placing and their meaning.
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
        self, arm: Arm, ports: SettingDownPorts, held: Attachment, metrics: dict[str, Number]
    ) -> None:
        self._arm = arm
        self._ports = ports
        self._metrics = metrics
        self._held = held
        self._name = held.object
        self._in_tool = arm.robot.tool.inverse @ held.relative

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
        grip = Grip(self._arm, self._name)
        grip.look()
        began_s = arm.time
        found = self._support_at(goal)
        yield None
        attachments = arm.world.attachments
        self._force = self._ports.force
        self._search = self._ports.search
        self._carrier = "" if found is None else found.carrier
        if found is not None and self._carrier:
            self._force = min(self._force, _ON_CARRIER_N)
            self._search = min(self._search, max(found.below, 0.0) + _ON_CARRIER_M)
            attachments.place_on(arm.name, self._name, self._carrier)
        try:
            yield from self._go_down(goal, grip, began_s)
        except BaseException as failure:
            attachments.place_on(arm.name, self._name, self._held.carrier)
            if isinstance(failure, Failure) and failure.code == "SLIPPED":
                yield from grip.judge(failure)
            raise
        lies = self._touched @ self._in_tool
        self._metrics["believed_error_m"] = lies.distance(goal)
        yield from self._release(grip.width, lies)
        return lies

    def stays_at(self, goal: Pose, within_m: float | None = None) -> Iterator[float]:
        """Wait until the released object rests, and check its true pose, as a referee.

        Yields the progress once per tick.

        Args:
            goal: Pose of the object in the world.
            within_m: Largest position error, m; by default the tolerance of the ports.

        Raises:
            Failure: ``NOT_PLACED``, see `LeftStanding`.
        """
        yield from self._left.until_rest(self._ports.settle)
        if self._left.is_there:
            away, turned = self._left.away_from(goal)
            self._metrics |= {"placed_error_m": away, "placed_turned_rad": turned}
        within = self._ports.tolerance if within_m is None else within_m
        self._left.refuse_unless_at(goal, within, self._ports.angle_tolerance)

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

    def _go_down(
        self, goal: Pose, grip: Grip, began_s: float
    ) -> Generator[float | None, None, Pose]:
        """Move above the goal, in a branch that allows descent and retreat, and lower the object.

        It is one motion without a stop, unless other arms are near: then the arm waits above the
        goal until they are out of the way.

        Args:
            goal: Pose of the object in the world.
            grip: Grip on the object.
            began_s: Simulated time at which planning began, s.

        Returns:
            Pose of the tool in the world with the object at its goal.
        """
        arm = self._arm
        ports = self._ports
        move = arm.past_others(ports.speed)
        descents: list[_Descent] = []
        began = [began_s]

        def above() -> Generator[None, None, Trajectory]:
            descents[:] = [(yield from self._descent(goal, move))]
            starts = [rows[0] for rows in descents[0].branches]
            first_s = began.pop() if began else None
            return (
                yield from arm.plan(starts, ports.speed, planner=ports.planner, began_s=first_s)
            )

        def down(q: Vector) -> Matrix:
            return min(descents[0].branches, key=lambda rows: float(np.abs(rows[0] - q).max()))

        def whole() -> Generator[None, None, Trajectory]:
            begin = OverlappedMotion.of((yield from above()))
            self._lowering = self._lowered(begin, down(begin.motion.end), descents[0].tool)
            return self._lowering.motion

        def rest() -> Generator[None, None, Trajectory]:
            begin = OverlappedMotion.of(Trajectory.rest(arm.setpoint.q, arm.period))
            rows = arm.line_on(_raised(descents[0].tool, _FREE_M))
            yield from move.checked(rows, known_free=True)
            self._lowering = self._lowered(begin, rows, descents[0].tool)
            return self._lowering.motion

        follow = partial(self._touch_down, grip, lambda: descents[0].tool)
        if not arm.controller.neighbors:
            yield from move.along(whole, follow)
        else:
            for progress in move.to_line(above, lambda: down(arm.setpoint.q)):
                yield 0.3 * (progress or 0.0)
                grip.look()
            yield from replace(move, give_way=False).along(rest, follow)
        (descent,) = descents
        if descent.height < ports.height:
            self._metrics["lowered_from_m"] = descent.height
        if descent.turned:
            self._metrics["spun_rad"] = descent.turned
        return descent.tool

    def _lowered(self, begin: OverlappedMotion, down: Matrix, tool: Pose) -> OverlappedMotion:
        """A motion and the descent after it: the slower, the nearer contact may be.

        Args:
            begin: Motion to the beginning of the descent.
            down: Configurations from there to `_FREE_M` above the goal, of shape (n, dof), rad.
            tool: Pose of the tool in the world with the object at its goal.
        """
        arm = self._arm
        ports = self._ports
        low = arm.line_after(down[-1], _raised(tool, -min(_LIKELY_M, self._search)))
        rows = np.vstack((down, low[1:]))
        start = float(arm.kinematics.forward(rows[0]).position[2] - tool.position[2])
        self._top = min(_EXPECTED_M_S, arm.least_speed(low, ports.down_speed))

        def most_m_s(lengths: Vector) -> Vector:
            height = start - lengths
            near = np.clip(self._top + (height - _SURE_M) / _NEARING_S, self._top, NEARING_M_S)
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
            return whole
        # Seconds long, and hardly ever used: alone, it takes a fraction of the computing time.
        rest = arm.line_after(low[-1], _raised(tool, -self._search))
        search, _ = arm.slow_path(rest, ports.down_speed, self._top, ports.speed)
        return arm.overlapped(whole, search, ports.speed, _BLEND_S, frozenset({self._name}))

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
            return bool(abs(arm.tool_pose.position[2] - tool().position[2]) < _EXPECTED_M)

        def touched() -> None:
            self._touched = arm.tool_pose
            # The fingers open while the arm brakes.
            if abs(self._height(tool())) <= min(_NEAR_M, ports.tolerance):
                self._open(grip.width)

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
        low = _raised(tool(), -self._search)
        for _ in range(_FALSE):
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
            if height <= _NEAR_M:
                break
            felt, most = yield from guarded_descent(
                arm, low, ports.down_speed, force, grip.look, lightly=True
            )
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

    def _descent(self, goal: Pose, move: MoveTo) -> Generator[None, None, _Descent]:
        """Descent to a goal: as requested, from a lower height, or with a round object rotated.

        The one requested is preferred, then the smallest rotation, then the largest height. Yields
        once for each branch that is checked.

        Args:
            goal: Pose of the object in the world.
            move: Motion above the goal.

        Raises:
            Failure: That of the descent requested, see `_branches_down`, if there is no other, or
                if another arm is in the way, which may leave.
        """
        height = self._ports.height
        upright = goal @ self._in_tool.inverse
        try:
            return _Descent(upright, height, (yield from self._branches_down(upright, height)))
        except Failure as failure:
            if move.may_leave(failure):
                raise
            # A traceback would keep this frame alive.
            refusal = failure.with_traceback(None)
        for turned, alike in poses_alike(self._arm.world.objects[self._name], goal):
            tool = alike @ self._in_tool.inverse
            yield
            try:
                lowest = _Descent(
                    tool, _LOWEST_M, (yield from self._branches_down(tool, _LOWEST_M)), turned
                )
            except Failure:
                continue  # every higher descent contains this one
            for share in (1.0, *_LOWER) if turned else _LOWER:
                try:
                    branches = yield from self._branches_down(tool, share * height)
                    begin = height
                    if share < 1.0:
                        begin = max(share * height - _CLEAR_M, _LOWEST_M)
                        branches = yield from self._branches_down(tool, begin)
                except Failure:
                    continue
                return _Descent(tool, begin, branches, turned)
            return lowest
        raise refusal

    def _branches_down(self, tool: Pose, height: float) -> Generator[None, None, list[Matrix]]:
        """Straight descent to a pose of the tool, in branches that allow search and retreat.

        The arm and the held object are collision-free down to `_FREE_M`, and the arm alone on
        the retreat. Branches in which only another retreat is possible, see `_retreats`, count
        where there are no others, or where something rides on the object: an arm that has to keep
        that upright can hardly leave its branch. Yields once per tick, for one or two branches.

        Args:
            tool: Pose of the tool in the world.
            height: Height above it at which the descent begins, m.

        Returns:
            For each branch configurations down to `_FREE_M`, of shape (n, dof), rad; the preferred
            branch first.

        Raises:
            Failure: That of the preferred branch, if there is none: ``IN_COLLISION``,
                ``PATH_BROKEN``, ``SINGULAR``, ``UNREACHABLE`` or ``INVALID_TARGET``.
        """
        arm = self._arm
        held = frozenset({self._name})
        corners = [_raised(tool, above) for above in (height, _FREE_M, 0.0, -self._search)]
        found: list[Matrix] = []
        narrow: list[Matrix] = []
        refusals: list[Failure] = []
        retreats = self._retreats(tool)
        for down, low, _ in arm.lines(*corners):
            try:
                arm.refuse_collision_along(down)
                for retreat in retreats:
                    try:
                        out = arm.line_after(low[-1], retreat.end)
                        arm.refuse_collision_along(out, ignore=held)
                    except Failure:
                        if retreat is retreats[-1]:
                            raise
                    else:
                        (found if retreat is retreats[0] else narrow).append(down)
                        break
            except Failure as failure:
                refusals.append(failure.with_traceback(None))
                if len(refusals) % 2:
                    continue  # most are found out soon: two are checked in one tick
            yield
            if len(found) == _BRANCHES or len(refusals) == _TRIES:
                break
        if narrow and (not found or arm.world.passengers_of(self._name)):
            found = [*found, *narrow]
        if not found:
            raise refusals[0]
        return found[:_BRANCHES]

    def _retreats(self, tool: Pose) -> list[RetreatTo]:
        """Retreats from a pose of the tool to try, the one requested first."""
        return possible_retreats(self._arm, tool, self._name, self._in_tool, self._ports.retreat)

    def _height(self, tool: Pose) -> float:
        """Height above a pose at which the tool made contact, from the encoders, m."""
        return float(self._touched.position[2] - tool.position[2])

    def _release(self, width: float, lies: Pose) -> Iterator[float | None]:
        """Open, retreat, and check that the object did not come along.

        The retreat begins as soon as there is `_APART_M` on each side of the object. An object that
        is still in the gripper is attached again.

        Args:
            width: Opening of the fingers when they held it, m.
            lies: Pose of the object in the world at the release.

        Raises:
            Failure: ``NOT_OPEN``; ``NOT_PLACED`` if it sticks to the gripper; as motions.
        """
        arm = self._arm
        gripper = arm.gripper
        fingers = gripper.page.fingers
        self._open(width)
        apart = width + 2.0 * _APART_M
        for _ in gripper.until_open():
            if fingers and gripper.width >= apart:
                break
            yield 0.85
        gripper.let_go(self._name)
        self._left = LeftStanding(arm, self._name)
        retreats = self._retreats(arm.commanded_tool_pose)
        move = replace(arm.past_others(self._ports.speed, frozenset({self._name})), give_way=False)

        def planned() -> Generator[None, None, Trajectory]:
            return plan_retreat(move, retreats, self._metrics)

        self._test: Generator[float, None, bool] | None = None
        self._sticks: bool | None = None
        yield from move.along(planned, partial(self._retreat, width, lies))
        while self._test is not None and self._sticks is None:
            yield 1.0
            self._continue_test(width)
        if self._sticks:
            self._refuse_sticking()

    def _retreat(
        self, width: float, lies: Pose, motion: Trajectory, wait_s: float
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
                if self._test is None and self._is_beyond(lies):
                    self._test = came_along(arm, self._held, width, lies)
            self._continue_test(width)
        yield from arm.settle()
        if self._test is None:
            self._test = came_along(arm, self._held, width, lies)

    def _is_beyond(self, lies: Pose) -> bool:
        return self._left.is_there and _is_beyond(self._arm, self._name, lies)

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
        """Command the fingers to leave `_ROOM_M` on each side of an object of a width, m."""
        gripper = self._arm.gripper
        page = gripper.page
        gripper.command(min(width + 2.0 * _ROOM_M, page.stroke) if page.fingers else 1.0)

    def _refuse_sticking(self) -> None:
        """Attach an object that sticks to the gripper again, and fail."""
        arm = self._arm
        gripper = self._arm.gripper
        name = self._name
        pose = arm.tool_pose @ self._in_tool
        if gripper.why_not(name, pose) is None:
            gripper.hold(name, pose, self._held.most_force, mass_declared=self._held.mass_declared)
        met = "the fingers have met" if gripper.page.fingers else "the cup seals on"
        raise Failure(
            "NOT_PLACED",
            f"{name!r} stuck to the gripper: {met} it again",
            width_m=gripper.width,
            force_n=gripper.force,
        )


def _raised(pose: Pose, height: float) -> Pose:
    return Pose(pose.position + np.array((0.0, 0.0, height)), pose.quaternion)
