"""Meshes of robots as binary STL.

MuJoCo reads neither COLLADA nor ASCII STL. Whatever is not binary STL is converted once with the
``assimp`` program (of the package cmeel-assimp) and kept in the user's cache directory; where that
cannot be written, as long as the process lasts.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import resource
import subprocess
import sysconfig
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from bt_dualarm.errors import CatalogueError
from bt_dualarm.pose import Matrix
from bt_dualarm.share import cache_dir

_STL_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])
_STL_HEADER = 84

ASSIMP_SECONDS = 4.0
"""How long the conversion of one mesh may take; 29 MB of COLLADA take 0.4 s."""

_ASSIMP_MEMORY = 4 * 1024**3  # bytes
_ASSIMP_OUTPUT = 256 * 1024**2  # bytes
_UP_AXIS = re.compile(rb"<up_axis>\s*\w+\s*</up_axis>")


class MeshError(CatalogueError):
    """A mesh cannot be used.

    Args:
        path: File of the mesh.
        message: What is wrong with it.
        hint: What may be done.
    """

    def __init__(self, path: Path, message: str, hint: str = "") -> None:
        super().__init__(f"mesh {path} {message}; {hint}" if hint else f"mesh {path} {message}")
        self.message = message
        self.hint = hint


def stl_triangles(path: Path) -> Matrix:
    """Corners of the triangles of a binary STL, of shape (n, 3, 3)."""
    facets = np.frombuffer(path.read_bytes(), _STL_FACET, offset=_STL_HEADER)
    return facets["corners"].astype(float)


def as_stl(path: Path) -> Path:
    """The mesh as binary STL: the file itself, or its conversion in the cache.

    Raises:
        MeshError: The file is missing or cannot be converted.
    """
    if not path.is_file():
        raise MeshError(path, "does not exist")
    if path.suffix.lower() == ".stl" and _is_binary_stl(path):
        return path
    digest = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    name = f"{path.stem}-{digest}.stl"
    converted = cache_dir() / "meshes" / name
    try:
        _convert_once(path, converted)
    except OSError:  # nothing can be written there
        converted = Path(_scratch().name) / name
        _convert_once(path, converted)
    return converted


@cache
def _scratch() -> tempfile.TemporaryDirectory[str]:
    """Where meshes are converted that cannot be kept; gone with the process."""
    return tempfile.TemporaryDirectory(prefix="bt_dualarm-")


def _convert_once(source: Path, target: Path) -> None:
    if not (target.is_file() and _is_binary_stl(target)):
        _convert(source, target)


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
        complaint = _run_assimp("export", str(upright), str(raw), "-fstlb", "-ptv")
        if complaint or not raw.is_file():
            raise MeshError(source, complaint or "was converted to nothing by assimp")
        _write_true_count(raw)
        raw.replace(target)


def _write_true_count(path: Path) -> None:
    """Mend the header: assimp counts lines and points that it then leaves out."""
    count = (path.stat().st_size - _STL_HEADER) // _STL_FACET.itemsize
    with path.open("r+b") as file:
        file.seek(80)
        file.write(count.to_bytes(4, "little"))


def _run_assimp(*arguments: str) -> str:
    """Run it to its end, or to that of its time; returns what it complains of."""
    program = _assimp()
    # The program does not say where its own library lies: in the folder beside its own.
    environment = os.environ | {"LD_LIBRARY_PATH": str(program.parents[1] / "lib")}
    with subprocess.Popen(  # noqa: S603  # our own program and paths
        [program, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        stdin=subprocess.DEVNULL,
        env=environment,
    ) as process:
        _confine(process.pid)
        try:
            said, _ = process.communicate(timeout=ASSIMP_SECONDS)
        except subprocess.TimeoutExpired:
            return f"takes assimp longer than {ASSIMP_SECONDS:g} s"
        finally:
            process.kill()  # it has ended, or there is no use in waiting for its end
    if process.returncode == 0:
        return ""
    words = " ".join(said.decode(errors="replace").split()).rpartition("ERROR: ")[2]
    return f"cannot be read by assimp: {words[-200:]} (code {process.returncode})"


def _confine(pid: int) -> None:
    """Let a process take no more memory and write no larger a file than any sound mesh needs."""
    for limit, most in (
        (resource.RLIMIT_AS, _ASSIMP_MEMORY),
        (resource.RLIMIT_FSIZE, _ASSIMP_OUTPUT),
        (resource.RLIMIT_CORE, 0),
    ):
        with contextlib.suppress(ProcessLookupError):  # it has ended already
            resource.prlimit(pid, limit, (most, most))


def _assimp() -> Path:
    program = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix" / "bin" / "assimp"
    if not program.is_file():
        raise CatalogueError(f"the program assimp is missing ({program}); reinstall cmeel-assimp")
    return program
