"""Where machine code is kept: a folder named after the sources of all kernels."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path
from typing import Final

from bt_dualarm.share import cache_dir

_PACKAGE: Final = Path(__file__).resolve().parent.parent


@cache
def folder() -> Path:
    """Where the machine code of these sources is kept."""
    sources = sorted(_PACKAGE.rglob("*kernel*.py"))
    digest = hashlib.sha256(b"".join(source.read_bytes() for source in sources))
    return cache_dir() / "kernels" / digest.hexdigest()[:16]
