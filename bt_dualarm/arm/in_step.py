"""Motions of two arms that begin together and take the same time.

A motion that begins while its arm is in step with another one waits for the other arm's next
motion. Then both begin in the same control period, the shorter one slowed to the duration of the
longer one. What another arm or an obstacle slows down later slows both.
"""

from __future__ import annotations

from dataclasses import dataclass

from bt_dualarm.trajectory.set_points import TrajectorySource


@dataclass(frozen=True)
class WaitingMotion:
    """A motion that waits for the next motion of another arm.

    Attributes:
        arm: Name of the arm.
        path: Path of its leaf in its tree.
        since: Simulated time in seconds at which it began to wait.
        other: Name of the other arm.
        motion: The motion.
    """

    arm: str
    path: str
    since: float
    other: str
    motion: TrajectorySource


class MotionPair:
    """Motions of two arms in step.

    Nothing that one arm does in a tick affects the other one before `start`, which is called after
    all ticks of a physics step, so that the order of the arms does not matter.

    Args:
        first: Name of one arm.
        second: Name of the other arm.
    """

    def __init__(self, first: str, second: str) -> None:
        self._other = {first: second, second: first}
        self._waiting: dict[str, WaitingMotion] = {}
        self._running: dict[str, TrajectorySource] = {}
        self._scales: dict[str, float] = {}  # largest ones of the running motions alone
        self._alone: set[str] = set()
        self._resumes: set[str] = set()

    @property
    def waiting(self) -> tuple[WaitingMotion, ...]:
        """Motions that wait."""
        return tuple(self._waiting.values())

    def begin(self, arm: str, path: str, time: float, motion: TrajectorySource) -> None:
        """Let a motion wait, which the controller of its arm follows from now on.

        Args:
            arm: Name of the arm.
            path: Path of its leaf in its tree.
            time: Simulated time, s.
            motion: The motion, not begun yet.
        """
        before = self._running.pop(arm, None)
        if before is not None and not before.done:
            self._resumes.add(arm)  # a new plan for a motion that was interrupted
        motion.waits = True
        self._waiting[arm] = WaitingMotion(arm, path, time, self._other[arm], motion)

    def abandon(self, arm: str) -> None:
        """Forget the motion of an arm that was stopped."""
        self._waiting.pop(arm, None)

    def give_up(self, arm: str) -> None:
        """Let the other arm's motion go on alone, as the leaf that moved this arm has ended.

        A motion that is stopped for a new plan still counts, so that the other one waits for it.
        """
        self.abandon(arm)
        running = self._running.get(arm)
        if running is not None and running.partner is not None:
            running.partner.cap(self._scales[self._other[arm]])
            running.partner.partner = None

    def leave(self, arm: str) -> None:
        """Record that an arm begins no further motion in step."""
        self._waiting.pop(arm, None)
        self.be_alone(self._other[arm])

    def be_alone(self, arm: str) -> None:
        """Record that an arm need not wait for motions of the other one any more."""
        self._alone.add(arm)

    def start(self) -> None:
        """Start the motions that need not wait any longer."""
        if len(self._waiting) == 2:
            one, two = self._waiting.values()
            seconds = max(_seconds(one.motion), _seconds(two.motion))
            for waiting in (one, two):
                self._start(waiting, seconds)
            _pair(one.motion, two.motion)
            return
        for arm, waiting in [*self._waiting.items()]:
            other = self._running.get(self._other[arm])
            if other is not None and not other.done and arm in self._resumes:
                # It rejoins the motion with which it was in step.
                left = _seconds(other) * (1.0 - other.progress)
                self._start(waiting, max(left, _seconds(waiting.motion)))
                _pair(waiting.motion, other)
            elif arm in self._alone:
                self._start(waiting, _seconds(waiting.motion))

    def _start(self, waiting: WaitingMotion, seconds: float) -> None:
        motion = waiting.motion
        self._waiting.pop(waiting.arm)
        self._resumes.discard(waiting.arm)
        self._running[waiting.arm] = motion
        self._scales[waiting.arm] = motion.most_scale
        duration = motion.trajectory.duration
        motion.waits = False
        motion.seconds = seconds
        if 0.0 < duration < seconds:
            motion.cap(duration / seconds)


def _pair(one: TrajectorySource, two: TrajectorySource) -> None:
    one.partner = two
    two.partner = one


def _seconds(motion: TrajectorySource) -> float:
    """Time that a motion takes at its largest time scale, s."""
    return motion.trajectory.duration / motion.most_scale
