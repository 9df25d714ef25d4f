"""Base of conditions: skills that evaluate something once and do not move the arm."""

from __future__ import annotations

import numpy as np

from bt_dualarm.core.errors import Failure, SkillError
from bt_dualarm.skill.skill import Skill, Ticks


class Condition(Skill):
    """A skill that succeeds if `check` returns True, and fails with ``FALSE`` if it returns False.

    For ``guard``, ``if``, ``while``, ``until`` and the like, which evaluate it again and again: it
    should read sensors only, and take microseconds.

    Attributes:
        reason: Sentence that states why it does not hold; `check` may set it.
    """

    reason = ""

    def check(self) -> bool:
        """Returns whether the condition holds now.

        Raises:
            Failure: It cannot be evaluated.
        """
        raise NotImplementedError

    @classmethod
    def declares(cls, code: str) -> bool:
        """Whether the condition may fail with a code: ``FALSE``, or one that a skill may have."""
        return code == "FALSE" or super().declares(code)

    def run(self) -> Ticks:
        """Evaluate the condition once.

        Raises:
            Failure: ``FALSE``: it does not hold.
        """
        holds: object = self.check()
        if not isinstance(holds, bool | np.bool_):  # NumPy's comparisons return the latter
            raise SkillError(
                f"check() of {type(self).__name__} returns {holds!r}: return True or False"
            )
        if not holds:
            raise Failure("FALSE", self.reason or "the condition does not hold")
        yield from ()
