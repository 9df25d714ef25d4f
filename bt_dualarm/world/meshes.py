"""Meshes of robots as binary STL.

MuJoCo reads neither COLLADA nor ASCII STL. Whatever is not binary STL is converted once with the
``assimp`` program (of the package cmeel-assimp) and kept in the user's cache directory.
"""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import sysconfig
import tempfile
from pathlib import Path

import numpy as np

from bt_dualarm.errors import CatalogueError
from bt_dualarm.pose import Matrix

_STL_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])
_STL_HEADER = 84
_UP_AXIS = re.compile(rb"<up_axis>\s*\w+\s*</up_axis>")


def cache_dir() -> Path:
    """Where meshes and hulls are kept: ``$XDG_CACHE_HOME/bt_dualarm``, else ``~/.cache``."""
    root = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(root) / "bt_dualarm"


def stl_triangles(path: Path) -> Matrix:
    """Corners of the triangles of a binary STL, of shape (n, 3, 3)."""
    facets = np.frombuffer(path.read_bytes(), _STL_FACET, offset=_STL_HEADER)
    return facets["corners"].astype(float)


def as_stl(path: Path) -> Path:
    """The mesh as binary STL: the file itself, or its conversion in the cache.

    Raises:
        CatalogueError: The file is missing or cannot be converted.
    """
    if not path.is_file():
        raise CatalogueError(f"mesh {path} does not exist")
    if path.suffix.lower() == ".stl" and _is_binary_stl(path):
        return path
    digest = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    converted = cache_dir() / "meshes" / f"{path.stem}-{digest}.stl"
    if not (converted.is_file() and _is_binary_stl(converted)):
        _convert(path, converted)
    return converted


def _is_binary_stl(path: Path) -> bool:
    with path.open("rb") as file:
        header = file.read(_STL_HEADER)
    if len(header) < _STL_HEADER:
        return False
    count = int.from_bytes(header[80:], "little")
    return path.stat().st_size == _STL_HEADER + count * _STL_FACET.itemsize


def _convert(source: Path, target: Path) -> None:
    """Run assimp; the result appears under its name only when it is whole."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:
        upright = Path(folder) / source.name
        # A URDF takes vertices as they are; assimp turns models that declare z to be up.
        upright.write_bytes(_UP_AXIS.sub(rb"<up_axis>Y_UP</up_axis>", source.read_bytes()))
        raw = Path(folder) / target.name
        _run_assimp("export", str(upright), str(raw), "-fstlb", "-ptv")
        if not raw.is_file():
            raise CatalogueError(f"assimp converted {source} to nothing")
        _write_true_count(raw)
        raw.replace(target)


def _write_true_count(path: Path) -> None:
    """Mend the header: assimp counts lines and points that it then leaves out."""
    count = (path.stat().st_size - _STL_HEADER) // _STL_FACET.itemsize
    with path.open("r+b") as file:
        file.seek(80)
        file.write(count.to_bytes(4, "little"))


def _run_assimp(*arguments: str) -> None:
    program = _assimp()
    # The program does not say where its own library lies: in the folder beside its own.
    environment = os.environ | {"LD_LIBRARY_PATH": str(program.parents[1] / "lib")}
    result = subprocess.run(  # noqa: S603  # our own program and paths
        [program, *arguments], capture_output=True, text=True, check=False, env=environment
    )
    if result.returncode != 0:
        said = (result.stderr or result.stdout).strip()[-400:]
        raise CatalogueError(f"assimp {' '.join(arguments)}: {said}")


def _assimp() -> Path:
    program = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix" / "bin" / "assimp"
    if not program.is_file():
        raise CatalogueError(f"the program assimp is missing ({program}); reinstall cmeel-assimp")
    return program
