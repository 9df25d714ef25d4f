"""Watches an arm while it moves: slows it down near other arms, stops it before it meets them.

Nobody tells an arm what another one is going to do. It looks at where it would come to rest if it
braked now, and where the others would if they did the same; as long as that keeps them apart, it
may go on for another look. All arms do so, thus either of two that approach each other stops.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from bt_dualarm.errors import Failure, Number
from bt_dualarm.motion.limiter import SetPoint
from bt_dualarm.motion.motions import Motion, TrajectoryMotion
from bt_dualarm.motion.separation import HORIZON, Gap, Separation
from bt_dualarm.pose import Vector
from bt_dualarm.world.arm_body import ArmBody
from bt_dualarm.world.catalogue import JointLimits
from bt_dualarm.world.world import World

LOOK_S = 0.02
"""Simulated seconds between two looks near another arm."""

FAR_S = 0.04
"""Likewise where nothing is within the horizon: two arms cannot cross it in that time."""

CLEAR_M = 0.03
"""Distance in metres that an arm keeps from others; less where it began nearer to them."""

FLOOR_M = 0.012
"""An arm that is nearer than that comes no nearer at all; before, by `NEARER_M` a motion."""

NEARER_M = 0.002
"""See `FLOOR_M`."""

SLOW = ((0.05, 1.0), (0.025, 0.6), (0.0, 0.3))
"""From how many metres beyond that distance on an arm goes at which pace."""

SINGULAR_CONDITION = 50.0
"""Condition number of the Jacobian from which a motion along a path goes at half pace."""

NEAR_LIMIT = 0.01
"""Distance in rad of a joint from its position limit from which a path is gone at half pace."""

RESUME_S = 0.4
"""Planned seconds ahead that must be clear before an arm that was stopped goes on."""

STEP_RAD = 0.15
"""Between two configurations that are looked at on the way to rest."""

_UNWANTED_DEPTH = 5e-4  # metres: less is a touch
_EVERY = 5  # looks between two at what is recorded only


@dataclass
class GuardReport:
    """What a guard has seen and done; distances are of the arm while it moved.

    Attributes:
        nearest_arm_m: Smallest distance to another arm, infinite if never within reach.
        nearest_limit_rad: Smallest distance of a joint from its position limit.
        worst_condition: Largest condition number of the Jacobian.
        slowed: How often it made the arm go slower; ``stopped`` likewise.
        last_reason: For the last of these.
    """

    nearest_arm_m: float = float("inf")
    nearest_limit_rad: float = float("inf")
    worst_condition: float = 1.0
    slowed: int = 0
    stopped: int = 0
    last_reason: str = ""

    def as_dict(self) -> dict[str, Number]:
        """For the summary; what is infinite is left out."""
        return {name: value for name, value in vars(self).items() if value != float("inf")}


class Guard:
    """Judges what one arm is about to do.

    Args:
        world: That the arm is in.
        name: Of the arm.

    Attributes:
        report: So far.
    """

    def __init__(self, world: World, name: str) -> None:
        self.report = GuardReport()
        self._posture = 1.0, ""
        self._world, self._name = world, name
        self._robot = world.robots[name]
        self._motion: Motion | None = None
        self._clear = CLEAR_M
        self._far = False
        self._next = 0.0
        self._looks = 0
        self._generation = -1
        self._jacobian = np.zeros((6, 0))

    def due(self, time: float) -> bool:
        """Whether it is time for a look."""
        return time >= self._next

    def look(self, motion: Motion, sent: SetPoint, time: float) -> Failure | None:
        """Slow the motion down, or let it go on; returns why it must be given up, if so."""
        self._next = time + self._period - 1e-9
        if self._generation != self._world.generation:
            self._bind()
        if motion is not self._motion:
            self._begin(motion)
        self._looks += 1
        contact = self._unwanted_contact()
        if contact is not None:
            return self._stopped(contact)
        pace, reason = self._pace_of_posture(motion)
        if not self._separation.alone:
            gap = self._gap_ahead(motion, sent)
            near, why = self._pace_near(gap)
            if near < pace:
                pace, reason = near, why
        if isinstance(motion, TrajectoryMotion):
            return self._hold(motion, pace, reason, time)
        if pace == 0.0:
            return self._stopped(Failure("IN_COLLISION", reason))
        return None

    def _begin(self, motion: Motion) -> None:
        self._motion, self._far = motion, False
        self._clear = CLEAR_M
        if not self._separation.alone:
            self._clear = clearance(self._present_gap().metres, CLEAR_M)

    def _hold(
        self, motion: TrajectoryMotion, pace: float, reason: str, time: float
    ) -> Failure | None:
        """Give the motion its pace; a failure where it cannot be stopped on its path."""
        if motion.changing and pace > 0.0:
            return None
        goal = motion.goal_pace
        if pace == goal or (pace > 0.0 and motion.done):
            return None
        if not motion.go_at(pace, self._robot.limits, promptly=pace == 0.0):
            if pace > 0.0:
                return None  # at full acceleration already: at one of the next looks
            return self._stopped(Failure("IN_COLLISION", reason, progress=motion.progress))
        if pace < goal:
            self.report.slowed += pace > 0.0
            self.report.stopped += pace == 0.0
            self.report.last_reason = reason
        motion.held_up = reason if pace == 0.0 else ""
        motion.held_since = time if pace == 0.0 else None
        return None

    def _gap_ahead(self, motion: Motion, sent: SetPoint) -> Gap:
        """The smallest distance on the way to where all would come to rest."""
        own = self._ways(motion, sent)
        others = {
            name: self._stop_of(body)
            for name, body in self._world.arms.items()
            if name != self._name
        }
        gaps = []
        if self._looks % _EVERY == 0:
            gaps.append(self._present_gap())
        # Far from all, half of the way is looked at every other time.
        for share, q in own[self._looks % 2 :: 2] if self._far else own:
            moved = {name: now + share * way for name, (now, way) in others.items()}
            gaps.append(self._separation.gap({self._name: q, **moved}))
        nearest = min(gaps, key=lambda gap: gap.metres)
        self._far = nearest.metres > HORIZON
        return nearest

    def _ways(self, motion: Motion, sent: SetPoint) -> list[tuple[float, Vector]]:
        """Shares of the others' way to rest, and where this arm is then."""
        limits, here = self._robot.limits, sent.q
        way = self._stopping_way(sent.v, limits)
        if isinstance(motion, TrajectoryMotion):
            begin, end = motion.place.s, self._end_of(motion, sent)
            if end is not None:
                shares = _shares(motion.configuration(end) - here)
                return [(x, motion.configuration(begin + x * (end - begin))) for x in shares]
        return [(x, here + x * way) for x in _shares(way)]

    def _end_of(self, motion: TrajectoryMotion, sent: SetPoint) -> float | None:
        """Place in s where a motion would end if it were stopped after this look.

        Far from others an estimate that errs to the safe side is enough.
        """
        limits, place = self._robot.limits, motion.place
        if motion.goal_pace == 0.0:
            return place.s + RESUME_S
        reaction = place.pace * self._period
        if self._far:
            time = float((np.abs(sent.v) / limits.acceleration).max())
            ramp = float((limits.acceleration / limits.jerk).max())
            return place.s + reaction + place.pace * (1.2 * time + 2 * ramp)
        end = motion.stopping_place(limits)
        return None if end is None else end + reaction

    def _stop_of(self, body: ArmBody) -> tuple[Vector, Vector]:
        """Where another arm is, and its way to rest, each of shape (dof,)."""
        return body.q, self._stopping_way(body.v, body.robot.limits)

    def _stopping_way(self, v: Vector, limits: JointLimits) -> Vector:
        """How far joints go until they rest, of shape (dof,): after a look, braking as they can."""
        time = np.abs(v) / limits.acceleration + limits.acceleration / limits.jerk
        way: Vector = v * (self._period + 0.5 * time)
        return way

    @property
    def _period(self) -> float:
        return FAR_S if self._far else LOOK_S

    def _present_gap(self) -> Gap:
        gap = self._separation.gap({})
        self.report.nearest_arm_m = min(self.report.nearest_arm_m, gap.metres)
        return gap

    def _pace_near(self, gap: Gap) -> tuple[float, str]:
        standing = self._motion
        held = isinstance(standing, TrajectoryMotion) and standing.goal_pace == 0.0
        clear = self._clear + (0.01 if held else 0.0)
        if gap.metres > HORIZON:
            return 1.0, ""
        reason = (
            f"{gap.first} would come to within {1e3 * max(gap.metres, 0.0):.0f} mm of {gap.second}"
        )
        if gap.metres < clear:
            return 0.0, reason
        pace = next((pace for least, pace in SLOW if gap.metres >= self._clear + least), 0.3)
        return pace, reason

    def _pace_of_posture(self, motion: Motion) -> tuple[float, str]:
        """Slower along a path where the arm is nearly singular, or a joint nearly at its limit."""
        if self._looks % _EVERY:
            return self._posture
        body, report = self._world.arms[self._name], self.report
        q, limits = body.q, self._robot.limits
        room = float(min((q - limits.lower).min(), (limits.upper - q).min()))
        report.nearest_limit_rad = min(report.nearest_limit_rad, room)
        condition = self._condition(body)
        report.worst_condition = max(report.worst_condition, condition)
        self._posture = 1.0, ""
        if isinstance(motion, TrajectoryMotion) and motion.along_path:
            if condition > SINGULAR_CONDITION:
                self._posture = 0.5, f"condition {condition:.0f}"
            elif room < NEAR_LIMIT:
                self._posture = 0.5, f"{room:.3f} rad from a limit"
        return self._posture

    def _condition(self, body: ArmBody) -> float:
        model, data = self._world.model, self._world.data
        mujoco.mj_jacSite(model, data, self._jacobian[:3], self._jacobian[3:], body.tool_site)
        values = np.linalg.svd(self._jacobian[:, body.dof_ids], compute_uv=False)
        return float(values[0] / max(values[-1], 1e-9))

    def _unwanted_contact(self) -> Failure | None:
        """A link, other than the tool's, that is in something."""
        data = self._world.data
        if data.ncon == 0:
            return None
        geoms = data.contact.geom
        links = self._links[geoms]
        hits = np.flatnonzero((links[:, 0] != links[:, 1]) & ~self._mine[geoms].all(axis=1))
        for i in hits.tolist():
            depth = -float(data.contact.dist[i])
            if depth > _UNWANTED_DEPTH:
                return self._failure_of(geoms[i].tolist(), depth)
        return None

    def _failure_of(self, geoms: list[int], depth: float) -> Failure:
        model = self._world.model
        names = [
            model.body(model.geom_bodyid[g]).name or model.geom(g).name or "the scene"
            for g in sorted(geoms, key=lambda g: not self._links[g])
        ]
        return Failure(
            "IN_COLLISION",
            f"{names[0]} touches {names[1]}",
            first=names[0],
            second=names[1],
            depth_m=depth,
        )

    def _stopped(self, failure: Failure) -> Failure:
        self.report.stopped += 1
        self.report.last_reason = failure.reason
        return failure

    def _bind(self) -> None:
        """Look up what a recompilation of the world has moved."""
        world = self._world
        self._generation = world.generation
        self._motion = None
        self._separation = Separation(world, self._name)
        body = world.arms[self._name]
        self._mine = np.zeros(world.model.ngeom, dtype=bool)
        self._mine[list(body.geom_ids)] = True
        self._links = self._mine.copy()
        self._links[list(body.tool_geom_ids)] = False
        self._jacobian = np.zeros((6, world.model.nv))
        self._posture = 1.0, ""


def clearance(present: float, wanted: float) -> float:
    """Distance to keep, in metres, by an arm that may already be nearer than is wanted."""
    return min(wanted, max(present - NEARER_M, min(present, FLOOR_M)))


def _shares(way: Vector) -> list[float]:
    """Of a way to rest that are looked at, the last of them its end."""
    count = min(max(int(np.ceil(np.abs(way).max() / STEP_RAD)), 2), 6)
    return [(i + 1) / count for i in range(count)]
