"""Where the shipped trees, skills and assets lie, and where what was computed is kept.

The former in a checkout, an editable install and a wheel alike.
"""

from __future__ import annotations

import os
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent
_NOWHERE = Path(os.devnull)  # no folder, and none can be made in it


def share_dir(kind: str) -> Path:
    """The folder of shipped ``"trees"``, ``"skills"`` or ``"assets"``.

    A wheel carries them below the package; in a checkout they stand beside it.

    Raises:
        FileNotFoundError: The installation is broken: neither place has the folder.
    """
    for root in (_PACKAGE / "_share", _PACKAGE.parent):
        if (root / kind).is_dir():
            return root / kind
    raise FileNotFoundError(f"bt_dualarm is installed without its folder {kind!r}")


def cache_dir() -> Path:
    """Where what was computed is kept: ``$XDG_CACHE_HOME/bt_dualarm``, else ``~/.cache``.

    Who has neither, nor an account with a home, gets a place that cannot be written.
    """
    given = os.environ.get("XDG_CACHE_HOME")
    try:
        root = Path(given) if given else Path.home() / ".cache"
    except RuntimeError:
        root = _NOWHERE
    return root / "bt_dualarm"
