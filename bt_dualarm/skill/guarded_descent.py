"""A straight motion of the tool that ends where what it holds meets something."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Final

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.pose import Pose
from bt_dualarm.skill.touch_sense import TouchSense

EDGE_S: Final = 0.35
"""Seconds at the beginning of the way, where joints break loose: no force counts."""


def guarded_descent(
    arm: Arm, end: Pose, speed: float, force: float, look: Callable[[], None]
) -> Generator[float, None, tuple[bool, float]]:
    """Go straight, stop where a force against the motion is felt, and no longer press.

    Yields the progress, once a tick.

    Args:
        arm: Arm that moves.
        end: Pose of the tool in the world at the end of the way.
        speed: Share of its limits, above 0 to 1.
        force: Force in N that ends the way.
        look: Check that is made once a tick, and may raise.

    Returns:
        Whether something was felt, and the largest force until the arm stood, N; that of the
        first `EDGE_S` does not count.

    Raises:
        Failure: As the arm's own motions, and what ``look`` raises.
    """
    start = arm.commanded_tool_pose
    way = end.position - start.position
    sense = TouchSense(arm, way / max(float(np.linalg.norm(way)), 1e-9))
    motion = arm.begin(arm.time_path(arm.line(start, end), speed), may_touch=True)
    began = arm.time
    while not motion.done:
        yield motion.progress
        arm.check()
        look()
        felt = sense.force()
        if arm.time - began <= EDGE_S:
            sense.most = 0.0
        elif felt > force:
            yield from _still(arm, sense)
            return True, sense.most
    return False, sense.most


def _still(arm: Arm, sense: TouchSense) -> Generator[float, None, None]:
    for _ in arm.halt():
        yield 1.0
        sense.force()
    yield from arm.relax()
