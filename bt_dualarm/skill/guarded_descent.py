"""A straight motion of the tool that ends where what it holds meets something."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator
from typing import Final

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.motion.timing.trajectory import Trajectory
from bt_dualarm.pose import Matrix, Pose, Vector
from bt_dualarm.skill.touch_sense import TouchSense

TOUCHDOWN_M_S: Final = 0.002
"""Highest speed in m/s with which things are met: an arm has 6 to 8 kg at its tool, which make 7 N
of it in the first 2 ms."""

_COMPARED_S: Final = 0.08  # over which the tool's way is compared with that of its set-point
_LONG_S: Final = 0.13
_STEADY: Final = 0.75  # share of the highest speed, which differs on the way
_STOPPED: Final = 0.35  # share of the set-point's way; a joint that sticks for a moment leaves more
_LONG_STOPPED: Final = 0.2
_VERY_LONG_S: Final = 0.5  # by then joints have broken loose, however unevenly the set-point goes
_SLOW: Final = 0.3  # share of the speed from which on that counts


def guarded_descent(
    arm: Arm,
    end: Pose,
    speed: float,
    force: float,
    look: Callable[[], None],
    *,
    lightly: bool = False,
) -> Generator[float, None, tuple[bool, float]]:
    """Go straight and give way; stop where something is felt, and press no harder.

    Yields the progress, once a tick. Something is felt where a force against the motion comes up
    and the tool stays behind its set-point, once that goes evenly: friction does not do both.

    Args:
        arm: Arm that moves.
        end: Pose of the tool in the world at the end of the way.
        speed: Share of its limits, above 0 to 1, and no more than `TOUCHDOWN_M_S`.
        force: Force in N that ends the way.
        look: Check that is made once a tick, and may raise.
        lightly: Whether a tool that has stopped for 0.13 s has touched, however little is felt.

    Returns:
        Whether something was felt, and the largest force until the arm stood, N.
    """
    along = _direction(arm.commanded_tool_pose, end)
    timed, top = _timed(arm, arm.line_on(end), speed)
    motion = arm.begin(timed, may_touch=True, compliant=True)
    sense, lag = TouchSense(arm, along), _Lag(arm, along, _STEADY * top)
    while not motion.done:
        yield motion.progress
        arm.check()
        look()
        lag.look()
        felt = sense.force(stands=lag.has_stopped or lag.stands)
        if not (lag.is_steady or lag.stands):
            sense.most = 0.0
        elif (felt > force and lag.has_stopped) or (lightly and lag.stands):
            for _ in arm.halt():
                yield 1.0
                sense.force(stands=True)
            return True, sense.most
    return False, sense.most


def _direction(start: Pose, end: Pose) -> Vector:
    way = end.position - start.position
    along: Vector = way / max(float(np.linalg.norm(way)), 1e-9)
    return along


def _timed(arm: Arm, rows: Matrix, speed: float) -> tuple[Trajectory, float]:
    """The motion through rows of shape (n, dof), rad, and the highest speed of the tool, m/s."""
    motion = arm.time_path(rows, speed)
    steps = np.diff(arm.planned_tool_positions(motion), axis=0)
    top = float(np.linalg.norm(steps, axis=1).max(initial=0.0)) / motion.dt
    if top <= TOUCHDOWN_M_S:
        return motion, top
    return arm.time_path(rows, speed * TOUCHDOWN_M_S / top), TOUCHDOWN_M_S


class _Lag:
    """Whether a tool has stopped while its set-point goes on.

    Args:
        arm: Arm whose tool it is.
        along: Direction of the motion in the world, of unit length, of shape (3,).
        steady_m_s: Speed of the set-point from which on that can be told, m/s.

    Attributes:
        is_steady: Whether it can be told.
        has_stopped: Whether the tool has stopped.
        stands: Whether it has stopped for longer.
    """

    def __init__(self, arm: Arm, along: Vector, steady_m_s: float) -> None:
        self._arm, self._along, self._steady_m_s = arm, along, steady_m_s
        self._past = deque[tuple[float, float, float]]()
        self.is_steady = self.has_stopped = self.stands = False

    def look(self) -> None:
        """Look once a tick."""
        arm, past = self._arm, self._past
        meant = float(arm.commanded_tool_pose.position @ self._along)
        past.append((arm.time, meant, float(arm.tool_pose.position @ self._along)))
        while len(past) > 2 and arm.time - past[1][0] >= _VERY_LONG_S:
            past.popleft()
        self.is_steady, share = self._share(_COMPARED_S, self._steady_m_s)
        self.has_stopped = self.is_steady and share < _STOPPED
        was_steady, share = self._share(_LONG_S, self._steady_m_s)
        was_going, slow_share = self._share(_VERY_LONG_S, _SLOW * self._steady_m_s)
        self.stands = (was_steady and share < _LONG_STOPPED) or (
            was_going and slow_share < _LONG_STOPPED
        )

    def _share(self, seconds: float, least_m_s: float) -> tuple[bool, float]:
        """Whether the set-point was so fast for so long; the tool's share of its way."""
        now, meant_now, here = self._past[-1]
        ago = [one for one in self._past if now - one[0] >= seconds]
        if not ago:
            return False, 1.0
        then, meant_then, was = ago[-1]
        way = meant_now - meant_then
        return way >= least_m_s * (now - then), (here - was) / max(way, 1e-9)
