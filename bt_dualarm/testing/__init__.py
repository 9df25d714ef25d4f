"""For the tests of authors of skills: what every skill keeps to, whoever wrote it.

In: a `Candidate`, a skill with the `Scenario` in which its example does its job.
Out: silence, or a `BrokenLawError` that says which law the skill does not keep to, and how.
Open first: `laws` (what is kept to); others: `candidate` (plays the skill), `scenario` (its world).

The laws are run, with pytest or anything else, over a skill in a small world of its own::

    import pytest
    from bt_dualarm.testing import LAWS, Candidate, Scenario, registry_with

    from my_skills.nod import Nod

    @pytest.mark.parametrize("law", LAWS)
    def test_nod_keeps_to(law):
        LAWS[law](Candidate("nod", registry_with(Nod), Scenario()))
"""

from __future__ import annotations

from bt_dualarm.testing.candidate import Candidate as Candidate
from bt_dualarm.testing.candidate import registry_with as registry_with
from bt_dualarm.testing.laws import LAWS as LAWS
from bt_dualarm.testing.laws import BrokenLawError as BrokenLawError
from bt_dualarm.testing.scenario import Scenario as Scenario

__all__ = ["LAWS", "BrokenLawError", "Candidate", "Scenario", "registry_with"]
