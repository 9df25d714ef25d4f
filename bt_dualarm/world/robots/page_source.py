"""Where the URDF of a page lies, and how the page is to name it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from bt_dualarm.errors import CatalogueError
from bt_dualarm.world.robots.example_robot_data import robot_data_dir


@dataclass(frozen=True)
class PageSource:
    """A URDF, and an SRDF beside it.

    Attributes:
        path: File of the URDF.
        name: URDF as the page is to name it.
        srdf: SRDF as the page is to name it; None if there is none of that name.
    """

    path: Path
    name: str
    srdf: str | None


def find_urdf(given: str, folder: Path) -> PageSource:
    """A URDF by its path, or by that below example-robot-data's ``robots``.

    Args:
        given: What the user wrote.
        folder: Folder of the page, without detours.

    Raises:
        CatalogueError: There is none, or no page in that folder could name it.
    """
    data = robot_data_dir()
    try:
        found = [path.resolve() for path in (Path(given), data / given) if path.is_file()]
    except (OSError, ValueError) as error:  # a name too long, a NUL
        raise CatalogueError(f"there is no URDF {given[:80]!r}") from error
    if not found:
        raise CatalogueError(f"there is no URDF {given!r}, neither here nor in {data}")
    for root in (folder, data):
        if found[0].is_relative_to(root):
            return PageSource(found[0], str(found[0].relative_to(root)), _srdf(found[0], root))
    raise CatalogueError(
        f"{found[0]} lies neither below {folder}, where the page is to be, nor in "
        "example-robot-data; put the page above it (--out), or copy the URDF and its meshes there"
    )


def _srdf(urdf: Path, root: Path) -> str | None:
    """The SRDF of the same name, beside the URDF or in the folder ``srdf`` of its package."""
    for folder in (urdf.parent, urdf.parent.parent / "srdf"):
        path = folder / f"{urdf.stem}.srdf"
        if path.is_file() and path.is_relative_to(root):
            return str(path.relative_to(root))
    return None
