"""Python data in place of a YAML file: the same strictness, with keys for places.

What a file may not say, a mapping may not say either: keys are text, numbers are finite and of
sensible size, depth and number of values have the caps of a file.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import PurePath

import numpy as np

from bt_dualarm.spec.problems import Place, Problem, SpecError
from bt_dualarm.spec.reader import MAX_BYTES, MAX_DEPTH, MAX_NODES, MAX_PROBLEMS
from bt_dualarm.spec.scalars import LARGEST_INTEGER, control_character
from bt_dualarm.spec.source import Data, Path, Source


class MappingSource(Source):
    """A tree that was given as Python data; a place is told by the keys that lead to it.

    Args:
        file: Name in messages; what is relative in the tree starts from the folder before it.
        data: Data, as YAML would have it.
        order: Every path in ``data`` with its number in the order of the mapping.
    """

    def __init__(self, file: str, data: Data, order: Mapping[Path, int]) -> None:
        super().__init__(file, (), data)
        self._order = order

    @property
    def text(self) -> str:
        """The data as JSON, which is YAML, too."""
        return json.dumps(self.data)

    def place(self, path: Path) -> Place:
        """The value at ``path``, or the nearest one above it that is there."""
        there = next(path[:end] for end in range(len(path), -1, -1) if path[:end] in self._order)
        return Place(self.file, rank=self._order[there], keys=dotted(there))

    def key_place(self, path: Path) -> Place:
        """The same: a key and its value have one path."""
        return self.place(path)


def read_mapping(mapping: Mapping[str, object], file: str = "<mapping>") -> Source:
    """Take Python data as a tree file; ``file`` is how messages name it.

    Tuples are lists, NumPy's arrays and scalars are what they hold, paths are text.

    Raises:
        SpecError: Something in it is nothing that YAML could say, or a cap is exceeded.
    """
    data, order = plain(mapping, file)
    return MappingSource(file, data, order)


def plain(value: object, file: str) -> tuple[Data, dict[Path, int]]:
    """Any Python value as YAML data, and every path in it with its number.

    Raises:
        SpecError: Something in it is nothing that YAML could say, or a cap is exceeded.
    """
    reading = _Reading(file)
    try:
        data = reading.value(value, ())
    except _GiveUpError:
        data = None
    if reading.problems:
        raise SpecError(reading.problems)
    return data, reading.order


def dotted(path: Path) -> str:
    """Keys joined by dots, indices in brackets: ``arms.arm1.tree.sequence[0]``."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)
    return "".join(parts).removeprefix(".")


class _GiveUpError(Exception):
    """Reading on would help nobody: a cap was exceeded."""


class _Reading:
    """Python data on its way to YAML data, noting the order of its parts."""

    def __init__(self, file: str) -> None:
        self.problems: list[Problem] = []
        self.order: dict[Path, int] = {}
        self._file = file
        self._characters = 0

    def value(self, value: object, path: Path) -> Data:
        self._count(path)
        if isinstance(value, (np.ndarray, np.generic)):
            value = value.tolist()
        if isinstance(value, Mapping):
            return self._mapping(value, path)
        if isinstance(value, (list, tuple)):
            return [self.value(item, (*path, index)) for index, item in enumerate(value)]
        if isinstance(value, (str, PurePath)):
            # Of an enumeration's member, which is text too, the value and not the name.
            return self._text(str.__str__(value) if isinstance(value, str) else str(value), path)
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            return self._number(value, path)
        if value is None or isinstance(value, bool):
            return value
        wanted = "a mapping, a list, text, a number, true, false or None"
        self._add(path, f"{type(value).__name__} is nothing that a tree can hold", wanted)
        return None

    def _mapping(self, mapping: Mapping[object, object], path: Path) -> Data:
        data: dict[str, Data] = {}
        for key, item in mapping.items():
            if isinstance(key, str):
                name = self._text(key, path)
                data[name] = self.value(item, (*path, name))
            else:
                hint = f"write it as text: '{key}'"
                self._add(path, f"key {str(key)[:40]} is not text", hint)
        return data

    def _text(self, text: str, path: Path) -> str:
        self._characters += len(text)
        if self._characters > MAX_BYTES:
            self._add(path, f"more than {MAX_BYTES // 1024} Ki characters of text")
            raise _GiveUpError
        if any(0xD800 <= ord(letter) <= 0xDFFF for letter in text):
            self._add(path, "text with half of a pair of surrogates", "it is no Unicode text")
            return ""
        control = control_character(text)
        if control:
            self._add(path, f"the control character {control} is not allowed")
            return ""
        return text

    def _number(self, number: int | float, path: Path) -> int | float:
        if not math.isfinite(number):
            self._add(path, f"'{number}' is not a finite number")
            return 0
        if isinstance(number, int) and abs(number) > LARGEST_INTEGER:
            self._add(path, "this number is too large", f"at most {LARGEST_INTEGER} is allowed")
            return 0
        return number

    def _count(self, path: Path) -> None:
        if len(path) >= MAX_DEPTH:
            self._add(path[:1], f"nested deeper than {MAX_DEPTH} levels")
            raise _GiveUpError
        if len(self.order) >= MAX_NODES:
            self._add(path[:1], f"more than {MAX_NODES} values in one tree")
            raise _GiveUpError
        self.order[path] = len(self.order)

    def _add(self, path: Path, message: str, hint: str = "") -> None:
        place = Place(self._file, rank=self.order.get(path, 0), keys=dotted(path))
        self.problems.append(Problem(place, message, hint))
        if len(self.problems) >= MAX_PROBLEMS:
            raise _GiveUpError
