"""Where the meshes of a URDF lie: below the folder of its page, or in a package."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from bt_dualarm.world.urdf.link import MeshFinder

PACKAGE: Final = "package://"
FILE: Final = "file://"
SUFFIXES: Final = (".stl", ".obj", ".dae")
MAX_BYTES: Final = 64 * 1024 * 1024


def mesh_finder(urdf: Path, folder: Path, packages: Path) -> MeshFinder:
    """What finds the meshes that a URDF names.

    Args:
        urdf: File of the URDF.
        folder: Folder of the robot's page, below which meshes may lie.
        packages: Folder of installed packages, likewise.
    """

    def find(name: str) -> Path:
        base, rest = _base(name, urdf, packages)
        allowed = (base,) if name.startswith(PACKAGE) else (folder, packages)
        return _regular(name, _inside(name, base / rest, allowed))

    return find


def _base(name: str, urdf: Path, packages: Path) -> tuple[Path, str]:
    """The folder that a name begins at, and the rest of it."""
    if "\0" in name or not name.isprintable() or not name:
        raise ValueError(f"mesh {name[:80]!r} is no name of a file")
    if name.startswith(PACKAGE):
        package, _, rest = name.removeprefix(PACKAGE).lstrip("/").partition("/")
        return _package(package, urdf, packages), rest
    rest = name.removeprefix(FILE)
    if "://" in rest:
        raise ValueError(f"mesh {name!r} is not on this machine; {PACKAGE}, or a relative path")
    return urdf.parent, rest


def _package(package: str, urdf: Path, packages: Path) -> Path:
    """The folder of a package: one above the URDF, else an installed one."""
    for folder in (*urdf.parents, packages, *(packages / "robots").iterdir()):
        if folder.name == package:
            return folder
    raise ValueError(
        f"there is no folder {package!r} above the URDF, nor in the installed "
        "example-robot-data; put the URDF below a folder of that name, or write paths relative "
        "to the URDF"
    )


def _inside(name: str, path: Path, allowed: tuple[Path, ...]) -> Path:
    """The path without detours, if it stays in one of the folders."""
    try:
        path = path.resolve()
    except (OSError, RuntimeError) as error:  # a name too long, a loop of symlinks
        raise ValueError(f"mesh {name[:80]!r} is no name of a file") from error
    if not any(path.is_relative_to(folder.resolve()) for folder in allowed):
        raise ValueError(
            f"mesh {name!r} leads out of {allowed[0]}; meshes lie below the folder of the "
            "robot's page, or in the package that they name"
        )
    return path


def _regular(name: str, path: Path) -> Path:
    """The path, if a mesh of a kind and size that can be read is there."""
    try:
        size = path.stat().st_size if path.is_file() else -1
    except OSError:
        size = -1
    if size < 0:
        raise ValueError(f"mesh {name!r} does not exist; it would be {path}")
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f"mesh {name!r} cannot be read; one of {', '.join(SUFFIXES)}")
    if size > MAX_BYTES:
        raise ValueError(f"mesh {name!r} is larger than {MAX_BYTES // 1024**2} MiB")
    if size == 0:
        raise ValueError(f"mesh {name!r} is empty")
    return path
