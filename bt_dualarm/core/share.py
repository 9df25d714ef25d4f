"""Shipped files, the cache folder, atomic writes, and lookup of names with suggestions."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from secrets import token_hex
from typing import BinaryIO, Final, ParamSpec
from weakref import WeakMethod

# Where the shipped trees, skills and assets lie, and where what was computed is kept.
#
# The former in a checkout, an editable install and a wheel alike.


_PACKAGE: Final = Path(__file__).resolve().parents[1]
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


# Files that are there whole or not at all: written beside their place, then moved into it.


def write_atomically(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """Create or replace a file; a reader sees the old content or all of the new.

    Args:
        path: File in a folder that exists.
        write: Writer of the content into the open file.

    Raises:
        OSError: The disk is full or the folder is not writable; nothing is left behind.
    """
    # Threads share the number of their process, and containers that of their first process.
    beside = path.with_name(f".{path.name}.{os.getpid()}.{token_hex(4)}")
    try:
        with beside.open("xb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def leftovers(path: Path) -> list[Path]:
    """Files beside that place which a process left there when it was killed while it wrote."""
    ending = re.compile(re.escape(f".{path.name}.") + r"\d+\.[0-9a-f]{8}")
    return [beside for beside in path.parent.iterdir() if ending.fullmatch(beside.name)]


def write_text(path: Path, text: str) -> None:
    """As `write_atomically`, of text in UTF-8."""
    write_atomically(path, lambda file: file.write(text.encode()))


# Callbacks that do not keep alive whose they are.


Given = ParamSpec("Given")


def weakly(method: Callable[Given, None]) -> Callable[Given, None]:
    """A function that calls a method of an object as long as somebody else keeps the object.

    What looks on at a world refers to the world. If the world referred back, both, with all models
    and pictures, would stay in memory until Python looks for circles, which is late: a run has few
    objects, and large ones.

    Args:
        method: Method, bound to its object.
    """
    reference = WeakMethod(method)

    def call(*given: Given.args, **named: Given.kwargs) -> None:
        alive = reference()
        if alive is not None:
            alive(*given, **named)

    return call


# Where machine code is kept: a folder named after the sources of all kernels.


@cache
def folder() -> Path:
    """Where the machine code of these sources is kept."""
    sources = sorted(_PACKAGE.rglob("*kernel*.py"))
    digest = hashlib.sha256(b"".join(source.read_bytes() for source in sources))
    return cache_dir() / "kernels" / digest.hexdigest()[:16]
