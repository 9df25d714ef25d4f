"""The base class of skills: leaves of a tree that make one arm do something.

A skill is written as one generator, ``run``: every ``yield`` ends a tick with RUNNING, returning
is SUCCESS, raising `Failure` is FAILURE. Whoever halts it closes the generator, so what must be
undone stands in a ``finally`` block. A new object is made for every start, hence nothing of an
earlier run is left over.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.errors import Number
from bt_dualarm.spec.kind import NoPorts
from bt_dualarm.spec.ports import PortModel

if TYPE_CHECKING:
    from bt_dualarm.arm.arm import Arm

Ticks: TypeAlias = Iterator[Any]
"""What ``run`` of a skill is: ``yield`` ends a tick, ``yield 0.4`` says that 40 % are done.

An iterator of numbers and None, written so that checkers of types accept a bare ``yield`` beside
``yield 0.4`` and ``yield from``: mypy refuses it in an ``Iterator[float | None]``.
"""

STANDARD_FAILURES: Final[Mapping[str, str]] = {
    "UNREACHABLE": "no joint configuration puts the tool there",
    "JOINT_LIMIT": "a joint would leave its limits",
    "SINGULAR": "the tool's path leads through a singularity of the arm",
    "PATH_BROKEN": "the arm can follow a path only in part, and then follows none of it",
    "IN_COLLISION": "two bodies would touch",
    "COLLISION": "the arm was hit, or ran into something, as its joints' torques tell",
    "INVALID_TARGET": "the target makes no sense",
    "NO_PLAN": "no motion free of collisions was found",
    "OVERLOADED": "the arm cannot carry what it holds, or is to hold",
    "TRACKING_ERROR": "the arm does not follow what it was sent",
    "FORCE_LIMIT": "the arm pressed harder on something than it may",
    "DROPPED": "what the gripper held is no longer there",
    "TIMED_OUT": "the motion was held up for too long",
    "STALE": "a stream of set-points gave no new one for 0.1 s",
    "INTERRUPTED": "something else has stopped the motion",
    "BUSY": "another leaf is moving the arm",
    "NO_GRIPPER": "the arm has no gripper",
    "NO_VALUE": "a key of the blackboard was read that has no value of the right type",
    "OVERRUN": "code of the skill did not return in time, and was interrupted where it stood",
    "EXCEPTION": "the skill has a bug: see the traceback in the log",
}
"""Codes that any skill may fail with; a skill declares only those of its own."""


Record: TypeAlias = Callable[[str, npt.ArrayLike, npt.ArrayLike], None]
"""Takes name, times and values of what a skill measures over time, for the record's plots."""


def nowhere(name: str, time: npt.ArrayLike, values: npt.ArrayLike) -> None:
    """A `Record` that keeps nothing."""


@dataclass(frozen=True)
class SkillContext:
    """What a skill is given besides its ports.

    Attributes:
        name: Path of the leaf in its tree.
        arm: Arm that the skill acts with.
        clock: Simulated time in seconds.
        rng: Generator of random numbers, the only source of them; seeded by the run and the leaf.
        log: Logger, for people who look for the reason afterwards.
        record: Function that keeps what is measured over time.
    """

    name: str
    arm: Arm
    clock: Callable[[], float]
    rng: np.random.Generator
    log: logging.Logger
    record: Record = nowhere


class Skill:
    """Base of all skills; its name in YAML is the class name in snake_case.

    Subclasses declare ``Ports`` (and ``Outputs``), annotate ``ports: Ports`` for their own
    type checker, and implement `run`. The docstring's first line is shown to users.

    Args:
        ports: Ports, checked, with references to the blackboard replaced by their values.
        context: Arm, clock and what else there is.
        write: Function that puts an output on the blackboard, if the tree gave a key for it.

    Attributes:
        brings_in: Ports that name an object or arm, declared with ``spawned: false``, which the
            skill brings into the world; the check then knows that it comes.
        needs: Modules that are slow to import and that the skill uses; imported before the run.
        needs_camera: Whether it works only with a camera that moves with the arm.
        needs_gripper: Whether it works only with an arm that has a gripper.
        progress: Share done from 0 to 1, for the display; None where it cannot be known.
        metrics: Numbers that the skill measured, by name, for the summary of the run.
    """

    Ports: ClassVar[type[PortModel]] = NoPorts
    Outputs: ClassVar[type[PortModel]] = NoPorts
    failures: ClassVar[Mapping[str, str]] = {}
    example: ClassVar[str] = ""
    brings_in: ClassVar[tuple[str, ...]] = ()
    needs: ClassVar[tuple[str, ...]] = ()
    needs_camera: ClassVar[bool] = False
    needs_gripper: ClassVar[bool] = False

    ports: Any  # a subclass says of which type its own are

    def __init__(
        self, ports: PortModel, context: SkillContext, write: Callable[[str, object], None]
    ) -> None:
        self.ports = ports
        self.context = context
        self.arm = context.arm
        self.progress: float | None = None
        self.metrics: dict[str, Number] = {}
        self._write = write

    def run(self) -> Ticks:
        """Do it, one tick from ``yield`` to ``yield``; never block, never sleep.

        A number that is yielded is the progress, from 0 to 1.

        Returning says SUCCESS: only of what was verified.

        Raises:
            Failure: With a code of ``failures`` or `STANDARD_FAILURES`.
        """
        raise NotImplementedError
        yield  # makes this, too, a generator

    @classmethod
    def declares(cls, code: str) -> bool:
        """Whether it may fail with a code: one of ``failures``, or a standard one."""
        return code in cls.failures or code in STANDARD_FAILURES

    @property
    def time(self) -> float:
        """Simulated time in seconds."""
        return self.context.clock()

    def record(self, name: str, time: npt.ArrayLike, values: npt.ArrayLike) -> None:
        """Keep samples for the record and its plots.

        Args:
            name: Name of the quantity; ``planned`` and ``target`` are what others are compared
                with, that of scalars ends with their unit.
            time: Simulated seconds, a number or of shape (n,).
            values: Points of the world of shape (3,) or (n, 3) in m, or scalars.

        Raises:
            SkillError: The samples do not go together, or with those before.
        """
        self.context.record(name, time, values)

    def output(self, name: str, value: object) -> None:
        """Write an output that ``Outputs`` declares; lost where the tree gave it no key."""
        self._write(name, value)
