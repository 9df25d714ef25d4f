"""Errors of bt_dualarm: one base class, few subclasses, each carrying its evidence."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Self, TypeAlias

Number: TypeAlias = float | int | bool | str
"""What may stand among the numbers of a failure: JSON scalars only."""


class DualArmError(Exception):
    """Base of every error that bt_dualarm raises on purpose."""


class CatalogError(DualArmError):
    """A robot, scene or tool description cannot be used; the message names the file."""


class WorldError(DualArmError):
    """The world cannot do what was asked (unknown name, name taken, not present)."""


class OverlapError(WorldError):
    """An arm or object would stand inside of another thing.

    Args:
        thing: Name of the arm or object.
        reason: One sentence.
    """

    def __init__(self, thing: str, reason: str) -> None:
        super().__init__(reason)
        self.thing = thing


class DivergenceError(WorldError):
    """The simulation left the realm of numbers (NaN, silent reset, time running backwards)."""


class RunError(DualArmError):
    """A run cannot do what was asked of it: it is over, or an argument makes no sense."""


class NameUnknownError(DualArmError, KeyError):
    """A mapping of a run has nothing of this name; the message names the nearest one it has."""

    def __str__(self) -> str:
        return str(self.args[0])  # KeyError would put it in quotes


class RendererError(DualArmError):
    """The renderer that was asked for cannot work on this machine."""


class SkillError(DualArmError):
    """A skill breaks a rule for skills; the sentence is for its author."""


class Interruption(BaseException):
    """Somebody outside ends the run where it stands: Ctrl-C. No skill is to catch it."""


class Overrun(BaseException):
    """Code of a skill has not returned in time, and is left where it stands.

    Not an `Exception`: code that guards itself against errors would go on.
    """


RAISED_BY_SKILLS: Final = (Exception, SystemExit, GeneratorExit, KeyboardInterrupt, Overrun)
"""What code of a skill may raise, so that it becomes the failure of one leaf and ends no run.

What somebody outside wants is not among it: that is an `Interruption`.
"""


class Failure(DualArmError):
    """Why a skill failed: a code for programs, a sentence for people, numbers for both.

    Args:
        code: Upper-case identifier, declared by the skill in ``failures``.
        reason: One sentence that a person understands without the source.
        numbers: Evidence, by name; units are part of the name (``residual_m``).
    """

    def __init__(self, code: str, reason: str, **numbers: Number) -> None:
        super().__init__(f"{code}: {reason}")
        self.code = code
        self.reason = reason
        self.numbers: Mapping[str, Number] = numbers

    def noting(self, **numbers: Number) -> Self:
        """Itself, with more evidence."""
        self.numbers = {**self.numbers, **numbers}
        return self


class CollisionFailure(Failure):
    """Two bodies touch, would touch, or would come too close: ``IN_COLLISION``.

    Args:
        reason: One sentence.
        first: Name of the arm's body, or of what it holds.
        second: Name of the other body; those of an arm begin with its name and a slash.
        numbers: Evidence besides the two names.
    """

    def __init__(self, reason: str, first: str, second: str, **numbers: Number) -> None:
        super().__init__("IN_COLLISION", reason, first=first, second=second, **numbers)
        self.first = first
        self.second = second

    @property
    def obstacle(self) -> str:
        """Name of the arm or object that the other body is, or is a part of."""
        return self.second.partition("/")[0]


class TouchFailure(CollisionFailure):
    """A link of the arm touches what it should not, now: not a forecast."""


class ForceLimitFailure(Failure):
    """The arm presses harder on something than it may, as far as it can feel: ``FORCE_LIMIT``.

    Args:
        first: Name of the arm's body, or of what it holds.
        second: Name of what it presses on.
        force_n: Force in N.
        limit_n: Force in N that it may press with.
    """

    def __init__(self, first: str, second: str, force_n: float, limit_n: float) -> None:
        super().__init__(
            "FORCE_LIMIT",
            f"{first} presses on {second} with {force_n:.0f} N; it may with {limit_n:g} N",
            first=first,
            second=second,
            force_n=force_n,
            force_limit_n=limit_n,
        )


class HitFailure(Failure):
    """The arm was hit, or ran into something, by the torques of its joints: ``COLLISION``.

    Args:
        reason: One sentence.
        numbers: Evidence: joints, torques and force.
    """

    def __init__(self, reason: str, **numbers: Number) -> None:
        super().__init__("COLLISION", reason, **numbers)


class BlockedFailure(Failure):
    """A motion that had begun is given up for what is in its way, which is not touched yet.

    Its code is ``IN_COLLISION``, or ``TIMED_OUT`` where the arm has waited for it to go away.
    """
