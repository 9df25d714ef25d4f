"""The run of a record made ready again, from what the record keeps of its tree."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from bt_dualarm.preflight.check import check
from bt_dualarm.recording.untrusted import HistoryError, read_regular
from bt_dualarm.replay.record import Facts, Record
from bt_dualarm.runtime.options import RunOptions, checked_reality
from bt_dualarm.runtime.processor import processor
from bt_dualarm.runtime.run import Run
from bt_dualarm.runtime.signals import StopRequest
from bt_dualarm.runtime.summary import versions
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.reader import read_text
from bt_dualarm.spec.source import Source

_MOST_SOURCE: Final = 1 << 24
"""Bytes of a file of code, or of a page, that is compared with a record."""


@dataclass(frozen=True)
class Changed:
    """What else is to be otherwise than in the record.

    Attributes:
        tree: Path of another tree file; None takes the record's own text.
        options: Options that the record's are replaced by, by their names.
        params: Values of parameters, besides those of the record.
        includes: Whether files that the record's tree includes are taken as they are now.
    """

    tree: Path | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    params: Mapping[str, object] = field(default_factory=dict)
    includes: bool = False


@dataclass(frozen=True, eq=False)
class Remade:
    """A run at its beginning.

    Attributes:
        run: The run; nothing has moved yet.
        trees: Root of each arm's tree, as it was read.
    """

    run: Run
    trees: Mapping[str, NodeSpec]


def made_anew(
    record: Record, registry: Registry, changed: Changed, stop: StopRequest | None = None
) -> Remade:
    """The same run at its beginning; nothing has moved yet.

    Args:
        record: The record.
        registry: The skills.
        changed: What is to be otherwise.
        stop: Request to end early that somebody else may make.

    Raises:
        DualArmError: The run cannot be made, as in `bt_dualarm.runtime.api.open`.
    """
    start = record.start
    tree = changed.tree or _own_text(record, from_disk=changed.includes)
    params = {**start["params"], **dict(changed.params)}
    checked = check(tree, registry.kinds, params, build=False)
    reality = start["reality"]
    options = {
        "seed": start["seed"],
        "renderer": start["renderer"],
        "reality": None if reality is None else checked_reality(reality),
        "duration": start["duration"],
    } | dict(changed.options)
    file = checked.runnable()
    run = Run(file, registry, RunOptions(**options), stop=stop, warnings=checked.problems)
    return Remade(run, {name: arm.tree for name, arm in file.arms.items()})


def differences(record: Record, registry: Registry) -> Iterator[str]:
    """Sentences on what is not as it was when the record was made."""
    now, then = processor(), record.start["processor"]
    if now["arithmetic"] != then["arithmetic"]:
        yield (
            f"this is another kind of processor ({now['machine']}, {now['blas']}; the record's: "
            f"{then['machine']}, {then['blas']}): its numbers are rounded otherwise"
        )
    was = record.start["versions"]
    for name, version in versions().items():
        if was.get(name) != version:
            yield f"{name} is {version}, and was {was.get(name, 'not there')}"
    for name, said in record.start["skills"].items():
        yield from _of_skill(name, said, registry)
    for path, text in _included(record).items():
        if _lines_of(Path(path)) != text.splitlines():
            yield f"{path}, which the tree includes, is not what it was"
    root = Path(record.start["path"]).parent
    for page, digest in record.start["pages"].items():
        if _digest(root / page) != digest:
            yield f"the robot's page {page} is not what it was"


def _of_skill(name: str, said: Facts, registry: Registry) -> Iterator[str]:
    if name not in registry.skills:
        yield f"there is no skill {name!r} now (skills of your own: --skills DIR)"
    elif said["file"] and _digest(Path(said["file"])) != said["sha256"]:
        yield f"the code of {name} ({said['file']}) is not what it was"


def _own_text(record: Record, *, from_disk: bool) -> Source:
    """The record's own text of the tree, with what it includes.

    Args:
        record: The record.
        from_disk: Whether included files are taken as they are now, those that are still there.
    """
    source = read_text(next(iter(record.start["texts"].values())), record.start["path"])
    source.texts = {
        path: text
        for path, text in _included(record).items()
        if not (from_disk and Path(path).is_file())
    }
    return source


def _included(record: Record) -> dict[str, str]:
    """Texts of the files that the tree included, by their absolute paths."""
    (name, _), *included = record.start["texts"].items()
    there, given = Path(record.start["path"]), Path(name)
    # The paths may start from the folder that the run was started in.
    above = [*there.parents, Path()]
    root = Path() if given.is_absolute() else above[min(len(given.parts), len(above)) - 1]
    return {str(root / path): text for path, text in included}


def _lines_of(path: Path) -> list[str]:
    try:
        return read_regular(path, _MOST_SOURCE, links=True).decode("utf-8-sig").splitlines()
    except (HistoryError, ValueError):
        return []


def _digest(path: Path) -> str:
    """SHA-256 of a file, which a record names: of no pipe or device, and no more than there may be.

    Empty where there is no such file.
    """
    try:
        return hashlib.sha256(read_regular(path, _MOST_SOURCE, links=True)).hexdigest()
    except HistoryError:
        return ""
