"""Options of a run, and the lookup of tree files by name."""

from __future__ import annotations

import difflib
import math
import operator
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from numbers import Real
from pathlib import Path
from typing import Final, get_args

from pydantic import ValidationError

from bt_dualarm.core.errors import DualArmError, RunError
from bt_dualarm.core.share import kind_at, share_dir
from bt_dualarm.sim.frame import RendererKind
from bt_dualarm.spec.document import REALITY_NAMES, Reality, RealitySpec
from bt_dualarm.spec.explain import explain
from bt_dualarm.spec.faults import FaultSpec
from bt_dualarm.spec.problems import suggestion


class NoSuchTree(DualArmError):  # noqa: N818 - it reads as a sentence
    """Neither a file nor a shipped tree has this name; the message suggests the nearest one."""


@dataclass(frozen=True)
class ShippedTree:
    """A tree that is shipped with the package.

    Attributes:
        name: Name that `find_tree` accepts.
        description: One line.
        path: Path of its file.
    """

    name: str
    description: str
    path: Path


def find_tree(given: str) -> Path:
    """Path of a tree file, given its path or the name of a shipped tree.

    ``pick_and_track``, ``pick_and_track.yaml`` and ``trees/pick_and_track.yaml`` are equivalent.

    Raises:
        NoSuchTree: It is neither.
    """
    trees = share_dir("trees")
    names = [tree.stem for tree in sorted(trees.glob("*.yaml"))]
    if not given.strip():
        raise NoSuchTree(f"tree: {given!r} is not a path\n  = shipped trees: {', '.join(names)}")
    path = Path(given)
    if kind_at(path) == "file":
        return path
    name = given.removeprefix("./").removeprefix("trees/").removesuffix(".yaml")
    shipped = trees / f"{name}.yaml"
    if kind_at(shipped) == "file" and shipped.resolve().is_relative_to(trees.resolve()):
        return shipped
    if kind_at(path) == "folder":
        raise NoSuchTree(f"{given}: is a folder, not a tree file")
    if kind_at(path):
        raise NoSuchTree(f"{given}: is a pipe or a device, not a tree file")
    # By what is before the ending, which all of them have in common.
    beside = [tree.stem for tree in sorted(path.parent.glob("*.yaml"))] if "." in given else []
    near = difflib.get_close_matches(name, names, n=1)
    files = difflib.get_close_matches(path.stem, beside, n=1)
    near = [str(path.with_name(f"{file}.yaml")) for file in files] or near
    own = path.with_name(f"{path.name}.yaml") if path.name else path
    near = [str(own)] if kind_at(own) == "file" else near
    hint = f"did you mean '{near[0]}'?" if near else f"shipped trees: {', '.join(names)}"
    raise NoSuchTree(f"{given}: there is no such file, nor a shipped tree of this name\n  = {hint}")


def shipped_trees() -> tuple[ShippedTree, ...]:
    """All shipped trees, sorted by name."""
    from bt_dualarm.spec.yaml_reader import read_file

    found = []
    for path in sorted(share_dir("trees").glob("*.yaml")):
        content = read_file(path).data
        text = content.get("description", "") if isinstance(content, dict) else ""
        found.append(ShippedTree(path.stem, str(text), path))
    return tuple(found)


MOST_SEED: Final = 2**32 - 1
"""Largest seed accepted."""


