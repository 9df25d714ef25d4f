"""Samples that a skill records over time; those that do not fit are refused at the call."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from bt_dualarm.errors import SkillError
from bt_dualarm.pose import Matrix, Vector

_NAME: Final = re.compile(r"[A-Za-z][A-Za-z0-9_ .-]{0,59}")
_BACKWARDS_S: Final = 1e-9  # rounding of summed time steps


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
        """Samples as a skill records them.

        Args:
            name: Name of the quantity.
            time: Simulated seconds, a number or of shape (n,).
            values: A number or a point of shape (3,); or of shape (n,), (n, 1) or (n, 3).

        Raises:
            SkillError: They do not go together, or are no finite numbers.
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
            raise _misfit(name, "times run backwards", "in order")
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
        """Look whether these go on where earlier samples of the same name ended.

        Args:
            name: Name of the quantity.
            time: Simulated second of the last sample before.
            columns: Numbers of one sample, as it was so far.

        Raises:
            SkillError: They do not.
        """
        kinds = {1: "numbers", 3: "points"}
        if self.values.shape[1] != columns:
            now = kinds[self.values.shape[1]]
            raise _misfit(name, f"values are {now}", f"{kinds[columns]}, as they were before")
        if self.time[0] < time - _BACKWARDS_S:
            earlier = f"the first time is {self.time[0]:.3f} s"
            raise _misfit(name, earlier, f"{time:.3f} s or later, where the last samples end")


def _finite(name: str, what: str, given: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Numbers as an array."""
    try:
        array = np.asarray(given, dtype=float)
    except (TypeError, ValueError) as error:
        raise SkillError(f"record({name!r}): its {what} are no numbers: {error}") from None
    if not np.isfinite(array).all():
        raise SkillError(f"record({name!r}): its {what} are not all finite numbers")
    return array


def _misfit(name: str, given: str, allowed: str) -> SkillError:
    return SkillError(f"record({name!r}): its {given}; they must be {allowed}")
