"""Setting down by touch what a gripper holds, and letting go of it."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping
from typing import Final

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.errors import Failure, Number
from bt_dualarm.motion.collision.support import MARGIN_M, support_below
from bt_dualarm.motion.planning.planners import Planner
from bt_dualarm.motion.timing.trajectory import Trajectory
from bt_dualarm.pose import Matrix, Pose
from bt_dualarm.skill.grip import Grip
from bt_dualarm.skill.guarded_descent import guarded_descent
from bt_dualarm.skill.left_standing import LeftStanding
from bt_dualarm.spec.ports import PortModel, port
from bt_dualarm.spec.values import Angle, Duration, Speed
from bt_dualarm.world.attachments import Attachment

_ROOM_M: Final = 0.01  # that the fingers open beside the object at least
_FREE_M: Final = 0.006  # above the goal, down to where nothing may be in the way
_OFF_M: Final = 0.003  # back, until it leans on nothing
_LOWERING: Final = 0.3  # of the speed, down to there
_WAYS: Final = 3  # branches of the inverse kinematics that a plan may choose from
_TRIES: Final = 12  # branches that are looked at, until none counts as free


class SettingDownPorts(PortModel):
    """How something is set down."""

    height: float = port(0.05, "height from which it is lowered", unit="m", ge=0.01, le=0.3)
    force: float = port(5.0, "force by which the ground is felt", unit="N", ge=1, le=100)
    search: float = port(0.015, "how much lower the ground may be", unit="m", ge=0.001, le=0.1)
    retreat: float = port(0.08, "how far the gripper goes back", unit="m", ge=0.01, le=0.3)
    tolerance: float = port(
        0.008,
        "largest difference in height at the touch, and distance of the object at the end",
        unit="m",
        ge=1e-3,
        le=0.1,
    )
    angle_tolerance: Angle = port(
        5.0, "largest turn of the object at the end, as far as one can be seen", ge=0.1, le=90
    )
    settle: Duration = port(1.0, "longest that coming to rest may take", gt=0, le=30)
    speed: Speed = port(0.5, "share of the arm's limits on the way there")
    down_speed: Speed = port(0.003, "share of the arm's limits where it may touch")
    planner: Planner = port("RRTConnect", "searches where the straight way is not free")


class SettingDown:
    """One thing being set down.

    Args:
        arm: Arm whose gripper holds it.
        ports: How it is to go about it.
        held: What it holds.
        metrics: What was measured on the way, to be filled.

    Attributes:
        failures: Codes that setting something down may end with, and what they mean.
    """

    failures: Final[Mapping[str, str]] = {
        "NOT_SUPPORTED": "by what is declared below, it would tip over, slide or roll away",
        "NOT_REACHED": "it touched something before it was down",
        "NO_CONTACT": "nothing was felt below it",
        "NOT_OPEN": "the fingers did not open",
        "SLIPPED": "the object slid between the fingers on the way",
        "DROPPED": "the object was lost on the way",
        "NOT_PLACED": "it does not stay there: it fell, slid, was moved, sticks to the gripper, or "
        "was not held as the arm believed",
    }

    def __init__(
        self, arm: Arm, ports: SettingDownPorts, held: Attachment, metrics: dict[str, Number]
    ) -> None:
        self._arm, self._ports, self._metrics = arm, ports, metrics
        self._thing = held.object
        self._in_tool = arm.robot.tool.inverse @ held.relative

    def through(self, goal: Pose) -> Generator[float | None, None, Pose]:
        """Lower it to a pose in the world, until it touches; open; go back.

        Yields the progress once a tick; returns the pose in the world at which it was let go, by
        what the arm believes.

        Args:
            goal: Pose of the object in the world.

        Raises:
            Failure: ``NOT_SUPPORTED`` before it moves, ``NO_CONTACT``, ``NOT_REACHED``,
                ``NOT_OPEN``, ``SLIPPED``, ``DROPPED``; what motions raise.
        """
        arm, tool, grip = self._arm, goal @ self._in_tool.inverse, Grip(self._arm, self._thing)
        grip.look()
        self._refuse_unsupported(goal)
        yield None
        try:
            yield from self._go_above(tool, grip)
            yield from self._lower(tool, grip)
        except Failure as failure:
            if failure.code == "SLIPPED":
                yield from grip.judge(failure)
            raise
        lies = arm.tool_pose @ self._in_tool
        self._metrics["believed_error_m"] = lies.distance(goal)
        yield from self._release()
        return lies

    def stays_at(self, goal: Pose, within_m: float | None = None) -> Iterator[float]:
        """Wait until what `through` has left rests, and see that it stands there, as a referee.

        Yields the progress once a tick.

        Args:
            goal: Pose of the object in the world.
            within_m: Largest distance of the object from there, m; by default the tolerance of the
                ports.

        Raises:
            Failure: ``NOT_PLACED``, see `LeftStanding`.
        """
        yield from self._left.until_rest(self._ports.settle)
        if self._left.is_there:
            away, turned = self._left.away_from(goal)
            self._metrics |= {"placed_error_m": away, "placed_turned_rad": turned}
        within = self._ports.tolerance if within_m is None else within_m
        self._left.refuse_unless_at(goal, within, self._ports.angle_tolerance)

    def _refuse_unsupported(self, goal: Pose) -> None:
        """Look whether it would stand there, by the shapes that plans know."""
        ports, thing = self._ports, self._thing
        found = support_below(self._arm.world, thing, goal, ports.tolerance, ports.search)
        if found is None:
            return  # nothing is known of what is below: the touch will tell
        if found.rolls:
            why = "would roll away: what is below it is not level"
        elif found.tilt > ports.angle_tolerance:
            why = (
                f"would tip by {np.degrees(found.tilt):.0f}°: its center of mass is not "
                f"{1e3 * MARGIN_M:.0f} mm or more inside of what bears it"
            )
        elif found.slides:
            why = (
                f"would slide down a slope of {np.degrees(found.slope):.0f}° with a coefficient of "
                f"friction of {found.friction:.2g}"
            )
        else:
            return
        raise Failure(
            "NOT_SUPPORTED",
            f"{thing!r} {why}",
            tilt_rad=found.tilt,
            slope_rad=found.slope,
            friction=found.friction,
        )

    def _go_above(self, tool: Pose, grip: Grip) -> Iterator[float]:
        """Go to above the goal, in a branch in which the arm gets down and back out from there."""
        arm, ports = self._arm, self._ports
        ways: list[Matrix] = []

        def planned() -> Generator[None, None, Trajectory]:
            ways[:] = yield from self._ways_down(tool)
            starts = [way[0] for way in ways]
            return (yield from arm.plan(starts, ports.speed, planner=ports.planner))

        for progress in arm.past_others(ports.speed).along(planned):
            yield 0.5 * (progress or 0.0)
            grip.look()
        down = min(ways, key=lambda way: float(np.abs(way[0] - arm.setpoint.q).max()))
        for _ in arm.past_others(ports.speed).until_free(down, known_free=True):
            yield 0.5
            grip.look()

    def _ways_down(self, tool: Pose) -> Generator[None, None, list[Matrix]]:
        """The straight line down to a pose of the tool, in branches that allow all that follows.

        That is the way on to where nothing would be felt, and the way back out from the pose. The
        arm and what it holds touch nothing down to `_FREE_M`, and the arm alone nothing on the way
        out. Yields once for each branch that is looked at.

        Returns:
            Configurations down to there, of shape (n, dof), rad, each; the preferred one first.

        Raises:
            Failure: Of the preferred branch, if there is none: ``IN_COLLISION``, ``PATH_BROKEN``
                or ``SINGULAR``; ``UNREACHABLE``.
        """
        arm, ports, thing = self._arm, self._ports, frozenset({self._thing})
        corners = [_raised(tool, height) for height in (ports.height, _FREE_M, 0.0, -ports.search)]
        found: list[Matrix] = []
        refusals: list[Failure] = []
        for down, low, _ in arm.lines(*corners):
            try:
                arm.refuse_collision_along(down)
                out = arm.line_after(low[-1], tool @ Pose.from_rpy((0.0, 0.0, -ports.retreat)))
                arm.refuse_collision_along(out, ignore=thing)
            except Failure as failure:
                refusals.append(failure.with_traceback(None))  # that refers to this frame
            else:
                found.append(down)
            yield
            if len(found) == _WAYS or len(refusals) == _TRIES:
                break
        if not found:
            raise refusals[0]
        return found

    def _lower(self, tool: Pose, grip: Grip) -> Iterator[float | None]:
        """Go down until the ground is felt, and press no harder on it."""
        arm, ports = self._arm, self._ports
        move = arm.past_others(_LOWERING * ports.speed)
        for progress in move.straight(_raised(tool, _FREE_M), known_free=True):
            yield 0.5 + 0.1 * (progress or 0.0)
            grip.look()
        low, force = _raised(tool, -ports.search), grip.firm_for(ports.force)
        felt, most = yield from guarded_descent(
            arm, low, ports.down_speed, force, grip.look, lightly=True
        )
        if not felt:
            yield from arm.settle()
            raise Failure(
                "NO_CONTACT",
                f"nothing is felt {1e3 * ports.search:.0f} mm below where it is to stand",
            )
        height = float(arm.tool_pose.position[2] - tool.position[2])
        self._metrics |= {"impact_n": most, "height_off_m": height}
        if abs(height) > ports.tolerance:
            yield from arm.relax()
            raise Failure(
                "NOT_REACHED",
                f"it touched something {1e3 * height:.1f} mm above where it was to stand",
                height_off_m=height,
                force_n=most,
            )

    def _release(self) -> Iterator[float | None]:
        """Open, and go back out of the fingers' way."""
        arm, ports = self._arm, self._ports
        gripper, page = arm.gripper, arm.gripper.page
        wide = gripper.width + 2.0 * _ROOM_M
        gripper.command(min(wide, page.stroke) if page.fingers else 1.0)
        for _ in gripper.until_open():
            yield 0.85
        gripper.let_go(self._thing)
        self._left = LeftStanding(arm, self._thing)
        yield from self._come_off()
        back = arm.commanded_tool_pose @ Pose.from_rpy((0, 0, -ports.retreat))
        for progress in arm.past_others(0.3 * ports.speed, frozenset({self._thing})).straight(back):
            self._left.look()
            yield 0.85 + 0.15 * (progress or 0.0)

    def _come_off(self) -> Iterator[float]:
        """A little way back, giving way still: it leans on what it has let go of."""
        arm = self._arm
        off = arm.commanded_tool_pose @ Pose.from_rpy((0.0, 0.0, -_OFF_M))
        motion = arm.begin(
            arm.time_path(arm.line_on(off), _LOWERING), may_touch=True, compliant=True
        )
        while not motion.done:
            yield 0.85
            arm.check()


def _raised(pose: Pose, height: float) -> Pose:
    return Pose(pose.position + np.array((0.0, 0.0, height)), pose.quaternion)
