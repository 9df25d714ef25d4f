"""Nodes with one child, on simulated time: py_trees' own Timeout and Timer read wall clocks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, Self

from py_trees import decorators
from py_trees.behaviour import Behaviour
from py_trees.common import OneShotPolicy, Status

from bt_dualarm.errors import Failure
from bt_dualarm.spec import decorator_words
from bt_dualarm.tree.composites import Node, Ticks
from bt_dualarm.tree.exchanging import Became
from bt_dualarm.tree.parts import Parts
from bt_dualarm.tree.time import reached
from bt_dualarm.tree.watched import Watched

_ROUNDING: Final = 1e-6
"""Share of a period, for times that are sums of time steps."""


class Decorator(Watched, decorators.Decorator):
    """Base of py_trees' own."""

    @classmethod
    def of(cls, parts: Parts) -> Self:
        """One on the only child."""
        return cls(parts.name, parts.children[0])

    def exchange(
        self, children: Sequence[Behaviour], slots: tuple[str, ...], became: Became
    ) -> bool:
        """Go on with another child."""
        self.decorated = children[0]
        return super().exchange(children, slots, became)


class Inverter(Decorator, decorators.Inverter):
    """py_trees' own."""

    word = decorator_words.INVERTER


class ForceSuccess(Decorator, decorators.FailureIsSuccess):
    """py_trees' own, under a name that says what it is for."""

    word = decorator_words.FORCE_SUCCESS


class ForceFailure(Decorator, decorators.SuccessIsFailure):
    """py_trees' own, under a name that says what it is for."""

    word = decorator_words.FORCE_FAILURE


class RunOnce(Decorator, decorators.OneShot):
    """py_trees' own: an end counts, a halt does not."""

    word = decorator_words.RUN_ONCE

    def __init__(self, name: str, child: Behaviour) -> None:
        super().__init__(name, child, OneShotPolicy.ON_COMPLETION)


class Subtree(Node):
    """A use of a subtree: passes on what its root says."""

    word = decorator_words.SUBTREE

    def tick_children(self) -> Ticks:
        """The root."""
        yield from self.children[0].tick()
        return self.children[0].status


class Retry(Node):
    """Starts its child again when it fails. py_trees' own knows no pause between attempts."""

    word = decorator_words.RETRY
    ports: decorator_words.Retry

    def initialise(self) -> None:
        """No attempt was made yet."""
        self._failures = 0
        self._resume: float | None = None

    def tick_children(self) -> Ticks:
        """One attempt at a time, at most one start a tick."""
        if self._resume is not None and not reached(self.time, self._resume):
            return Status.RUNNING
        self._resume = None
        child = self.children[0]
        if child.status is Status.FAILURE:
            child.stop(Status.INVALID)  # so that its next failure is told, if it comes at once
        yield from child.tick()
        if child.status is not Status.FAILURE:
            return child.status
        self._failures += 1
        if self._failures >= self.ports.times:
            raise Failure("RETRIES_USED_UP", f"failed {self._failures} times")
        if self.ports.delay > 0.0:
            self._resume = self.time + self.ports.delay
        return Status.RUNNING


class Repeat(Node):
    """Starts its child again when it succeeds. py_trees' own cannot take its count from a key."""

    word = decorator_words.REPEAT
    ports: decorator_words.Repeat

    def initialise(self) -> None:
        """Nothing succeeded yet."""
        self._successes = 0

    def tick_children(self) -> Ticks:
        """At most one start a tick."""
        yield from self.children[0].tick()
        if self.children[0].status is not Status.SUCCESS:
            return self.children[0].status
        self._successes += 1
        return Status.SUCCESS if self._successes == self.ports.times else Status.RUNNING


class Timeout(Node):
    """Halts its child and fails when it has not ended in time; an end at the deadline counts."""

    word = decorator_words.TIMEOUT
    ports: decorator_words.Seconds

    def initialise(self) -> None:
        """The time starts to run."""
        self._deadline = self.time + self.ports.seconds

    def tick_children(self) -> Ticks:
        """The child, then a look at the clock."""
        yield from self.children[0].tick()
        status = self.children[0].status
        if status is Status.RUNNING and reached(self.time, self._deadline):
            raise Failure("TIMEOUT", f"no end within {self.ports.seconds:g} s")
        return status


class Delay(Node):
    """Waits before its child starts."""

    word = decorator_words.DELAY
    ports: decorator_words.Seconds

    def initialise(self) -> None:
        """The time starts to run."""
        self._due = self.time + self.ports.seconds

    def tick_children(self) -> Ticks:
        """Nothing, then the child."""
        if not reached(self.time, self._due):
            return Status.RUNNING
        yield from self.children[0].tick()
        return self.children[0].status


class Rate(Node):
    """Ticks its child less often; between those ticks it is what the child last was."""

    word = decorator_words.RATE
    ports: decorator_words.Rate

    def initialise(self) -> None:
        """The first tick is due at once."""
        self._due = self.time

    def tick_children(self) -> Ticks:
        """The child when it is due; a late tick does not shift those that follow."""
        if not reached(self.time, self._due):
            return Status.RUNNING
        periods = math.floor((self.time - self._due) * self.ports.hz + _ROUNDING) + 1
        self._due += periods / self.ports.hz
        yield from self.children[0].tick()
        return self.children[0].status


class OnHalt(Node):
    """Ticks a clean-up once when its child is halted; a halt cannot wait for a longer one."""

    word = decorator_words.ON_HALT

    def tick_children(self) -> Ticks:
        """The child."""
        yield from self.children[0].tick()
        return self.children[0].status

    def stop(self, new_status: Status = Status.INVALID) -> None:
        """End; a halt of the running child is followed by the clean-up."""
        child, cleanup = self.children
        if new_status is Status.INVALID and child.status is Status.RUNNING:
            child.stop(Status.INVALID)
            cleanup.tick_once()
        super().stop(new_status)
