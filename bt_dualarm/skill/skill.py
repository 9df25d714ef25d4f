"""The base class of skills, and the checks of what a skill yields, returns and measures.

A skill is a leaf of a tree that makes one arm do something. It is written as one generator,
``run``: every ``yield`` ends a tick with RUNNING, returning is SUCCESS, raising `Failure` is
FAILURE. Halting a leaf closes the generator, so cleanup belongs in a ``finally`` block. Every start
of the leaf makes a new object, so no state of an earlier run is left.
"""

from __future__ import annotations

import logging
import math
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from numbers import Real
from typing import TYPE_CHECKING, Any, ClassVar, Final, TypeAlias, TypeGuard

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.errors import Failure, InjectedFailure, Number, SkillError
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.core.share import LARGEST_INT, encodable
from bt_dualarm.skill.cell import CellAccess
from bt_dualarm.spec.node_types import Counterpart, NoPorts, PortModel

if TYPE_CHECKING:
    from bt_dualarm.arm.arm import Arm


Ticks: TypeAlias = Iterator[Any]
"""Return type of ``run``: ``yield`` ends a tick, ``yield 0.4`` also reports a progress of 40 %.

It is an iterator of numbers and None. The item type is Any because mypy refuses a bare ``yield`` in
an ``Iterator[float | None]``.
"""

STANDARD_FAILURES: Final[Mapping[str, str]] = {
    "UNREACHABLE": "no joint configuration reaches the tool pose",
    "JOINT_LIMIT": "a joint would exceed its limits",
    "SINGULAR": "the tool's path leads through a singularity of the arm",
    "PATH_BROKEN": "the arm can follow a path only in part, so the path was not executed",
    "IN_COLLISION": "two bodies would touch",
    "COLLISION": "a collision was detected from the joint torques",
    "INVALID_TARGET": "the target is invalid",
    "NO_PLAN": "no collision-free motion was found",
    "OVERLOADED": "the load exceeds what the arm can carry",
    "TRACKING_ERROR": "the arm does not follow its set-points",
    "FORCE_LIMIT": "the contact force exceeded its limit",
    "DROPPED": "the gripper lost the held object",
    "NOT_THERE": "an object that it needs is not in the world",
    "PARTNER_GONE": "another arm that it needs is not in the world",
    "TIMED_OUT": "the motion was delayed for too long",
    "STALE": "a set-point stream delivered nothing for 0.1 s",
    "INTERRUPTED": "the motion was stopped externally",
    "BUSY": "another leaf is moving the arm",
    "DEADLOCK": "the arms that block it are waiting for this one",
    "NO_GRIPPER": "the arm has no gripper",
    "UNKNOWN_POSE": "a pose is relative to an object whose pose the arm does not know",
    "NO_VALUE": "a blackboard key or an expression has no value of the right type",
    "OVERRUN": "the skill's code did not return in time and was interrupted",
    "EXCEPTION": "the skill has a bug: see the traceback in the log",
}
"""Codes that any skill may fail with; a skill declares only its own."""


_LONGEST: Final = 60  # characters of a value that a message shows
_LARGEST: Final = int(sys.float_info.max)
_NAME: Final = re.compile(r"[A-Za-z][A-Za-z0-9_ .-]{0,59}")
_BACKWARDS_S: Final = 1e-9  # rounding of summed time steps
_LEAST_LENGTH: Final = 1e-6  # minimum length of a direction vector


Record: TypeAlias = Callable[[str, npt.ArrayLike, npt.ArrayLike], None]
"""Function that records samples of a quantity over time: name, times, values."""


def nowhere(name: str, time: npt.ArrayLike, values: npt.ArrayLike) -> None:
    """A `Record` that discards the samples."""


@dataclass(frozen=True)
class SkillContext:
    """Environment of a skill, in addition to its ports.

    Attributes:
        name: Path of the leaf in its tree.
        arm: Arm that the skill acts with.
        clock: Simulated time in seconds.
        rng: Generator of random numbers, the only source of them; seeded by the run and the leaf.
        log: Logger of the arm's skills.
        record: Function that records samples over time.
        cell: What the trees of the file share.
        texts: Texts of the files that ports of the tree name, by the name that the port has.
    """

    name: str
    arm: Arm
    clock: Callable[[], float]
    rng: np.random.Generator
    log: logging.Logger
    record: Record = nowhere
    cell: CellAccess = field(default_factory=CellAccess.alone)
    texts: Mapping[str, str] = field(default_factory=dict)


