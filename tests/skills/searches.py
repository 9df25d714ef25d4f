"""Searches for a way that does not exist, where it is not the search that is tried."""

from __future__ import annotations

from functools import partial
from typing import Final

import pytest

from bt_dualarm.arm import arm
from bt_dualarm.planning.problem import PlanningProblem

SOON_GIVEN_UP: Final = 20_000
"""Configurations that a search may look at: a tenth, and of the seconds that it takes, too. One of
``reach_to_pose`` may look at all (`test_failures`)."""


def give_up_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every search of the test look at so many."""
    soon = partial(PlanningProblem, checks=SOON_GIVEN_UP)
    monkeypatch.setattr(arm, "PlanningProblem", soon)
