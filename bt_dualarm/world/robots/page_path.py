"""Where the page of a robot or a gripper lies: in the catalogue, or below a folder of a user."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Literal

from bt_dualarm.errors import CatalogueError
from bt_dualarm.share import share_dir
from bt_dualarm.spec.problems import suggestion

Kind = Literal["robot", "gripper"]
"""What a page is of; the catalogue has a folder for each."""


def is_page(name: str) -> bool:
    """Whether something is named by the path of its page, and not as the catalogue does."""
    return name.endswith((".yaml", ".yml"))


def shipped_names(kind: Kind) -> tuple[str, ...]:
    """Names in the shipped catalogue, sorted."""
    return tuple(sorted(path.stem for path in (share_dir("assets") / f"{kind}s").glob("*.yaml")))


def page_path(kind: Kind, name: str, root: Path | None) -> Path:
    """The page of a robot or gripper.

    Args:
        kind: Which of the two.
        name: Name in the catalogue, or path of a YAML file below ``root``.
        root: Folder in which the path begins; by default the current one.

    Raises:
        CatalogueError: There is none; the message tells what is near.
    """
    if is_page(name):
        folder = (root or Path.cwd()).resolve()
        path = file_below(folder, name)
        if path is not None:
            return path
        raise CatalogueError(
            f"there is no {kind} file {name!r} below {folder}; {_elsewhere(kind, folder, name)}"
        )
    if name in shipped_names(kind):
        return share_dir("assets") / f"{kind}s" / f"{name}.yaml"
    near = suggestion(name, shipped_names(kind), kind)
    raise CatalogueError(f"there is no {kind} {name!r} in the catalogue; {near}")


def file_below(folder: Path, name: str) -> Path | None:
    """The file of that name if there is one in the folder, or in one of its own."""
    try:
        path = (folder / name).resolve()
        return path if path.is_file() and path.is_relative_to(folder) else None
    except (OSError, RuntimeError, ValueError):  # a name too long, a loop of symlinks, a NUL
        return None


def _elsewhere(kind: Kind, folder: Path, name: str) -> str:
    """A hint for the path of a page that is not there, or not below the folder."""
    path = Path(os.path.normpath(folder / name.replace("\0", "")))
    if not path.is_relative_to(folder):
        return f"a {kind}'s page lies beside the tree file or in a folder below it"
    pages = [page.name for page in path.parent.glob("*.yaml") if page != path]
    return suggestion(path.name, pages, f"{kind} file")
