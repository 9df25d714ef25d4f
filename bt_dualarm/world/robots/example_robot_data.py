"""The installed example-robot-data: where the URDFs of the catalogue and their meshes lie."""

from __future__ import annotations

import functools
import importlib.metadata
from pathlib import Path

from bt_dualarm.errors import CatalogueError


@functools.cache
def robot_data_dir() -> Path:
    """Folder ``robots`` of the installed example-robot-data package.

    Raises:
        CatalogueError: It is not installed.
    """
    for file in importlib.metadata.files("example-robot-data") or []:
        if file.name == "package.xml" and "example-robot-data" in file.parts:
            return Path(str(file.locate())).resolve().parent / "robots"
    raise CatalogueError("the package example-robot-data is not installed")
