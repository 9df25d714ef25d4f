"""The lives of one arm: each of its stays in the world, in bounded memory."""

from __future__ import annotations

from dataclasses import replace

from bt_dualarm.runtime.arm_runtime import ArmRuntime
from bt_dualarm.runtime.outcome import Leniency, Outcome
from bt_dualarm.runtime.parts import ArmView
from bt_dualarm.runtime.result import ArmLife, ArmResult
from bt_dualarm.tree.first_and_last import FirstAndLast

MOST_LIVES = 50
"""Lives that are kept from the beginning of a run, and as many of the latest."""


class Lives:
    """All that one arm of the file did; of what is over only the result is kept.

    Args:
        name: Name of the arm in the file.
        robot: Name of its robot in the catalogue, or the title of a page beside the tree file.
        leniency: What the file forgives it.
    """

    def __init__(self, name: str, robot: str, leniency: Leniency) -> None:
        self._name, self._robot, self._leniency = name, robot, leniency
        self._over: FirstAndLast[ArmResult] = FirstAndLast(MOST_LIVES)
        self._outcomes: set[Outcome] = set()
        self._clipped, self._runs = 0, 0
        self._fault = ""
        self._latest: ArmRuntime | None = None

    def begin(self, arm: ArmRuntime) -> None:
        """Take up the next life; the one before is over."""
        if self._latest is not None:
            over = self._latest.result()
            self._over.add(over)
            self._outcomes.add(over.outcome)
            self._clipped += over.clipped_setpoints
            self._runs += len(over.runs) + over.runs_left_out
            self._fault = over.fault or self._fault
        self._latest = arm

    def view(self) -> ArmView:
        """The arm as it stands now; of one that is gone, its last moment."""
        if self._latest is None:
            return ArmView(self._name, self._robot, None, None)
        return self._latest.view()

    def result(self) -> ArmResult:
        """What the arm did in all its lives."""
        if self._latest is None:
            return ArmResult(self._name, self._robot, Outcome.NOT_SPAWNED)
        last = self._latest.result()
        kept = [*self._over, last]
        runs = tuple(run for life in kept for run in life.runs)
        return replace(
            last,
            outcome=self._leniency.outcome_of([*self._outcomes, last.outcome]),
            clipped_setpoints=self._clipped + last.clipped_setpoints,
            runs=runs,
            runs_left_out=self._runs + len(last.runs) + last.runs_left_out - len(runs),
            fault=last.fault or self._fault,
            lives=tuple(ArmLife(life.outcome, life.ended_s, life.fault) for life in kept),
            lives_left_out=self._over.left_out,
            removable=self._leniency.removable,
            slow_ticks=tuple(tick for life in kept for tick in life.slow_ticks),
        )
