"""A folder with a kernel."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.kernels.doubling import DOUBLE


@pytest.fixture
def scripts(tmp_path: Path) -> Path:
    """A folder with a module of one kernel."""
    place = tmp_path / "scripts"
    place.mkdir()
    (place / "double_kernels.py").write_text(DOUBLE)
    return place
