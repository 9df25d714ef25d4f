"""NumPy files that grow while a run goes on: readable at any moment, whatever ends the process."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import numpy as np

from bt_dualarm.pose import Matrix, Vector

_NANS = 1 << 16
"""Rows of a column that came late that are filled up at a time."""


class GrowingArray:
    """One ``.npy`` file, whose rows are appended.

    Rows are written before the header that counts them. NumPy's headers leave room for a first axis
    of any length, so that the new one takes the place of the old.

    Args:
        path: The file; it is made.
        shape: Shape of one row.

    Raises:
        OSError: The file cannot be made.
    """

    def __init__(self, path: Path, shape: tuple[int, ...]) -> None:
        self.path = path
        self._shape = shape
        self._rows = 0
        with path.open("xb") as file:
            self._write_header(file)

    def append(self, values: Vector | Matrix) -> None:
        """Add rows, of shape (n, …) with the shape of a row.

        Raises:
            OSError: The disk is full, or the file is gone.
        """
        self._rows += len(values)
        with self.path.open("r+b") as file:
            file.seek(0, 2)
            file.write(np.ascontiguousarray(values, dtype="<f8").tobytes())
            file.flush()
            file.seek(0)
            self._write_header(file)

    def append_unknown(self, count: int) -> None:
        """Add so many rows that are not a number."""
        for first in range(0, count, _NANS):
            self.append(np.full((min(_NANS, count - first), *self._shape), np.nan))

    def _write_header(self, file: BinaryIO) -> None:
        header = {"descr": "<f8", "fortran_order": False, "shape": (self._rows, *self._shape)}
        np.lib.format.write_array_header_1_0(file, header)  # type: ignore[no-untyped-call]  # NumPy
