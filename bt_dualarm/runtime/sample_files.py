"""Samples on their way to the disk: a file for each thing, put into one archive at the end."""

from __future__ import annotations

import logging
import shutil
import zipfile
from pathlib import Path
from typing import BinaryIO

import numpy as np

from bt_dualarm.runtime.growing_array import GrowingArray
from bt_dualarm.runtime.tracks import Sample

_log = logging.getLogger(__name__)

_TOGETHER = 200
"""Samples that are written at a time: two seconds at 100 Hz."""

_TIME = "time"
_BLOCK = 1 << 20


class SampleFiles:
    """A folder of ``.npy`` files that grow: ``time``, and one for each thing that was ever there.

    All have as many rows, NaN where a thing was not in the world. Where they cannot be written the
    run goes on, and the archive is refused at the end.

    Args:
        folder: The folder; it is made with the first samples.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._files: dict[str, GrowingArray] = {}
        self._waiting: list[Sample] = []
        self._rows = 0
        self._failure: OSError | None = None

    def add(self, sample: Sample) -> None:
        """Take up one sample."""
        self._waiting.append(sample)
        if len(self._waiting) >= _TOGETHER:
            self.flush()

    def flush(self) -> None:
        """Write what waits."""
        waiting, self._waiting = self._waiting, []
        if self._failure is not None or not waiting:
            return
        try:
            self._append(waiting)
        except OSError as error:
            self._failure = error
            _log.warning("samples are not kept while the run goes on: %s", error)

    def write_archive(self, file: BinaryIO) -> None:
        """All of them as one ``.npz``, compressed block by block.

        Raises:
            OSError: They could not be written, or the disk is full now.
        """
        self.flush()
        if self._failure is not None:
            raise self._failure
        self._file(_TIME, ())
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, array in self._files.items():
                with (
                    array.path.open("rb") as source,
                    archive.open(f"{name}.npy", "w", force_zip64=True) as target,
                ):
                    shutil.copyfileobj(source, target, _BLOCK)

    def remove(self) -> None:
        """Take the folder away, once the archive is there."""
        for array in self._files.values():
            array.path.unlink(missing_ok=True)
        if self._folder.is_dir():
            self._folder.rmdir()

    def _append(self, samples: list[Sample]) -> None:
        self._file(_TIME, ()).append(np.array([sample.time for sample in samples]))
        columns = {name: np.full((len(samples), 3), np.nan) for name in self._files}
        for row, sample in enumerate(samples):
            for name, point in zip(sample.names, sample.points, strict=True):
                if name not in columns:
                    columns[name] = np.full((len(samples), 3), np.nan)
                columns[name][row] = point
        for name, points in columns.items():
            if name != _TIME:
                self._file(name, (3,)).append(points)
        self._rows += len(samples)

    def _file(self, name: str, shape: tuple[int, ...]) -> GrowingArray:
        if name not in self._files:
            self._folder.mkdir(exist_ok=True)
            self._files[name] = GrowingArray(self._folder / f"{name}.npy", shape)
            self._files[name].append_unknown(self._rows)
        return self._files[name]
