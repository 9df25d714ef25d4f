"""Grippers by their names, or by the paths of their YAML files."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from bt_dualarm.world.grippers.description import gripper_of
from bt_dualarm.world.grippers.gripper import Gripper
from bt_dualarm.world.grippers.gripper_entry import GripperFile
from bt_dualarm.world.robots.page_path import is_page, page_path, shipped_names


def gripper_names() -> tuple[str, ...]:
    """Names of the grippers in the shipped catalogue, sorted."""
    return shipped_names("gripper")


def load_gripper(name: str, root: Path | None = None) -> Gripper:
    """A gripper by its name in the catalogue, or by the path of a YAML file below ``root``.

    Raises:
        CatalogueError: No such gripper, or its file is wrong; the message names file and entry.
    """
    path = page_path("gripper", name, root)
    if is_page(name):
        return gripper_of(GripperFile(path))
    state = path.stat()
    return _catalogued(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=64)
def _catalogued(path: Path, _changed: int, _size: int) -> Gripper:
    """A shipped gripper, read again only when its page has changed."""
    return gripper_of(GripperFile(path))
