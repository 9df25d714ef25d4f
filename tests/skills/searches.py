"""Short path searches for tests in which no path exists and the search is not under test."""

from __future__ import annotations

from typing import Final

import pytest

from bt_dualarm.arm import motions, past_others

SOON_GIVEN_UP: Final = 20_000
"""Configurations that a search may check: a tenth of the default, which takes a tenth of the time.
One test of ``reach_to_pose`` uses the default (`test_failures`)."""


def give_up_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Limit every search of the test to `SOON_GIVEN_UP` configurations."""
    for module in (motions, past_others):
        monkeypatch.setattr(module, "CHECKS", SOON_GIVEN_UP)