class Skill:
    """Base of all skills; its name in YAML is the class name in snake_case.

    Subclasses declare ``Ports`` (and ``Outputs``), annotate ``ports: Ports`` for their own
    type checker, and implement `run`. The docstring's first line is shown to users.

    Args:
        ports: Validated ports, with references to the blackboard replaced by their values.
        context: Arm, clock and the rest of the environment.
        write: Function that writes an output to the blackboard, if the tree gives a key for it.

    Attributes:
        brings_in: Ports that name an object or arm, declared with ``spawned: false``, which the
            skill adds to the world; the check of the tree then accepts later uses of it.
        takes_out: Ports that name an object or arm that the skill removes from the world; the check
            of the tree then accepts that another one brings it in again.
        needs: Modules that are slow to import; they are imported before the run.
        needs_camera: Whether it works only with a camera that moves with the arm.
        needs_gripper: Whether it works only with an arm that has a gripper.
        needs_held: Whether it works only while the arm holds an object.
        takes_hold: Whether the arm may hold an object after it that it did not hold before; the
            check of the tree assumes it of every skill that is not shipped.
        lets_go: Whether the gripper holds nothing after it has succeeded.
        begins_anywhere: Whether it does the same from wherever it begins, as what it does depends
            on its ports only: an arm that has made room need not return first.
        counterpart: Skill of another arm with which it acts together; the check of the tree then
            looks for it.
        progress: Progress from 0 to 1, for the display; None if it is unknown.
        metrics: Measured numbers by name, for the summary of the run.
        relative_to: Names of the objects to which poses in the ports were relative.
    """

    Ports: ClassVar[type[PortModel]] = NoPorts
    Outputs: ClassVar[type[PortModel]] = NoPorts
    failures: ClassVar[Mapping[str, str]] = {}
    example: ClassVar[str] = ""
    brings_in: ClassVar[tuple[str, ...]] = ()
    takes_out: ClassVar[tuple[str, ...]] = ()
    needs: ClassVar[tuple[str, ...]] = ()
    needs_camera: ClassVar[bool] = False
    needs_gripper: ClassVar[bool] = False
    needs_held: ClassVar[bool] = False
    takes_hold: ClassVar[bool] = False
    lets_go: ClassVar[bool] = False
    begins_anywhere: bool = False
    counterpart: ClassVar[Counterpart | None] = None

    ports: Any  # a subclass annotates the type of its own

    def __init__(
        self, ports: PortModel, context: SkillContext, write: Callable[[str, object], None]
    ) -> None:
        self.ports = ports
        self.context = context
        self.arm = context.arm
        self.progress: float | None = None
        self.metrics: dict[str, Number] = {}
        self.relative_to: frozenset[str] = frozenset()
        self._write = write

    def run(self) -> Ticks:
        """Execute the skill, one tick from ``yield`` to ``yield``; never block, never sleep.

        A yielded number is the progress, from 0 to 1. Returning means SUCCESS: return only after
        the result was verified.

        Raises:
            Failure: With a code of ``failures`` or `STANDARD_FAILURES`.
        """
        raise NotImplementedError
        yield  # makes this a generator, too

    @classmethod
    def declares(cls, code: str) -> bool:
        """Whether the skill may fail with a code: one of ``failures``, or a standard one."""
        return code in cls.failures or code in STANDARD_FAILURES

    @classmethod
    def shift(cls, ports: Any) -> tuple[float, str] | None:  # noqa: ARG003 - for subclasses
        """How far a run moves the tool from where it was, for the check of repeated nodes.

        Args:
            ports: Validated ports.

        Returns:
            Distance in m, and how to avoid it; None if it depends on more than the ports.
        """
        return None

    @property
    def time(self) -> float:
        """Simulated time in seconds."""
        return self.context.clock()

    def record(self, name: str, time: npt.ArrayLike, values: npt.ArrayLike) -> None:
        """Record samples of a quantity over time, for plots.

        Args:
            name: Name of the quantity, for scalars with the unit at its end; ``planned`` and
                ``target`` are references with which the others are compared.
            time: Simulated seconds, a number or of shape (n,).
            values: Points of the world of shape (3,) or (n, 3) in m, or scalars.

        Raises:
            SkillError: Their shapes do not match each other or the earlier samples.
        """
        self.context.record(name, time, values)

    def output(self, name: str, value: object) -> None:
        """Write an output that ``Outputs`` declares; discarded if the tree gives no key for it."""
        self._write(name, value)


