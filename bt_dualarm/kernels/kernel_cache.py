"""Where numba keeps the machine code of our kernels."""

from __future__ import annotations

from numba.core.caching import UserWideCacheLocator

from bt_dualarm.kernels.kernel import folder


class KernelCache(UserWideCacheLocator):
    """One folder for every installation of the same sources.

    Numba's own locators add the place of the file, so that each installation compiles anew.
    """

    def get_cache_path(self) -> str:
        """The folder of these sources."""
        return str(folder())

    def get_source_stamp(self) -> str:
        """Stands for the sources of all kernels, not of this file alone."""
        return folder().name
