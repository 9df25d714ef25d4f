"""How an arm moves: one leaf at a time, watched while it lasts, and stopped when that leaf is."""

from __future__ import annotations

import zlib
from collections.abc import Iterator

import numpy as np

from bt_dualarm.arm_state import ArmState
from bt_dualarm.errors import Failure
from bt_dualarm.motion import timing
from bt_dualarm.motion.controller import JointController
from bt_dualarm.motion.motions import Motion, Stream, TrajectoryMotion
from bt_dualarm.motion.plan_watch import PlanWatch
from bt_dualarm.motion.trajectory import Trajectory
from bt_dualarm.world.camera import Camera
from bt_dualarm.world.world import World

SETTLE_S = 1.0
"""Simulated seconds that the arm gets to stand still after the last set-point of a motion."""

HALT_S = 5.0
"""Simulated seconds that an arm gets to come to rest; the hardest stop takes less than one."""

SETTLED_RAD = 5e-4
"""Largest joint error at which a motion counts as executed."""

PATIENCE_S = (0.5, 2.0)
"""Simulated seconds, drawn between these, that an arm waits for another one to clear its way."""

_RELAXATIONS = 4
_YIELD_S = 0.1  # that a contact gets to push the arm away


class ArmMotion(ArmState):
    """Motions and streams of set-points in the hands of the leaf that has begun them.

    Its arguments are those of `ArmState`.
    """

    def __init__(
        self, world: World, name: str, controller: JointController, camera: Camera | None, seed: int
    ) -> None:
        super().__init__(world, name, controller, camera, seed)
        self._owner: list[object] = [None]  # one list for the arm in the hands of all its leaves
        self._begun: Motion | None = None
        self._patience_rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
        self._patience = self._draw_patience()

    def follow(
        self, trajectory: Trajectory, ignore: frozenset[str] = frozenset()
    ) -> Iterator[float]:
        """Execute a motion; yields its progress once a tick until the arm stands at its end.

        Args:
            trajectory: From where the last set-point was.
            ignore: Objects that may be touched.

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
            watch.look(self.time)
            self.refuse_when_held_up(motion)
        yield from self.settle()

    def watch(self, motion: TrajectoryMotion, ignore: frozenset[str] = frozenset()) -> PlanWatch:
        """A check of a motion against the world as it becomes while it runs."""
        return PlanWatch(self.world, self.name, motion, ignore)

    def refuse_when_held_up(self, motion: TrajectoryMotion) -> None:
        """End a motion that the guard has stopped for longer than an arm waits.

        Raises:
            Failure: ``TIMED_OUT`` with what is in the way.
        """
        if motion.held_since is None or self.time - motion.held_since <= self._patience:
            return
        self._patience = self._draw_patience()
        raise Failure(
            "TIMED_OUT",
            f"held up: {motion.held_up}",
            progress=motion.progress,
            waited_s=self.time - motion.held_since,
        )

    def begin(self, trajectory: Trajectory, *, along_path: bool = False) -> TrajectoryMotion:
        """Begin a motion and leave it to the caller to watch it with ``check``.

        Args:
            trajectory: From where the last set-point was.
            along_path: The tool's path matters, not only its end.
        """
        self._claim()
        self._begun = motion = self.controller.follow(trajectory, along_path=along_path)
        return motion

    def stream(self, source: Stream) -> None:
        """Follow a stream of set-points until ``release`` or ``halt``."""
        self._claim()
        self.controller.stream(source)
        self._begun = self.controller.motion

    def halt(self) -> Iterator[None]:
        """Brake with bounded jerk; yields once a tick until the arm stands still.

        Where it stands does not matter: an arm that leans on something is at rest as well.

        Raises:
            Failure: ``TRACKING_ERROR`` when it still moves after ``HALT_S``.
        """
        self._begun = None
        self.controller.stop()
        began = self.time
        while not self.controller.at_rest:
            if self.time - began > HALT_S:
                raise Failure("TRACKING_ERROR", f"the arm still moves {HALT_S:g} s after its stop")
            yield None

    def relax(self) -> Iterator[float]:
        """Take the set-point back to where the arm is, so that it no longer presses on anything.

        What it has pressed on pushes it away as it yields, so this takes a few times; where it
        comes to stand in the end does not matter.

        Raises:
            Failure: ``BUSY`` or ``TRACKING_ERROR``, as ``follow``.
        """
        limits = self.robot.limits
        for _ in range(_RELAXATIONS):
            here = np.clip(self.q, limits.lower, limits.upper)
            way = timing.point_to_point(self.setpoint.q, here, limits, self.period)
            motion, began = self.begin(way), self.time
            latest = began + way.duration + SETTLE_S
            while self.time < began + _YIELD_S or not self.controller.at_rest:
                if self.time > latest:
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
        began = self.time
        while True:
            self.check()
            error = self._servo_error
            if self.controller.at_rest and error < SETTLED_RAD:
                if self._owner[0] is self._leaf:
                    self._owner[0] = None  # what comes next need not wait for the last tremor
                return
            if self.time - began > SETTLE_S:
                raise Failure(
                    "TRACKING_ERROR",
                    f"the arm does not come to rest on its goal: {np.degrees(error):.2f}° away",
                    joint_error_rad=error,
                )
            yield 1.0

    def check(self) -> None:
        """Raise what went wrong with the motion since it began.

        Raises:
            Failure: Among others ``INTERRUPTED``, when something else has stopped it.
        """
        if self.controller.fault is not None:
            raise self.controller.fault
        begun = self._begun
        if begun is not None and not begun.done and self.controller.motion is not begun:
            self._begun = None
            raise Failure(
                "INTERRUPTED",
                f"something else has stopped the motion of {self.name}",
                **({"progress": begun.progress} if isinstance(begun, TrajectoryMotion) else {}),
            )

    def trouble(self) -> Exception | SystemExit | None:
        """What this leaf's motion, stream or camera callback has raised since last asked."""
        if self.camera is not None and self.camera.fault is not None:
            fault, self.camera.fault = self.camera.fault, None
            return fault
        if self._leaf is None or self._owner[0] is not self._leaf:
            return None
        try:
            self.check()
        except (Exception, SystemExit) as trouble:  # noqa: BLE001 - a stream may raise anything
            self.controller.fault = None
            return trouble
        return None

    def release(self) -> None:
        """Stop the motion that this leaf has begun; harmless otherwise."""
        if self._leaf is not None and self._owner[0] is self._leaf:
            self._owner[0] = self._begun = None
            self.controller.stop()

    @property
    def _servo_error(self) -> float:
        """Largest joint error in rad."""
        return float(np.abs(self.setpoint.q - self.q).max())

    def _claim(self) -> None:
        self._refuse_if_busy()
        self._owner[0] = self._leaf

    def _refuse_if_busy(self) -> None:
        owner = self._owner[0]
        if owner is not None and owner is not self._leaf and not self.controller.at_rest:
            raise Failure("BUSY", f"{owner} is moving {self.name} already", owner=str(owner))

    def _draw_patience(self) -> float:
        """Seconds; drawn, so that two arms in each other's way do not try at the same time."""
        return float(self._patience_rng.uniform(*PATIENCE_S))
