"""Conformance tests for authors of skills: the laws that every skill must keep.

Input: a `Candidate`, which is a skill with the `Scenario` in which its example succeeds.
Output: nothing, or a `BrokenLawError` that names the violated law and the violation.
Open first: `laws`, which has the laws, `Candidate` and `Scenario`.

Run the laws with pytest, or any other test runner, on a skill in a small world::

    import pytest
    from bt_dualarm.testing import LAWS, Candidate, Scenario, registry_with

    from my_skills.nod import Nod

    @pytest.mark.parametrize("law", LAWS)
    def test_nod_keeps_to(law):
        LAWS[law](Candidate("nod", registry_with(Nod), Scenario()))
"""

from __future__ import annotations

from bt_dualarm.testing.laws import LAWS as LAWS
from bt_dualarm.testing.laws import BrokenLawError as BrokenLawError
from bt_dualarm.testing.laws import Candidate as Candidate
from bt_dualarm.testing.laws import Scenario as Scenario
from bt_dualarm.testing.laws import registry_with as registry_with

__all__ = ["LAWS", "BrokenLawError", "Candidate", "Scenario", "registry_with"]
