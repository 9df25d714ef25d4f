"""What whoever starts a run may say over its file, checked before anything else is done."""

from __future__ import annotations

import math
import operator
import os
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real
from pathlib import Path
from typing import Final, get_args

from pydantic import ValidationError

from bt_dualarm.errors import RunError
from bt_dualarm.spec.explain import explain
from bt_dualarm.spec.problems import suggestion
from bt_dualarm.spec.reality import REALITY_NAMES, Reality, RealitySpec
from bt_dualarm.world.rendering.renderer import RendererKind

MOST_SEED: Final = 2**32 - 1
"""Largest seed that NumPy's generators are given."""


@dataclass(frozen=True)
class RunOptions:
    """What overrides the file, and what becomes of the run.

    Attributes:
        seed: Seed of everything random; None takes the file's.
        duration: Simulated seconds after which the run ends; None for no end of its own.
        renderer: Renderer of the cameras; None takes the file's.
        reality: Name of a set, or what a tree file says below ``reality``; None takes the file's.
        record: Folder that the record of the run is written to; None for no record.
        real_time: Whether the run is held back to the pace of the clock on the wall.
        watchdog: Seconds on the wall that each tick and callback of a skill gets, infinity for as
            long as it takes; None for no watchdog.
        frames: Whether the record keeps the cameras' pictures, too.

    Raises:
        RunError: One of them makes no sense; the message says what is allowed.
    """

    seed: int | None = None
    duration: float | None = None
    renderer: RendererKind | None = None
    reality: Reality | None = None
    record: Path | None = None
    real_time: bool = False
    watchdog: float | None = None
    frames: bool = False

    def __post_init__(self) -> None:
        if self.seed is not None:
            object.__setattr__(self, "seed", checked_seed(self.seed))
        if self.duration is not None:
            checked_seconds(self.duration, "duration")
        if self.watchdog not in (None, math.inf):
            checked_seconds(self.watchdog, "watchdog")
        kinds = get_args(RendererKind)
        if self.renderer is not None and self.renderer not in kinds:
            hint = suggestion(str(self.renderer), kinds, "renderer")
            raise RunError(f"there is no renderer {self.renderer!r}; {hint}")
        if self.reality is not None:
            object.__setattr__(self, "reality", checked_reality(self.reality))
        if self.frames and self.record is None:
            raise RunError("frames are kept in a record: say which folder, too")


def checked_seed(seed: object) -> int:
    """A seed as a plain whole number.

    Raises:
        RunError: It is none, or outside of what NumPy takes.
    """
    try:
        number = -1 if isinstance(seed, bool) else operator.index(seed)  # type: ignore[arg-type]  # that is the question
    except TypeError:
        number = -1
    if not 0 <= number <= MOST_SEED:
        raise RunError(f"{seed!r} is not a whole number from 0 to {MOST_SEED}")
    return number


def checked_folder(folder: str | os.PathLike[str]) -> Path:
    """The folder of a record.

    Raises:
        RunError: The text is empty, which would mean the current folder.
    """
    if isinstance(folder, str) and not folder.strip():
        raise RunError("the folder of a record needs a name; '.' is the current folder")
    return Path(folder)


def checked_seconds(seconds: object, what: str) -> float:
    """A time that may be waited for.

    Raises:
        RunError: It is no number above 0, or has no end.
    """
    real = isinstance(seconds, Real) and not isinstance(seconds, bool)
    if not (real and math.isfinite(seconds) and seconds > 0):  # type: ignore[arg-type,operator]  # real
        raise RunError(f"{what}: {seconds!r} is not a number of seconds above 0")
    return float(seconds)  # type: ignore[arg-type]  # real


def checked_reality(reality: object) -> Reality:
    """A reality as a tree file may have it.

    Raises:
        RunError: There is no such set, or a field is wrong.
    """
    if isinstance(reality, RealitySpec):
        return reality
    if isinstance(reality, str):
        for name in REALITY_NAMES:
            if reality == name:
                return name
        hint = suggestion(reality, REALITY_NAMES, "reality")
        raise RunError(f"there is no reality {reality!r}; {hint}")
    if not isinstance(reality, Mapping):
        raise RunError(f"a reality is a name or a mapping, not {type(reality).__name__}")
    data = dict(reality)
    try:
        return RealitySpec.model_validate(data)
    except ValidationError as error:
        found = next(explain(error, RealitySpec, data, "field"))
        place = ".".join(map(str, ("reality", *found.path)))
        raise RunError(f"{place}: {found.message} {found.hint}".rstrip()) from error