def unit_vector(direction: tuple[float, float, float]) -> Vector:
    """Unit vector, of shape (3,), of a direction from a tree file.

    Args:
        direction: Vector in any frame, which is kept.

    Raises:
        Failure: ``INVALID_TARGET``: the vector has no length.
    """
    length = float(np.linalg.norm(direction))
    if length < _LEAST_LENGTH:
        raise Failure("INVALID_TARGET", "the direction is a zero vector")
    return np.array(direction) / length


def progress_of(skill: Skill, value: object) -> float | None:
    """Progress from 0 to 1 that a skill has yielded; None if it yields nothing.

    Raises:
        SkillError: The value is not a number from 0 to 1.
    """
    if value is None:
        return None
    if type(value) is float and 0.0 <= value <= 1.0:  # the common case, before slower checks
        return value
    if isinstance(value, bool) or not isinstance(value, Real) or not _is_finite(value):
        raise SkillError(
            f"{_name(skill)} yields {_shown(value)}: yield nothing, or the progress as a "
            "number from 0 to 1"
        )
    return min(1.0, max(0.0, float(value)))


def _is_finite(value: Real) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number that no float can hold
        return False


def refuse_return(skill: Skill, value: object) -> None:
    """Check the value that ``run`` has returned: None or True.

    Raises:
        SkillError: It is another value, which would be ignored or contradict SUCCESS.
    """
    if value is None or value is True:
        return
    raise SkillError(
        f"run() of {_name(skill)} returns {_shown(value)}: returning means verified "
        'SUCCESS; to fail, raise Failure("CODE", "why")'
    )


def refuse_code(skill: Skill, failure: Failure) -> None:
    """Check the code and the reason with which a skill fails.

    Raises:
        SkillError: The code is neither declared nor standard, or there is no sentence.
    """
    if isinstance(failure, InjectedFailure):
        return
    if not isinstance(failure.reason, str):
        raise SkillError(
            f"{_name(skill)} fails with {_shown(failure.code)} and {_shown(failure.reason)}: the "
            "reason must be a sentence"
        ) from failure
    if not skill.declares(failure.code):
        declared = ", ".join(skill.failures) or "none"
        raise SkillError(
            f"{_name(skill)} fails with {_shown(failure.code)}, which is neither a declared "
            f"failure code ({declared}) nor a standard one; its reason: {failure.reason}"
        ) from failure


def refuse_metrics(skill: Skill) -> None:
    """Check the metrics of a skill.

    Raises:
        SkillError: A metric is neither a number, nor a truth value, nor text.
    """
    for complaint in wrong_metrics(skill, skill.metrics):
        raise SkillError(complaint)


def wrong_metrics(skill: Skill, metrics: object) -> Iterator[str]:
    """Faults of a skill's metrics, or of the numbers of its failure, one message each."""
    if not isinstance(metrics, Mapping):
        yield f"metrics of {_name(skill)} are {_shown(metrics)}: expected a dict, by name"
        return
    for name, value in metrics.items():
        if not _is_metric(name, value):
            yield (
                f"metric {_shown(name)} of {_name(skill)} is {_shown(value)}: a metric is a "
                "number that a float can hold, true or false, or text"
            )


def plain(found: object) -> dict[str, Number]:
    """The valid metrics, converted to types of JSON."""
    if not isinstance(found, Mapping):
        return {}
    scalars = {
        encodable(name): _scalar(value) for name, value in found.items() if isinstance(name, str)
    }
    return {name: value for name, value in scalars.items() if _is_number(value)}


