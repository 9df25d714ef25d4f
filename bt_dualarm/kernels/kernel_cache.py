"""Where numba keeps the machine code of our kernels, and by what it finds it again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba.core.caching import FunctionCache, UserWideCacheLocator

from bt_dualarm.kernels.kernel_files import KernelFiles
from bt_dualarm.kernels.kernel_folder import folder


class KernelPlace(UserWideCacheLocator):
    """One folder for every installation of the same sources.

    Numba's own locators add the place of the file, so that each installation compiles anew, and
    make nothing of a folder that has the code but cannot be written.
    """

    def get_cache_path(self) -> str:
        """The folder of these sources."""
        return str(folder())

    def get_source_stamp(self) -> str:
        """Stands for the sources of all kernels, not of this file alone."""
        return folder().name

    def ensure_cache_path(self) -> None:
        """Make the folder; one that is there can be read, at least.

        Raises:
            OSError: There is none, and none can be made.
        """
        folder().mkdir(parents=True, exist_ok=True)


class KernelCache(FunctionCache):
    """The machine code of one kernel, for each signature.

    Numba's own asks for the same byte code, too, which is another without docstrings (``-OO``):
    all would be compiled twice. Here the sources are known by the folder.
    """

    def __init__(self, function: Callable[..., object]) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]  # numba has no types
        files: Any = KernelFiles(Path(self.cache_path), self._impl.filename_base)
        self._cache_file = files  # numba's own are two for each signature

    def _index_key(
        self,
        sig: object,
        codegen: Any,  # numba has no types
    ) -> tuple[object, ...]:
        return sig, codegen.magic_tuple()


def keep_code(
    compiled: Any,  # numba has no types
    function: Callable[..., object],
) -> None:
    """Have a compiled function take its code from the folder, and leave it there.

    Raises:
        RuntimeError: There is no such folder, and none can be made.
    """
    compiled._cache = KernelCache(function)
