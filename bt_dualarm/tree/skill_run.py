"""One run of a skill: its generator from the first step to the last, held to what it may say."""

from __future__ import annotations

import atexit
import traceback
from collections.abc import Callable, Generator, Iterator, Mapping
from pathlib import Path
from types import GeneratorType
from typing import Final
from weakref import WeakSet

from bt_dualarm.errors import Failure, Number, SkillError
from bt_dualarm.skill.contract import (
    plain,
    progress_of,
    refuse_code,
    refuse_metrics,
    refuse_return,
    wrong_metrics,
)
from bt_dualarm.skill.skill import Skill

_PACKAGE = Path(__file__).parents[1]
_UNCLOSED: Final[WeakSet[SkillRun]] = WeakSet()


class SkillRun:
    """A skill that was made for this run, and its generator.

    Args:
        make: Maker of the skill; may raise, as every call into a skill may.

    Raises:
        RuntimeError: The skill has raised StopIteration before its first step.
        TypeError: Its ``run`` is no generator.

    Attributes:
        progress: Share done from 0 to 1 that it yielded or noted last; None if it does not know.
    """

    def __init__(self, make: Callable[[], Skill]) -> None:
        self.progress: float | None = None
        try:
            self._skill = make()
            steps = self._skill.run()
        except StopIteration as error:  # outside of the generator it would pass for its end
            raise RuntimeError("StopIteration was raised before the first step") from error
        if not isinstance(steps, Iterator):
            raise TypeError(f"run() of {type(self._skill).__name__} has no yield")
        self._steps = steps
        _UNCLOSED.add(self)

    @property
    def names(self) -> frozenset[str]:
        """Texts among its ports: whatever it was asked to deal with is one of them."""
        values = self._skill.ports.__dict__.values()
        return frozenset(value for value in values if isinstance(value, str))

    def step(self, trouble: BaseException | None) -> bool:
        """Run to the next ``yield``; whether there was one, else it has succeeded.

        Args:
            trouble: What is to be raised where it waits, if anything.

        Raises:
            Failure: The skill fails.
            SkillError: It says what no skill may say.
            Exception: Whatever else it raises.
        """
        try:
            yielded = next(self._steps) if trouble is None else self._raise(trouble)
        except StopIteration as end:
            self._refuse_end(end.value)
            return False
        except SkillError as error:
            name = type(self._skill).__name__
            raise _placed(f"{_authors_line(error)}: {name}", error) from error.__cause__
        except Failure as failure:
            self._refuse_code(failure)
            raise
        try:
            if yielded is not None:
                self._skill.progress = progress_of(self._skill, yielded)
            self.progress = progress_of(self._skill, self._skill.progress)
        except SkillError as error:
            raise _placed(self._waiting_at(), error) from error.__cause__
        return True

    def _refuse_end(self, value: object) -> None:
        try:
            refuse_return(self._skill, value)
            refuse_metrics(self._skill)
        except SkillError as error:
            raise _placed(self._declared_at(), error) from error.__cause__

    def _refuse_code(self, failure: Failure) -> None:
        try:
            refuse_code(self._skill, failure)
        except SkillError as error:
            raise _placed(_authors_line(failure), error) from error.__cause__

    def close(self) -> None:
        """Let the skill clean up; harmless after its end.

        Raises:
            Exception: Whatever its clean-up raises.
        """
        _UNCLOSED.discard(self)
        if isinstance(self._steps, Generator):
            self._steps.close()

    def measured(self, numbers: Mapping[str, Number]) -> tuple[dict[str, Number], list[str]]:
        """Its metrics with the numbers of its failure, and a sentence on each that is no metric."""
        skill = self._skill
        metrics = {**plain(skill.metrics), **plain(numbers)}
        return metrics, [*wrong_metrics(skill, skill.metrics), *wrong_metrics(skill, numbers)]

    def _raise(self, trouble: BaseException) -> float | None:
        """Raise where the skill waits; others than generators cannot answer it."""
        if isinstance(self._steps, Generator):
            progress: float | None = self._steps.throw(trouble)
            return progress
        raise trouble

    def _declared_at(self) -> str:
        """File and line at which ``run`` begins."""
        code = type(self._skill).run.__code__
        return f"{Path(code.co_filename).name}:{code.co_firstlineno}"

    def _waiting_at(self) -> str:
        """File and line of the ``yield`` at which the skill waits."""
        steps: object = self._steps
        while isinstance(steps, GeneratorType) and isinstance(steps.gi_yieldfrom, GeneratorType):
            steps = steps.gi_yieldfrom
        if not isinstance(steps, GeneratorType):
            return self._declared_at()
        frame, code = steps.gi_frame, steps.gi_code
        line = code.co_firstlineno if frame is None else frame.f_lineno
        return f"{Path(code.co_filename).name}:{line}"


def _placed(place: str, error: SkillError) -> SkillError:
    """What is said to the author of a skill, with the place in front of it."""
    return SkillError(f"{place}: {error}")


def _authors_line(error: Exception) -> str:
    """File and line of a skill from which an error came: the last one outside of this package."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if not Path(frame.filename).is_relative_to(_PACKAGE)]
    last = own[-1] if own else frames[-1]
    return f"{Path(last.filename).name}:{last.lineno}"


@atexit.register
def _close_all() -> None:
    """Let skills clean up that nobody closed, while what they need can still be imported."""
    for left in tuple(_UNCLOSED):
        left.close()