@dataclass(frozen=True)
class RunOptions:
    """Overrides of the file's settings, and options of the run; checked on construction.

    Attributes:
        seed: Seed of all random numbers; None for the file's.
        duration: Simulated seconds after which the run ends; None for the file's time limit only.
        renderer: Renderer of the cameras; None for the file's.
        reality: Name of a preset, or settings as below ``reality`` in a tree file; None takes the
            file's.
        record: Folder of the record; None for no record.
        real_time: Whether the run is no faster than the wall clock.
        watchdog: Wall-clock budget of each tick and callback of a skill, s; infinity for no limit
            before the end of the run; None for no watchdog.
        frames: Whether the record includes the cameras' images.
        faults: Faults in addition to the file's, by name, checked against the file.

    Raises:
        RunError: A value is invalid; the message states what is allowed.
    """

    seed: int | None = None
    duration: float | None = None
    renderer: RendererKind | None = None
    reality: Reality | None = None
    record: Path | None = None
    real_time: bool = False
    watchdog: float | None = None
    frames: bool = False
    faults: Mapping[str, FaultSpec] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.seed is not None:
            object.__setattr__(self, "seed", checked_seed(self.seed))
        if self.duration is not None:
            object.__setattr__(self, "duration", checked_seconds(self.duration, "duration"))
        if self.watchdog is not None and self.watchdog != math.inf:
            object.__setattr__(self, "watchdog", checked_seconds(self.watchdog, "watchdog"))
        kinds = get_args(RendererKind)
        if self.renderer is not None and self.renderer not in kinds:
            hint = suggestion(str(self.renderer), kinds, "renderer")
            raise RunError(f"there is no renderer {self.renderer!r}; {hint}")
        if self.reality is not None:
            object.__setattr__(self, "reality", checked_reality(self.reality))
        for name in ("real_time", "frames"):
            value = getattr(self, name)
            if not isinstance(value, bool):
                raise RunError(f"{name}: {value!r} is not True or False")
        if self.frames and self.record is None:
            raise RunError("frames are written to a record: give its folder")


def checked_seed(seed: object) -> int:
    """The seed as a Python integer.

    Raises:
        RunError: The seed is not an integer from 0 to `MOST_SEED`.
    """
    try:
        number = -1 if isinstance(seed, bool) else operator.index(seed)  # type: ignore[arg-type]  # TypeError below
    except TypeError:
        number = -1
    if not 0 <= number <= MOST_SEED:
        raise RunError(f"seed: {seed!r} is not a whole number from 0 to {MOST_SEED}")
    return number


def checked_path(given: object, what: str) -> Path:
    """The path that an argument names.

    Args:
        given: The argument.
        what: Its name.

    Raises:
        RunError: It is no path, or an empty text, which `Path` would read as the current folder.
    """
    text = os.fspath(given) if isinstance(given, os.PathLike) else given
    if not isinstance(text, str) or not text.strip() or "\0" in text:
        raise RunError(f"{what}: {given!r} is not a path; '.' is the current folder")
    return Path(text)


def listed(given: object) -> list[object]:
    """The values of an argument that may be a single value or several."""
    if isinstance(given, (str, os.PathLike)) or not isinstance(given, Iterable):
        return [given]
    return list(given)


def checked_params(params: object) -> Mapping[str, object]:
    """Values of parameters by name; empty for None.

    Raises:
        RunError: The argument is not a mapping.
    """
    if params is None:
        return {}
    if not isinstance(params, Mapping):
        raise RunError(f"params: {params!r} is not a mapping from names to values")
    return params


def checked_seconds(seconds: object, what: str) -> float:
    """The duration as a float, s.

    Raises:
        RunError: The duration is not a finite number above 0.
    """
    real = isinstance(seconds, Real) and not isinstance(seconds, bool)
    try:
        finite = real and math.isfinite(seconds)  # type: ignore[arg-type]  # real
    except OverflowError:  # a whole number that no float can hold
        finite = False
    if not (finite and seconds > 0):  # type: ignore[operator]  # real
        raise RunError(f"{what}: {seconds!r} is not a number of seconds above 0")
    return float(seconds)  # type: ignore[arg-type]  # real


def checked_reality(reality: object) -> Reality:
    """The reality settings, validated as in a tree file.

    Raises:
        RunError: There is no such preset, or a field is invalid.
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
        path = ".".join(map(str, ("reality", *found.path)))
        raise RunError(f"{path}: {found.message} {found.hint}".rstrip()) from error
