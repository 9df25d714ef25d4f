"""Searches for a way that does not exist, where it is not the search that is tried."""

from __future__ import annotations

from typing import Final

import pytest

from bt_dualarm.arm import motions, past_others

SOON_GIVEN_UP: Final = 20_000
"""Configurations that a search may look at: a tenth, and of the seconds that it takes, too. One of
``reach_to_pose`` may look at all (`test_failures`)."""


def give_up_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every search of the test look at so many."""
    for module in (motions, past_others):
        monkeypatch.setattr(module, "CHECKS", SOON_GIVEN_UP)
