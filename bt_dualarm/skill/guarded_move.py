"""Guarded moves: compliant motions that end at a contact, and the detection of that contact."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator
from typing import Final

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.skill.grip import TouchSense
from bt_dualarm.trajectory.set_points import TrajectorySource

TOUCHDOWN_M_S: Final = 0.002
"""Highest speed at contact, m/s: with an effective mass of 6 to 8 kg at the tool it makes 7 N in
the first 2 ms."""

# A tool has stopped if, over a time window, it covers less than a fraction of its set-point's
# distance while the set-point is faster than a fraction of its highest speed.
_COMPARED_S: Final = 0.08
_SHORT_S: Final = 0.06  # enough where contact is expected
_LONG_S: Final = 0.13
_VERY_LONG_S: Final = (
    0.5  # by then joints have broken away, however uneven the set-point's speed is
)
_CREEPS_S: Final = 1.5  # for something soft, which slows the tool, and does not stop it
_BRISK: Final = 0.1  # a guarded descent begins with this fraction of the acceleration limits
_STEADY: Final = 0.75  # fraction of the highest speed, which varies along the path
_SLOW: Final = 0.3  # the same for the longest window
_STOPPED: Final = 0.35  # fraction of the distance; a joint that sticks briefly leaves more
_LONG_STOPPED: Final = 0.2
_CREEPING: Final = 0.5  # the same for a tool that something soft slows
_SOFTLY: Final = 1.5  # multiple of the force, as friction may change within that time


def guarded_descent(
    arm: Arm,
    end: Pose,
    speed: float,
    force: float,
    look: Callable[[], None],
    *,
    lightly: bool = False,
) -> Generator[float, None, tuple[bool, float]]:
    """Compliant straight motion that stops on contact (guarded move); yields the progress.

    Contact is detected if a force against the motion rises and the tool lags its steadily moving
    set-point: friction alone does not cause both. Against something soft, such as a part in another
    hand, both happen slowly.

    Args:
        arm: Arm that moves.
        end: Pose of the tool in the world at the end.
        speed: Fraction of its limits, above 0 to 1, and no more than `TOUCHDOWN_M_S`.
        force: Contact force that ends the motion, N.
        look: Check that is called once per tick, and may raise.
        lightly: Whether a stop of 0.13 s counts as contact, however small the force is.

    Returns:
        Whether there was contact, and the largest force until the arm was at rest, N.
    """
    along = _direction(arm.commanded_tool_pose, end)
    timed, top = arm.slow_path(arm.line_on(end), speed, TOUCHDOWN_M_S, _BRISK)
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
        yields = lag.creeps and sense.slow_rise > _SOFTLY * force
        meant = arm.commanded_tool_pose.position
        is_behind = float((meant - arm.tool_pose.position) @ along) > behind_m
        if yields:
            sense.most = max(sense.most, sense.slow_rise)
        elif not (lag.is_steady or lag.stands or is_behind or stops):
            sense.most = 0.0
        if (
            yields
            or is_behind
            or stops
            or (felt > force and lag.has_stopped)
            or (lightly and lag.stands)
        ):
            most = sense.most
            if touched is not None:
                touched()
            for _ in arm.halt():
                yield 1.0
                sense.force(stands=True)
            return True, sense.most if touched is None else most
    return False, max(sense.most, sense.slow_rise)


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
        creeps: Whether it has covered less than half of the distance in a still longer time.
        stops: Whether it has come to a stop for a short time: joints that stick do so as well.
    """

    def __init__(self, arm: Arm, along: Vector, steady_m_s: float) -> None:
        self._arm = arm
        self._along = along
        self._steady_m_s = steady_m_s
        self._past = deque[tuple[float, float, float]]()
        self.is_steady = self.has_stopped = self.stands = self.stops = self.creeps = False

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
        while len(past) > 2 and arm.time - past[1][0] >= _CREEPS_S:
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
        was_going, slow_share = self._share(_CREEPS_S, _SLOW * steady_m_s)
        self.creeps = was_going and slow_share < _CREEPING

    def _share(self, seconds: float, least_m_s: float) -> tuple[bool, float]:
        """Whether the set-point is fast enough; fraction of its distance covered by the tool."""
        now, meant_now, here = self._past[-1]
        ago = [one for one in self._past if now - one[0] >= seconds]
        if not ago:
            return False, 1.0
        then, meant_then, was = ago[-1]
        distance = meant_now - meant_then
        return distance >= least_m_s * (now - then), (here - was) / max(distance, 1e-9)
