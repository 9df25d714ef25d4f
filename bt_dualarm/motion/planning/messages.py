"""What goes between a run and the process that plans for it."""

from __future__ import annotations

from dataclasses import dataclass

from bt_dualarm.errors import Number
from bt_dualarm.motion.timing.trajectory import Trajectory


@dataclass(frozen=True)
class Request:
    """A problem, pickled, under a number; without it the problem of that number is dropped."""

    number: int
    problem: bytes | None = None


@dataclass(frozen=True)
class Refusal:
    """A failure on its way to the other process."""

    code: str
    reason: str
    numbers: dict[str, Number]


@dataclass(frozen=True)
class Answer:
    """What came of the problem of that number."""

    number: int
    outcome: Trajectory | Refusal
