"""Grippers by their names, or by the paths of their YAML files."""

from __future__ import annotations

import os
from functools import lru_cache
from pathlib import Path

from bt_dualarm.errors import CatalogueError
from bt_dualarm.share import share_dir
from bt_dualarm.spec.problems import suggestion
from bt_dualarm.world.grippers.description import gripper_of
from bt_dualarm.world.grippers.gripper import Gripper
from bt_dualarm.world.grippers.gripper_entry import GripperFile
from bt_dualarm.world.robots.arm_description import file_below
from bt_dualarm.world.robots.catalogue import is_page


def gripper_names() -> tuple[str, ...]:
    """Names of the grippers in the shipped catalogue, sorted."""
    return tuple(sorted(path.stem for path in (share_dir("assets") / "grippers").glob("*.yaml")))


def load_gripper(name: str, root: Path | None = None) -> Gripper:
    """A gripper by its name in the catalogue, or by the path of a YAML file below ``root``.

    Raises:
        CatalogueError: No such gripper, or its file is wrong; the message names file and entry.
    """
    path = _gripper_file(name, root)
    if is_page(name):
        return gripper_of(GripperFile(path))
    state = path.stat()
    return _catalogued(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=64)
def _catalogued(path: Path, _changed: int, _size: int) -> Gripper:
    """A shipped gripper, read again only when its page has changed."""
    return gripper_of(GripperFile(path))


def _gripper_file(name: str, root: Path | None) -> Path:
    if is_page(name):
        folder = (root or Path.cwd()).resolve()
        path = file_below(folder, name)
        if path is not None:
            return path
        raise CatalogueError(
            f"there is no gripper file {name!r} below {folder}; {_elsewhere(folder, name)}"
        )
    if name in gripper_names():
        return share_dir("assets") / "grippers" / f"{name}.yaml"
    near = suggestion(name, gripper_names(), "gripper")
    raise CatalogueError(f"there is no gripper {name!r} in the catalogue; {near}")


def _elsewhere(folder: Path, name: str) -> str:
    """A hint for the path of a page that is not there, or not below the folder."""
    path = Path(os.path.normpath(folder / name.replace("\0", "")))
    if not path.is_relative_to(folder):
        return "a gripper's page lies beside the tree file or in a folder below it"
    pages = [page.name for page in path.parent.glob("*.yaml") if page != path]
    return suggestion(path.name, pages, "gripper file")
