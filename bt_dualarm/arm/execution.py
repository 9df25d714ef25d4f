"""How an arm moves: watched while that lasts, and stopped when its leaf is halted."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bt_dualarm.arm.lease import Leaseholder
from bt_dualarm.arm.patience import Patience
from bt_dualarm.arm.slip_response import SlipResponse
from bt_dualarm.arm.state import ArmState
from bt_dualarm.arm.touching import Touching
from bt_dualarm.errors import RAISED_BY_SKILLS, BlockedFailure, Failure, SkillError
from bt_dualarm.motion.safety.plan_monitor import PlanMonitor
from bt_dualarm.motion.setpoints.set_point import SetPointSource
from bt_dualarm.motion.setpoints.stream_source import Stream
from bt_dualarm.motion.setpoints.trajectory_source import TrajectorySource
from bt_dualarm.motion.timing.point_to_point import point_to_point
from bt_dualarm.motion.timing.trajectory import Trajectory

SETTLE_S = 1.0
"""Simulated seconds that the arm gets to stand still after the last set-point of a motion."""

HALT_S = 5.0
"""Simulated seconds that an arm gets to come to rest; the hardest stop takes less than one."""

SETTLED_RAD = 5e-4
"""Largest joint error at which a motion counts as executed."""

_RELAXATIONS = 4
_YIELD_S = 0.1  # that a contact gets to push the arm away


class Executor:
    """Motions and streams of set-points of one leaf, which needs the arm's lease for them.

    Args:
        arm: State of the arm.
        lease: Lease of the arm, as the leaf holds it.
        patience: Time that the arm waits for another one.
        touching: Score of what the arm touches while the leaf moves it.
        slip: Watch over what the gripper holds.
    """

    def __init__(
        self,
        arm: ArmState,
        lease: Leaseholder,
        patience: Patience,
        touching: Touching,
        slip: SlipResponse,
    ) -> None:
        self._arm = arm
        self._controller = arm.controller
        self._lease = lease
        self._patience = patience
        self._touching = touching
        self._slip = slip
        self._begun: SetPointSource | None = None

    def follow(
        self, trajectory: Trajectory, ignore: frozenset[str] = frozenset()
    ) -> Iterator[float]:
        """Execute a motion; yields its progress once a tick until the arm stands at its end.

        Args:
            trajectory: Motion that begins at the last set-point.
            ignore: Names of the objects that may be touched.

        Raises:
            Failure: ``BUSY`` when another leaf moves the arm, ``TRACKING_ERROR`` when the arm
                cannot follow, ``IN_COLLISION`` when something has come into the way,
                ``TIMED_OUT`` when another arm does not leave it, ``INTERRUPTED``.
        """
        motion = self.begin(trajectory)
        watch = self.watch(motion, ignore)
        while not motion.done:
            yield motion.progress
            self.check()
            watch.look(self._arm.time)
            self.refuse_when_held_up(motion)
        yield from self.settle()

    def watch(self, motion: TrajectorySource, ignore: frozenset[str] = frozenset()) -> PlanMonitor:
        """A check of a motion against the world as it becomes while it runs."""
        return PlanMonitor(self._arm.world, self._arm.name, motion, ignore)

    def refuse_when_held_up(self, motion: TrajectorySource) -> None:
        """End a motion that the guard has stopped for longer than an arm waits.

        Raises:
            Failure: ``TIMED_OUT`` with what is in the way.
        """
        waited_s = 0.0 if motion.held_since is None else self._arm.time - motion.held_since
        if waited_s <= self._patience.seconds:
            return
        self._patience.renew()
        raise BlockedFailure(
            "TIMED_OUT",
            f"held up: {motion.held_up}",
            progress=motion.progress,
            waited_s=waited_s,
        )

    def begin(
        self,
        trajectory: Trajectory,
        *,
        along_path: bool = False,
        may_touch: bool = False,
        compliant: bool = False,
    ) -> TrajectorySource:
        """Begin a motion and leave it to the caller to watch it with ``check``.

        Args:
            trajectory: Motion that begins at the last set-point.
            along_path: Whether the tool's path matters, not only its end.
            may_touch: Whether the arm is meant to touch something, so that it minds no hit.
            compliant: Whether it gives way to what it meets, until the next motion begins.
        """
        self._lease.take()
        self._touching.begin()
        self._slip.may_touch = may_touch
        self._begun = motion = self._controller.follow(
            trajectory, along_path=along_path, may_touch=may_touch, compliant=compliant
        )
        return motion

    def stream(self, source: Stream) -> None:
        """Follow a stream of set-points until ``release`` or ``halt``."""
        self._lease.take()
        self._touching.begin()
        self._slip.may_touch = False
        self._controller.stream(source)
        self._begun = self._controller.motion

    def halt(self) -> Iterator[None]:
        """Brake with bounded jerk; yields once a tick until the arm stands still.

        Where it stands does not matter: an arm that leans on something is at rest as well. A
        compliant one then presses no harder, however long it stands.

        Raises:
            Failure: ``TRACKING_ERROR`` when it still moves after ``HALT_S``.
        """
        self._lease.refuse_other_threads()
        self._begun = None
        self._controller.stop()
        began = self._arm.time
        while not self._controller.at_rest:
            if self._arm.time - began > HALT_S:
                raise Failure("TRACKING_ERROR", f"the arm still moves {HALT_S:g} s after its stop")
            yield None

    def relax(self) -> Iterator[float]:
        """Take the set-point back to where the arm is, so that it no longer presses on anything.

        What it has pressed on pushes it away as it yields, so this takes a few times; where it
        comes to stand in the end does not matter.

        Raises:
            Failure: ``BUSY`` or ``TRACKING_ERROR``, as ``follow``.
        """
        limits = self._arm.robot.limits
        for _ in range(_RELAXATIONS):
            here = np.clip(self._arm.q, limits.lower, limits.upper)
            way = point_to_point(self._arm.setpoint.q, here, limits, self._arm.period)
            motion = self.begin(way, may_touch=True, compliant=self._controller.compliance.active)
            began = self._arm.time
            latest = began + way.duration + SETTLE_S
            while self._arm.time < began + _YIELD_S or not self._controller.at_rest:
                if self._arm.time > latest:
                    break
                yield motion.progress
                self.check()
            if self._servo_error < SETTLED_RAD:
                return

    def settle(self) -> Iterator[float]:
        """Wait until the arm stands on its last set-point; yields once a tick.

        Raises:
            Failure: ``TRACKING_ERROR`` when it does not get there.
        """
        self._controller.compliance.active = False
        began = self._arm.time
        while True:
            self.check()
            error = self._servo_error
            if self._controller.at_rest and error < SETTLED_RAD:
                self._lease.give_back()  # what comes next need not wait for the last tremor
                return
            if self._arm.time - began > SETTLE_S:
                raise Failure(
                    "TRACKING_ERROR",
                    f"the arm does not come to rest on its goal: {np.degrees(error):.2f}° away",
                    joint_error_rad=error,
                )
            yield 1.0

    def check(self) -> None:
        """Raise what went wrong with the motion since it began.

        Raises:
            Failure: Among others ``INTERRUPTED``, when something else has stopped it, and
                ``DROPPED``, when the gripper has lost what it held.
        """
        if self._controller.fault is not None:
            raise self._controller.fault
        self._slip.refuse_lost()
        begun = self._begun
        if begun is not None and not begun.done and self._controller.motion is not begun:
            self._begun = None
            raise Failure(
                "INTERRUPTED",
                f"something else has stopped the motion of {self._arm.name}",
                **({"progress": begun.progress} if isinstance(begun, TrajectorySource) else {}),
            )

    def trouble(self) -> BaseException | None:
        """What has gone wrong with this leaf's motion or stream since last asked."""
        if self._lease.intrusion:
            error, self._lease.intrusion = SkillError(self._lease.intrusion), ""
            return error
        if not self._lease.has_it:
            return None
        try:
            self.check()
        except RAISED_BY_SKILLS as trouble:
            self._controller.fault = None
            return trouble
        return None

    def release(self) -> None:
        """Stop the motion that this leaf has begun; harmless otherwise."""
        if self._lease.give_back():
            self._begun = None
            if self._arm.is_present:
                self._controller.stop()

    @property
    def _servo_error(self) -> float:
        """Largest joint error in rad."""
        return float(np.abs(self._arm.setpoint.q - self._arm.q).max())
