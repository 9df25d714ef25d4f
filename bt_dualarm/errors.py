"""Errors of bt_dualarm: one base class, few subclasses, each carrying its evidence."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

Number: TypeAlias = float | int | bool | str
"""What may stand among the numbers of a failure: JSON scalars only."""


class DualArmError(Exception):
    """Base of every error that bt_dualarm raises on purpose."""


class CatalogueError(DualArmError):
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


class RendererError(DualArmError):
    """The renderer that was asked for cannot work on this machine."""


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
