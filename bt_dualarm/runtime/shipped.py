"""Tree files by name: those of the user first, then those that came with the package."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from pathlib import Path

from bt_dualarm.errors import DualArmError
from bt_dualarm.share import share_dir


class NoSuchTree(DualArmError):  # noqa: N818 - it reads as what it says
    """No file has this name, and no shipped tree either; the message names the nearest one."""


@dataclass(frozen=True)
class ShippedTree:
    """A tree that came with the package.

    Attributes:
        name: What `find_tree` knows it by.
        description: One line.
        path: Path of its file.
    """

    name: str
    description: str
    path: Path


def find_tree(given: str) -> Path:
    """The file that is meant: a path, or the name of a shipped tree in any of its forms.

    ``pick_and_track``, ``pick_and_track.yaml`` and ``trees/pick_and_track.yaml`` are the same.

    Raises:
        NoSuchTree: It is neither.
    """
    path = Path(given)
    if path.is_file():
        return path
    trees = share_dir("trees")
    name = given.removeprefix("./").removeprefix("trees/").removesuffix(".yaml")
    shipped = trees / f"{name}.yaml"
    if shipped.is_file() and shipped.resolve().is_relative_to(trees.resolve()):
        return shipped
    if path.is_dir():
        raise NoSuchTree(f"{given}: is a folder, not a tree file")
    if path.exists():
        raise NoSuchTree(f"{given}: is a pipe or a device, not a tree file")
    names = [tree.stem for tree in sorted(trees.glob("*.yaml"))]
    near = difflib.get_close_matches(name, names, n=1)
    hint = f"did you mean '{near[0]}'?" if near else f"shipped are: {', '.join(names)}"
    raise NoSuchTree(f"{given}: there is no such file, nor a shipped tree of this name\n  = {hint}")


def shipped_trees() -> tuple[ShippedTree, ...]:
    """All of them, by name."""
    from bt_dualarm.spec.reader import read_file

    found = []
    for path in sorted(share_dir("trees").glob("*.yaml")):
        content = read_file(path).data
        text = content.get("description", "") if isinstance(content, dict) else ""
        found.append(ShippedTree(path.stem, str(text), path))
    return tuple(found)
