"""Errors of bt_dualarm: one base class, few subclasses, each carrying its evidence."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final, Self, TypeAlias

Number: TypeAlias = float | int | bool | str
"""Type of a failure's numbers: JSON scalars only."""


KINEMATIC_CODES: Final = frozenset(
    {"INVALID_TARGET", "UNREACHABLE", "PATH_BROKEN", "SINGULAR", "JOINT_LIMIT"}
)
"""Failure codes of poses and paths that an arm cannot take even if nothing else is there."""


def rounded_down(most: float, digits: int = 3) -> float:
    """The largest number of some digits up to an upper bound above 0.

    Messages give bounds like this: a value that they advise must not be refused in turn.
    """
    unit = 10.0 ** (math.floor(math.log10(most)) + 1 - digits)
    # What is a whole number but for rounding errors stays one.
    return float(f"{math.floor(most / unit + 1e-9) * unit:.{digits}g}")


def rounded_up(least: float, digits: int = 3) -> float:
    """The smallest number of some digits from a lower bound above 0 on, see `rounded_down`."""
    unit = 10.0 ** (math.floor(math.log10(least)) + 1 - digits)
    return float(f"{math.ceil(least / unit - 1e-9) * unit:.{digits}g}")


class DualArmError(Exception):
    """Base of every error that bt_dualarm raises on purpose."""


class CatalogError(DualArmError):
    """A robot, scene or tool description cannot be used; the message names the file."""


class WorldError(DualArmError):
    """The world cannot do what was requested (unknown name, name in use, not present)."""


class RoomError(WorldError):
    """There is no room for the objects of one entry.

    Args:
        entry: Name of the entry.
        message: The problem.
    """

    def __init__(self, entry: str, message: str) -> None:
        super().__init__(f"{entry}: {message}")
        self.entry = entry
        self.message = message


class SpringError(WorldError):
    """The spring of a joint is too stiff for the time step.

    Args:
        obj: Name of the object that the joint moves.
        message: The problem.
    """

    def __init__(self, obj: str, message: str) -> None:
        super().__init__(f"{obj}: {message}")
        self.obj = obj
        self.message = message


class LockedJointError(CatalogError):
    """A joint is locked for one arm, and moved or locked elsewhere by another of the same robot.

    Args:
        arm: Name of the arm for which it is locked.
        joint: Name of the joint.
        message: The problem.
    """

    def __init__(self, arm: str, joint: str, message: str) -> None:
        super().__init__(f"{arm}: {message}")
        self.arm = arm
        self.joint = joint
        self.message = message


class OverlapError(WorldError):
    """An arm or object would overlap with another body, or an arm with itself.

    Args:
        obj: Name of the arm or object.
        reason: One sentence.
        depth: Penetration, m.
        other: Name of the other arm, object or part of the scene; ``obj`` if an arm overlaps with
            itself, ``OBJ/pedestal`` if it does with its pedestal.
    """

    def __init__(self, obj: str, reason: str, depth: float, other: str) -> None:
        super().__init__(reason)
        self.obj = obj
        self.depth = depth
        self.other = other


class DivergenceError(WorldError):
    """The simulation diverged: NaN, a silent reset, or decreasing time."""


class RunError(DualArmError):
    """A run cannot do what was requested: it has ended, or an argument is invalid."""


class NameUnknownError(DualArmError, KeyError):
    """A mapping of a run has no such name; the message suggests the nearest one."""

    def __str__(self) -> str:
        return str(self.args[0])  # KeyError would put it in quotes


class RendererError(DualArmError):
    """The requested renderer does not work on this machine."""


class SkillError(DualArmError):
    """A skill violates the rules for skills; the message addresses its author."""


class Interruption(BaseException):
    """The user interrupts the run with Ctrl-C. Skills must not catch it."""


class Overrun(BaseException):
    """Skill code did not return in time and is interrupted.

    It is not an `Exception`, so ``except Exception`` in that code does not catch it.
    """


RAISED_BY_SKILLS: Final = (Exception, SystemExit, GeneratorExit, KeyboardInterrupt, Overrun)
"""Exceptions of skill code that fail its leaf instead of ending the run.

`Interruption` is not among them: it is a request of the user.
"""


