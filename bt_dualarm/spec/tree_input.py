"""Whatever a tree is given as: a file, the text of one, or Python data."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TypeAlias

from bt_dualarm.spec.mapping import read_mapping
from bt_dualarm.spec.reader import read_file, read_text
from bt_dualarm.spec.source import Source

TreeInput: TypeAlias = Path | str | Mapping[str, object] | Source
"""The path of a tree file, its path or its YAML as text, Python data, or one already read."""


def read_tree(tree: TreeInput, folder: Path | None = None) -> Source:
    """Read a tree, whichever form it has.

    Args:
        tree: The tree; see `is_yaml` for which text is taken for YAML.
        folder: Folder from which relative paths in YAML text or Python data start: included files,
            pages of robots; by default the current one. Those in a file start from its own.

    Raises:
        SpecError: It cannot be read; carries every reason.
    """
    if isinstance(tree, Source):
        return tree
    if isinstance(tree, Mapping):
        return read_mapping(tree, str((folder or Path()) / "<mapping>"))
    if isinstance(tree, str) and is_yaml(tree):
        return read_text(tree, str((folder or Path()) / "<text>"))
    return read_file(Path(tree))


def is_yaml(text: str) -> bool:
    """Whether text is YAML rather than a path: it has several lines, or is a flow mapping."""
    return "\n" in text or text.lstrip().startswith("{")
