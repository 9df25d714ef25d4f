"""The folder in which a view without ``--record`` keeps what it looks back in."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from typing import Final

_OF_OURS: Final = re.compile(r"bt_dualarm_view_(\d{1,9})_\w+")


@contextmanager
def view_folder() -> Iterator[Path]:
    """A folder that is gone after the block; those of views that were killed go before it."""
    _clear_left_behind()
    prefix = f"bt_dualarm_view_{os.getpid()}_"
    with TemporaryDirectory(prefix=prefix, ignore_cleanup_errors=True) as folder:
        yield Path(folder)


def _clear_left_behind() -> None:
    """Remove this user's folders whose process no longer lives."""
    for folder in Path(gettempdir()).glob("bt_dualarm_view_*"):
        named = _OF_OURS.fullmatch(folder.name)
        if named and not _lives(int(named[1])) and _is_own(folder):
            shutil.rmtree(folder, ignore_errors=True)


def _is_own(folder: Path) -> bool:
    try:
        return folder.lstat().st_uid == os.getuid() and not folder.is_symlink()
    except OSError:  # another start was faster
        return False


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # somebody else's
        return True
    return True