class Failure(DualArmError):
    """Reason of a skill's failure: a code for programs, a sentence for people, and numbers.

    Args:
        code: Upper-case identifier, declared by the skill in ``failures``.
        reason: One sentence that is clear without reading the source.
        numbers: Evidence by name; names end with units (``residual_m``).
    """

    def __init__(self, code: str, reason: str, **numbers: Number) -> None:
        super().__init__(f"{code}: {reason}")
        self.code = code
        self.reason = reason
        self.numbers: Mapping[str, Number] = numbers

    def noting(self, **numbers: Number) -> Self:
        """Returns this failure, with more evidence."""
        self.numbers = {**self.numbers, **numbers}
        return self

    def adding(self, clause: str) -> Self:
        """Returns this failure, with a further clause at the end of its reason."""
        self.reason = f"{self.reason}; {clause}"
        self.args = (f"{self.code}: {self.reason}",)
        return self


class AbsentError(Failure, WorldError):
    """An arm or object is not in the world: it was removed, or has not been spawned.

    A failure of the skill that asked for it, unless the skill prevents or handles it: ``NOT_THERE``
    for an object, ``PARTNER_GONE`` for an arm.
    """

    def __str__(self) -> str:
        """The sentence alone: it is also an error of Python code outside of skills."""
        return self.reason


def nearest_to_success(failures: Sequence[Failure]) -> Failure:
    """The failure of the attempt that came nearest to success; of equal ones the first.

    It says more than that of the preferred attempt why all of them failed: a link that would be
    deep in the table excludes one grasp, and what others touch by a millimeter is in the way. A
    search that found no path (``NO_PLAN``) began where all checks had passed. Of paths that break
    off, the one that leads farthest is the nearest.

    Args:
        failures: Failures of all attempts, at least one, the preferred attempt first.
    """

    def miss(failure: Failure) -> tuple[float, float]:
        numbers = failure.numbers
        followed = float(numbers.get("fraction", 0.0))
        if failure.code == "NO_PLAN":
            return 0.0, -followed
        return float(numbers.get("depth_m", numbers.get("residual_m", math.inf))), -followed

    return min(failures, key=miss)


class InjectedFailure(Failure):
    """Failure that a fault of the file injects; its code need not be declared by the skill."""


class CollisionFailure(Failure):
    """Two bodies touch, would touch, or would come too close: ``IN_COLLISION``.

    Args:
        reason: One sentence.
        first: Name of the arm's body, or of what it holds.
        second: Name of the other body; those of an arm begin with its name and a slash.
        numbers: Evidence in addition to the two names.

    Attributes:
        at: Configuration of the arm in which they would touch, rad; none if it is not known.
    """

    def __init__(self, reason: str, first: str, second: str, **numbers: Number) -> None:
        super().__init__("IN_COLLISION", reason, first=first, second=second, **numbers)
        self.first = first
        self.second = second
        self.at: tuple[float, ...] = ()

    @property
    def obstacle(self) -> str:
        """Name of the arm or object to which the other body belongs."""
        return self.second.partition("/")[0]


class TouchFailure(CollisionFailure):
    """A link of the arm is in unwanted contact now, rather than predicted to be."""


class ForceLimitFailure(Failure):
    """A measured contact force exceeds the arm's limit: ``FORCE_LIMIT``.

    Args:
        first: Name of the arm's body, or of what it holds.
        second: Name of the other body.
        force_n: Force in N.
        limit_n: Largest allowed force in N.
    """

    def __init__(self, first: str, second: str, force_n: float, limit_n: float) -> None:
        super().__init__(
            "FORCE_LIMIT",
            f"{first} presses on {second} with {force_n:.0f} N; the limit is {limit_n:g} N",
            first=first,
            second=second,
            force_n=force_n,
            force_limit_n=limit_n,
        )


class CollisionDetectedFailure(Failure):
    """A collision was detected from the joint torques: ``COLLISION``.

    Args:
        reason: One sentence.
        numbers: Evidence: joints, torques and force.
    """

    def __init__(self, reason: str, **numbers: Number) -> None:
        super().__init__("COLLISION", reason, **numbers)


class BlockedFailure(Failure):
    """A running motion is abandoned because of an obstacle that has not been touched yet.

    The code is ``IN_COLLISION``; ``TIMED_OUT`` if the guard has stopped the arm, and the obstacle
    has not left in time or is going to stay; ``DEADLOCK`` if it is an arm that waits for this one.

    Args:
        code: As of `Failure`.
        reason: As of `Failure`.
        stays: Whether the obstacle is an arm whose tree has ended, which is going to stay there.
        numbers: As of `Failure`.
    """

    def __init__(self, code: str, reason: str, *, stays: bool = False, **numbers: Number) -> None:
        super().__init__(code, reason, **numbers)
        self.stays = stays
