"""Every declared failure of a skill occurs, is reported, and leaves the arm at rest."""

from __future__ import annotations

import pytest

from bt_dualarm.skill.registry import Registry
from tests.families import some
from tests.plays import STOPPED, Stage
from tests.skills.scenarios import Tree
from tests.skills.searches import give_up_soon
from tests.skills.trials import TRIALS, Trial

DECLARED = {
    (name, code) for name, skill in Registry.load().skills.items() for code in skill.failures
}

SLOW = ("carry_together", "hand_over", "insert", "operate", "regrasp", "take_over", "lissajous")
"""Skills whose trials take longer than those of others with the same code."""

CODES = sorted({code for _, code in TRIALS})
ORDERED = sorted(sorted(TRIALS, reverse=True), key=lambda trial: trial[0] in SLOW)
CASES = [
    (skill, code) for code in CODES for skill in some((n for n, one in ORDERED if one == code), 16)
]
"""Every code, for one in sixteen of the skills that declare it; for all in ``make matrix``."""

STILL_RAD = 2e-3
"""Limit above servo noise and the initial sag, well below any motion."""


def test_every_declared_code_has_a_trial() -> None:
    assert TRIALS.keys() == DECLARED


@pytest.mark.parametrize(("skill", "code"), CASES, ids=str)
def test_failure_is_truthful(
    skill: str, code: str, stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The leaf reports code and reason; the arm rests a second later, unmoved where promised.

    Where the arm must not move, a retry fails with the same code: the first failure leaves no
    state behind.
    """
    if code == "NO_PLAN" and skill != "reach_to_pose":
        give_up_soon(monkeypatch)
    trial: Trial = TRIALS[skill, code]
    times = 1 if trial.moves else 2
    again: Tree = {"retry": {"times": times, "child": trial.node}} if times > 1 else trial.node
    file = trial.scenario(skill).file(
        {"force_success": {"child": again}}, {"wait": {"seconds": 1.2}}
    )
    play = stage.run(file, interventions=trial.interventions)
    found = [(leaf.code, leaf.reason) for leaf in play.leaves(skill)]
    failed = [leaf for leaf in play.leaves(skill) if leaf.status == "FAILURE"]
    assert [leaf.code for leaf in failed] == [code] * times, found
    assert all(len(leaf.reason.split()) > 3 for leaf in failed), "a sentence, not a word"
    ended = failed[-1].ended_s
    assert ended is not None
    assert play.speed_after(ended + 1.0) < STOPPED
    if not trial.moves:
        assert play.joint_travel["arm1"] < STILL_RAD