def _is_metric(name: object, value: object) -> bool:
    return isinstance(name, str) and _is_number(_scalar(value))


def _is_number(value: object) -> TypeGuard[Number]:
    """Whether it is a value of JSON, NaN and integers beyond the range of floats excluded."""
    if not isinstance(value, bool | int | float | str):
        return False
    if isinstance(value, int) and abs(value) > _LARGEST:
        return False
    return not (isinstance(value, float) and math.isnan(value))


def _scalar(value: object) -> object:
    """The number in a NumPy scalar or one-element array, with types that files can hold."""
    if isinstance(value, np.generic | np.ndarray) and value.size == 1:
        value = value.item()
    if isinstance(value, str):
        return encodable(value)
    if isinstance(value, int) and LARGEST_INT < abs(value) <= _LARGEST:
        return float(value)
    return value


def _name(skill: Skill) -> str:
    return type(skill).__name__


def _shown(value: object) -> str:
    """Representation of a value for a message: on one line and not too long."""
    try:
        text = " ".join(repr(value).split())
    except Exception:  # noqa: BLE001 - a foreign repr may raise anything
        text = f"an object of {type(value).__name__}"
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of one quantity.

    Attributes:
        time: Simulated seconds, of shape (n,), never running backwards.
        values: Points of the world in m, of shape (n, 3), or numbers, of shape (n, 1).
    """

    time: Vector
    values: Matrix

    @classmethod
    def of(cls, name: object, time: npt.ArrayLike, values: npt.ArrayLike) -> Samples:
        """Samples in a normal form, from the arguments of `Skill.record`.

        Args:
            name: Name of the quantity.
            time: Simulated seconds, a number or of shape (n,).
            values: A number or a point of shape (3,); or of shape (n,), (n, 1) or (n, 3).

        Raises:
            SkillError: Their shapes do not match, or the values are not finite.
        """
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            raise SkillError(
                f"record({name!r}): a name begins with a letter, and has 60 letters, digits, "
                "spaces and _ . - at most"
            )
        stamps = np.atleast_1d(_finite(name, "times", time))
        found = _finite(name, "values", values)
        if stamps.ndim > 1:
            raise _misfit(name, f"times are of shape {stamps.shape}", "a number, or of shape (n,)")
        if np.any(np.diff(stamps) < -_BACKWARDS_S):
            raise _misfit(name, "times decrease", "in order")
        count = len(stamps)
        if count == 1 and found.shape in ((), (3,)):
            found = found.reshape(1, -1)
        if found.ndim == 0 or len(found) != count or found.shape[1:] not in ((), (1,), (3,)):
            raise _misfit(
                name,
                f"values are of shape {found.shape} at {count} times",
                f"of shape ({count},) for numbers, ({count}, 3) for points",
            )
        return cls(stamps, found.reshape(count, 3 if found.shape[1:] == (3,) else 1))

    def refuse_after(self, name: str, time: float, columns: int) -> None:
        """Check that these samples continue earlier ones of the same name.

        Args:
            name: Name of the quantity.
            time: Simulated time of the last earlier sample, s.
            columns: Numbers in one sample so far.

        Raises:
            SkillError: They do not.
        """
        kinds = {1: "numbers", 3: "points"}
        if self.values.shape[1] != columns:
            now = kinds[self.values.shape[1]]
            raise _misfit(name, f"values are {now}", f"{kinds[columns]}, as they were before")
        if self.time[0] < time - _BACKWARDS_S:
            earlier = f"the first time is {self.time[0]:.3f} s"
            raise _misfit(name, earlier, f"{time:.3f} s or later, after the last samples")


def _finite(name: str, what: str, given: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Array of finite numbers."""
    try:
        array = np.asarray(given, dtype=float)
    except (TypeError, ValueError) as error:
        raise SkillError(f"record({name!r}): its {what} are not numbers: {error}") from None
    if not np.isfinite(array).all():
        raise SkillError(f"record({name!r}): its {what} are not all finite numbers")
    return array


def _misfit(name: str, given: str, allowed: str) -> SkillError:
    return SkillError(f"record({name!r}): its {given}; they must be {allowed}")
