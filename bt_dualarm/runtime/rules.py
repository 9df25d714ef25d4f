"""Rules that every run must keep, whatever fails in it; fault injection checks them.

They are judged in the true world, which trees, skills and controllers never read.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from bt_dualarm.behaviors.report import StatusChange
from bt_dualarm.core.pose import Vector
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.runtime.goals import CHECK_S
from bt_dualarm.sim.contact_monitor import arms_of_geoms
from bt_dualarm.sim.world import World

STOPPING_S: Final = 1.0
"""Simulated seconds that an arm has to come to rest after its tree has ended."""

STOPPED: Final = 0.02
"""Joint speed in rad/s below which an arm is at rest."""

REST_S: Final = 0.1
"""Simulated seconds over which that speed is averaged: noise of the encoders shakes an arm at rest
with up to 0.03 rad/s (a Panda in `rough`)."""

POSITION_MARGIN: Final = 0.02
"""How far in rad a joint may be beyond its limit: the controller's error at the limit."""

SPEED_MARGIN: Final = 1.1
"""Multiple of its speed limit that a joint may reach, for the same reason."""


class RuleCheck(IdleObserver):
    """Observes whether arms touch each other, exceed their limits, or move after their trees' end.

    Args:
        world: World of the run.
        of_motion: Whether limits and rest are rules, too. A joint that an injected fault weakens
            or pushes may move whatever its controller does.

    Attributes:
        broken: Sentence on the first rule that was broken, empty while none is.
    """

    def __init__(self, world: World, *, of_motion: bool = True) -> None:
        self._world = world
        self._of_motion = of_motion
        self._next = 0.0
        self._generation = -1
        self._owners = np.empty(0, np.int64)
        self._rests_from: dict[str, float] = {}
        self._resting: dict[str, tuple[float, Vector]] = {}  # where joints were, and when
        self.broken = ""

    def on_event(self, change: StatusChange) -> None:
        """Note the end and the beginning of trees."""
        if "/" in change.path:
            return
        if change.new == "RUNNING":
            self._rests_from.pop(change.arm, None)
            self._resting.pop(change.arm, None)
        else:
            self._rests_from[change.arm] = change.time + STOPPING_S

    def after_step(self, time: float) -> None:
        """Check all rules, once per control period."""
        if self.broken or time < self._next - 1e-9:
            return
        self._next = time + CHECK_S
        if self._generation != self._world.generation:
            self._generation = self._world.generation
            self._owners = arms_of_geoms(self._world)
            self._resting.clear()  # an arm may have come back, and stands elsewhere
        found = self._touching() or (self._moving(time) if self._of_motion else "")
        if found:
            self.broken = f"{found} at {time:.3f} s"

    def _touching(self) -> str:
        """Two arms in contact, as a sentence."""
        contacts = self._world.data.contact
        if not len(contacts.geom):
            return ""
        pairs = self._owners[contacts.geom]
        both = (pairs[:, 0] != pairs[:, 1]) & (pairs.min(axis=1) >= 0)
        both &= contacts.dist <= 0.0
        if not both.any():
            return ""
        names = tuple(self._world.arms)
        first, second = sorted(pairs[int(np.flatnonzero(both)[0])])
        return f"{names[first]} and {names[second]} touch"

    def _moving(self, time: float) -> str:
        """A joint beyond its limits, or of an arm that should be at rest, as a sentence."""
        for name, body in self._world.arms.items():
            q, v, limits = body.q, np.abs(body.v), body.robot.limits
            beyond = np.maximum(limits.lower - q, q - limits.upper)
            if beyond.max() > POSITION_MARGIN:
                joint = body.robot.joints[int(beyond.argmax())]
                return f"{joint} of {name} is {np.degrees(beyond.max()):.1f}° beyond its limit"
            share = v / limits.velocity
            if share.max() > SPEED_MARGIN:
                joint = body.robot.joints[int(share.argmax())]
                return f"{joint} of {name} moves at {100 * share.max():.0f} % of its speed limit"
            if time <= self._rests_from.get(name, np.inf):
                continue
            since, before = self._resting.setdefault(name, (time, q.copy()))
            if time - since < REST_S - 1e-9:
                continue
            self._resting[name] = (time, q.copy())
            mean = np.abs(q - before) / (time - since)
            if mean.max() > STOPPED:
                joint = body.robot.joints[int(mean.argmax())]
                return f"{joint} of {name}, whose tree has ended, moves at {mean.max():.3f} rad/s"
        return ""
