"""The run of a record made ready again, from what the record keeps of its tree."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bt_dualarm.preflight.check import check
from bt_dualarm.replay.record import Facts, Record, ReplayError
from bt_dualarm.runtime.options import RunOptions, checked_reality
from bt_dualarm.runtime.processor import processor
from bt_dualarm.runtime.run import Run
from bt_dualarm.runtime.signals import StopRequest
from bt_dualarm.runtime.summary import versions
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.spec.reader import read_text
from bt_dualarm.spec.source import Source


@dataclass(frozen=True)
class Changed:
    """What else is to be otherwise than in the record.

    Attributes:
        tree: Path of another tree file; None takes the record's own text.
        options: Options that the record's are replaced by, by their names.
        params: Values of parameters, besides those of the record.
    """

    tree: Path | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    params: Mapping[str, object] = field(default_factory=dict)


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
        ReplayError: A file that the tree included is not there any more, or is another.
        DualArmError: The run cannot be made, as in `bt_dualarm.runtime.api.open`.
    """
    start = record.start
    tree: Path | Source = changed.tree or _own_text(record)
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
    root = Path(record.start["path"]).parent
    for page, digest in record.start["pages"].items():
        if _digest(root / page) != digest:
            yield f"the robot's page {page} is not what it was"


def _of_skill(name: str, said: Facts, registry: Registry) -> Iterator[str]:
    if name not in registry.skills:
        yield f"there is no skill {name!r} now (skills of your own: --skills DIR)"
    elif said["file"] and _digest(Path(said["file"])) != said["sha256"]:
        yield f"the code of {name} ({said['file']}) is not what it was"


def _own_text(record: Record) -> Source:
    """The record's own text of the tree; what it includes must be what it was."""
    (name, text), *included = record.start["texts"].items()
    for path, was in included:
        try:
            now = Path(path).read_text(encoding="utf-8")
        except (OSError, ValueError) as error:
            raise ReplayError(
                f"{path}, which the tree includes, cannot be read: {error}"
            ) from error
        if now.splitlines() != was.splitlines():
            raise ReplayError(f"{path}, which the tree includes, is not what it was")
    return read_text(text, name)


def _digest(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""
