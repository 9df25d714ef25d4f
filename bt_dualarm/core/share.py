"""Shipped files, the cache folder, atomic writes, and lookup of names with suggestions."""

from __future__ import annotations

import errno
import hashlib
import os
import re
import stat
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from secrets import token_hex
from typing import BinaryIO, Final, Literal, ParamSpec
from weakref import ref

_PACKAGE: Final = Path(__file__).resolve().parents[1]
_NOWHERE = Path(os.devnull)  # not a folder, and none can be created in it


def share_dir(kind: str) -> Path:
    """Folder of the shipped ``"trees"``, ``"skills"`` or ``"assets"``.

    A wheel contains them below the package; in a checkout they are next to it.

    Raises:
        FileNotFoundError: The installation is broken: the folder is in neither location.
    """
    for root in (_PACKAGE / "_share", _PACKAGE.parent):
        if (root / kind).is_dir():
            return root / kind
    raise FileNotFoundError(f"bt_dualarm was installed without its folder {kind!r}")


def cache_dir() -> Path:
    """Cache folder: ``$XDG_CACHE_HOME/bt_dualarm``, otherwise ``~/.cache/bt_dualarm``.

    For a user without a home directory the path is not writable.
    """
    given = os.environ.get("XDG_CACHE_HOME")
    try:
        root = Path(given) if given else Path.home() / ".cache"
    except RuntimeError:
        root = _NOWHERE
    return root / "bt_dualarm"


def start_of_name(name: str) -> str:
    """The name of a file, cut so that 55 bytes can be added: file systems allow 255."""
    return os.fsencode(name)[:200].decode(errors="ignore")


def beside(path: Path, ending: str = "") -> Path:
    """A new hidden name in a path's folder, for a file or folder that will replace the path.

    The random part is needed: threads share a process id, and containers often have the same ids.

    Args:
        path: The path.
        ending: End of the name.
    """
    return path.with_name(f".{start_of_name(path.name)}.{os.getpid()}.{token_hex(4)}{ending}")


def kind_at(path: Path) -> Literal["file", "folder", "other", ""]:
    """What is at a path: links are followed; empty if there is nothing, or nothing can be there.

    `Path.is_file` and the like raise before Python 3.12 for names that are too long and in folders
    that one may not enter.
    """
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return ""
    return "file" if stat.S_ISREG(mode) else "folder" if stat.S_ISDIR(mode) else "other"


def refuse_special(path: Path) -> None:
    """Refuse a file to write that is a device, pipe or socket: a new file would take its place.

    Raises:
        OSError: It is one, or a link to one, such as ``/dev/stdout``.
    """
    if kind_at(path) == "other":
        raise OSError(errno.EINVAL, "it is not a regular file", str(path))


def write_atomically(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """Create or replace a file; a reader sees either the old or the complete new content.

    Args:
        path: File in a folder that exists.
        write: Writer of the content into the open file.

    Raises:
        OSError: The disk is full, the folder is not writable, or the path is a device; nothing is
            left behind.
    """
    refuse_special(path)
    half = beside(path)
    try:
        with half.open("xb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        half.replace(path)
    finally:
        half.unlink(missing_ok=True)


def leftovers(path: Path) -> list[Path]:
    """Temporary files of this path that processes left behind when they were killed."""
    name = re.compile(re.escape(f".{start_of_name(path.name)}.") + r"\d+\.[0-9a-f]{8}")
    return [file for file in path.parent.iterdir() if name.fullmatch(file.name)]


def write_text(path: Path, text: str) -> None:
    """Write text in UTF-8, as `write_atomically`."""
    write_atomically(path, lambda file: file.write(encodable(text).encode()))


LARGEST_INT: Final = 2**63 - 1
"""Largest integer that readers of a record accept."""


def encodable(text: str) -> str:
    r"""Returns text that UTF-8 can hold: lone surrogates are written out, as ``\udcff``.

    Python puts them into the name of a file that is not UTF-8; files and parsers refuse them.
    """
    return text.encode("utf-8", "backslashreplace").decode()


Given = ParamSpec("Given")


def weakly(method: Callable[Given, None]) -> Callable[Given, None]:
    """Returns a callback that does not keep the object of a bound method alive.

    Observers of a world refer to it. If the world referred back, this cycle would keep both, with
    all models and images, in memory until the next garbage collection, which comes late: a run has
    few but large objects.

    Args:
        method: Bound method; once its object is gone, the callback does nothing.
    """
    # Not `weakref.WeakMethod`: some of these callbacks are called in each physics step, and its
    # call costs more than all that they do.
    function: Callable[..., None] = method.__func__  # type: ignore[attr-defined]
    reference = ref(method.__self__)  # type: ignore[attr-defined]

    def call(*given: Given.args, **named: Given.kwargs) -> None:
        alive = reference()
        if alive is not None:
            function(alive, *given, **named)

    return call


_KERNEL_IMPORT: Final = re.compile(r"^from (bt_dualarm[.\w]*\.\w*kernel\w*) import", re.MULTILINE)


@cache
def code_folder() -> Path:
    """Folder of the machine code of all kernels, of any version of their sources."""
    return cache_dir() / "kernels"


@cache
def digest_of_kernels() -> str:
    """Digest of all kernel sources of the package."""
    return _digest(_PACKAGE.rglob("*kernel*.py"))


@cache
def digest_of_code(path: Path) -> str:
    """Digest of all sources that are compiled into a module's kernels.

    These are the module and all of the package's kernel modules that it imports, directly or not.
    """
    sources = {path}
    unread = [path]
    while unread:
        text = unread.pop().read_text(encoding="utf-8")
        for name in _KERNEL_IMPORT.findall(text):
            source = _PACKAGE.joinpath(*name.split(".")[1:]).with_suffix(".py")
            if source not in sources:
                sources.add(source)
                unread.append(source)
    return _digest(sources)


def _digest(sources: Iterable[Path]) -> str:
    # In the order of their texts: paths differ between installations, and names are not unique.
    whole = hashlib.sha256(b"".join(sorted(source.read_bytes() for source in sources)))
    return whole.hexdigest()[:16]
