"""Conformance tests for authors of skills: the laws that every skill must keep.

In: a `Candidate`, a skill with the `Scenario` in which its example does its job.
Out: nothing, or a `BrokenLawError` that says which law the skill breaks, and how.
Open first: `laws`, which has the laws, the `Candidate` and the `Scenario`.

The laws are run, with pytest or anything else, over a skill in a small world of its own::

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
