"""Writing a tuned colour back: into the tree file it came from, or as a piece of YAML."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from bt_dualarm.errors import DualArmError
from bt_dualarm.preflight.check import check
from bt_dualarm.runtime.atomic_write import write_text
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.color import Color
from bt_dualarm.spec.edit import with_value
from bt_dualarm.spec.load import load_tree_file
from bt_dualarm.spec.problems import SpecError, errors
from bt_dualarm.spec.source import Data
from bt_dualarm.tuning.color_port import choose, color_ports


class SavingError(DualArmError):
    """A file cannot be written; it is as it was."""


class Save(Protocol):
    """Where a tuned colour goes."""

    def __call__(self, color: Color) -> str:
        """Write it; returns a sentence on what was done.

        Raises:
            DualArmError: Nothing was written; the message says why.
        """


@dataclass(frozen=True)
class IntoTree:
    """Writes into a tree file and leaves all else in it as it is.

    Attributes:
        path: File to write to.
        arm: Name of the arm whose tree it is.
        line: Line of the leaf, where several look for a colour.
        registry: The installed skills.
        params: Parameters of the file as given on the command line.
    """

    path: Path
    arm: str
    line: int | None
    registry: Registry
    params: Mapping[str, str] = field(default_factory=dict)

    def __call__(self, color: Color) -> str:
        """Find the place anew: the file may have changed since it was read."""
        kinds = self.registry.kinds
        file = load_tree_file(self.path, kinds, self.params)
        port = choose(list(color_ports(file, self.arm, kinds)), self.arm, self.line)
        source, place = port.home()
        path = Path(source.file)
        text = path.read_bytes().decode("utf-8")
        edited = with_value(text, source.file, place, _like(source.get(place), color.data))
        _write(path, edited)
        self._prove(path, text)
        return f"written: {source.key_place(place)}"

    def _prove(self, path: Path, before: str) -> None:
        """Check the file as bt-check does; one that it refuses is put back as it was."""
        wrong = errors(check(self.path, self.registry.kinds, self.params).problems)
        if wrong:
            _write(path, before)
            raise SpecError(wrong)


@dataclass(frozen=True)
class AsSnippet:
    """Writes a file of its own, to be copied from.

    Attributes:
        path: File to write to.
        what: Description of the picture that the colour was picked from.
    """

    path: Path
    what: str

    def __call__(self, color: Color) -> str:
        """Write it."""
        _write(self.path, snippet(color, self.what))
        return f"written: {self.path}"


def snippet(color: Color, what: str) -> str:
    """A colour as the lines of a leaf's port."""
    origin = " ".join(what.split())
    return (
        f"# hue in degrees, saturation and value from 0 to 1; {origin}\ncolor: {color.notation}\n"
    )


def _like(old: Data, new: Data) -> Data:
    """The new ranges without those defaults that the old ones did not write either."""
    if not isinstance(new, list):
        return new
    plain = Color(ranges=({"hue": (0.0, 0.0)},)).ranges[0].data  # type: ignore[arg-type]
    written = [set(item) for item in old] if isinstance(old, list) else []
    written += [set() for _ in range(len(new) - len(written))]
    return [
        {
            name: value
            for name, value in item.items()
            if name == "hue" or name in names or value != plain[name]
        }
        for item, names in zip(new, written, strict=False)
    ]


def _write(path: Path, text: str) -> None:
    """Whole or not at all; who may read a file that is there already stays as it is."""
    target = path.resolve()
    try:
        mode = target.stat().st_mode if target.exists() else None
        write_text(target, text)
        if mode is not None:
            target.chmod(mode)
    except OSError as error:
        raise SavingError(f"cannot write {path}: {error.strerror or error}") from error
