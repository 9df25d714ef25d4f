"""One arm's blackboard.

Not py_trees' own: that is one dictionary for the whole process, so that two trees that write
``target`` overwrite each other.
"""

from __future__ import annotations

import re

from bt_dualarm.errors import Failure
from bt_dualarm.spec.ports import REFERENCE, as_text, key_name, shown
from bt_dualarm.spec.source import Data


class Board:
    """Values by key, in YAML's notation."""

    def __init__(self) -> None:
        self._values: dict[str, Data] = {}

    def read(self, key: str) -> Data:
        """The value of a key.

        Raises:
            Failure: ``NO_VALUE`` when nothing was written yet.
        """
        if key not in self._values:
            raise Failure("NO_VALUE", f"no node has written '{key_name(key)}' yet")
        return self._values[key]

    def write(self, key: str, value: Data) -> None:
        """Set a key, whatever it was before."""
        self._values[key] = value

    def write_out(self, text: str) -> str:
        """Text with each ``{key}`` replaced by its value, as it is where it has none."""
        return REFERENCE.sub(self._written, text)

    def _written(self, match: re.Match[str]) -> str:
        key = match[1]
        return as_text(self._values[key]) if key in self._values else shown(match[0])
