"""What a skill may yield, return, fail with and measure; else a sentence for its author."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Mapping
from numbers import Real
from typing import Final, TypeGuard

import numpy as np

from bt_dualarm.errors import Failure, Number, SkillError
from bt_dualarm.skill.skill import Skill

_LONGEST: Final = 60
"""Characters of a value that a sentence shows."""

_LARGEST: Final = int(sys.float_info.max)


def progress_of(skill: Skill, value: object) -> float | None:
    """Share done that a skill has yielded or noted, from 0 to 1; None where it does not say.

    Raises:
        SkillError: The value is no progress.
    """
    if value is None:
        return None
    if type(value) is float and 0.0 <= value <= 1.0:  # nearly always; the rest is slow to tell
        return value
    if isinstance(value, bool) or not isinstance(value, Real) or not _is_finite(value):
        raise SkillError(
            f"{_name(skill)} yields {_shown(value)}: yield nothing, or the share done as a number "
            "from 0 to 1"
        )
    return min(1.0, max(0.0, float(value)))


def _is_finite(value: Real) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number that no float can hold
        return False


def refuse_return(skill: Skill, value: object) -> None:
    """Look at what ``run`` has returned; to return says SUCCESS.

    Raises:
        SkillError: The value says something else, or nothing that anybody reads.
    """
    if value is None or value is True:
        return
    raise SkillError(
        f"run() of {_name(skill)} returns {_shown(value)}: to return says SUCCESS, of what was "
        'verified; to fail, raise Failure("CODE", "why")'
    )


def refuse_code(skill: Skill, failure: Failure) -> None:
    """Look at the code and the sentence with which a skill fails.

    Raises:
        SkillError: The code is neither declared nor standard, or there is no sentence.
    """
    if not isinstance(failure.reason, str):
        raise SkillError(
            f"{_name(skill)} fails with {_shown(failure.code)} and {_shown(failure.reason)}: the "
            "reason is a sentence"
        ) from failure
    if not skill.declares(failure.code):
        declared = ", ".join(skill.failures) or "none"
        raise SkillError(
            f"{_name(skill)} fails with {_shown(failure.code)}, which is no code of its failures "
            f"({declared}) nor a standard one; its reason: {failure.reason}"
        ) from failure


def refuse_metrics(skill: Skill) -> None:
    """Look at what a skill says that it measured.

    Raises:
        SkillError: A metric is neither a number, nor a truth value, nor text.
    """
    for complaint in wrong_metrics(skill, skill.metrics):
        raise SkillError(complaint)


def wrong_metrics(skill: Skill, metrics: object) -> Iterator[str]:
    """Everything wrong with metrics of a skill, or numbers of its failure, a sentence each."""
    if not isinstance(metrics, Mapping):
        yield f"metrics of {_name(skill)} are {_shown(metrics)}: they are a dict, by name"
        return
    for name, value in metrics.items():
        if not _is_metric(name, value):
            yield (
                f"metric {_shown(name)} of {_name(skill)} is {_shown(value)}: a metric is a "
                "number that a float can hold, true or false, or text"
            )


def plain(found: object) -> dict[str, Number]:
    """Those numbers that are metrics, as JSON knows them."""
    if not isinstance(found, Mapping):
        return {}
    scalars = {name: _scalar(value) for name, value in found.items() if isinstance(name, str)}
    return {name: value for name, value in scalars.items() if _is_number(value)}


def _is_metric(name: object, value: object) -> bool:
    return isinstance(name, str) and _is_number(_scalar(value))


def _is_number(value: object) -> TypeGuard[Number]:
    """Whether JSON knows it, or can: NaN says nothing, and what no float holds nobody reads."""
    if not isinstance(value, bool | int | float | str):
        return False
    if isinstance(value, int) and abs(value) > _LARGEST:
        return False
    return not (isinstance(value, float) and math.isnan(value))


def _scalar(value: object) -> object:
    """The one number of NumPy's scalars and arrays of one; anything else as it is."""
    return value.item() if isinstance(value, np.generic | np.ndarray) and value.size == 1 else value


def _name(skill: Skill) -> str:
    return type(skill).__name__


def _shown(value: object) -> str:
    """A value in a sentence: on one line, and not too long."""
    try:
        text = " ".join(repr(value).split())
    except Exception:  # noqa: BLE001 - a foreign repr; the sentence is for its author
        text = f"an object of {type(value).__name__}"
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"
