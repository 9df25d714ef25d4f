"""Every failure that a skill declares does happen, is told, and leaves the arm standing."""

from __future__ import annotations

import pytest

from bt_dualarm.skill.registry import Registry
from tests.plays import STOPPED, Stage
from tests.skills.scenarios import Tree
from tests.skills.searches import give_up_soon
from tests.skills.trials import TRIALS, Trial

DECLARED = {
    (name, code) for name, skill in Registry.load().skills.items() for code in skill.failures
}

STANDS_RAD = 2e-3
"""Servo noise and the sag of the first moments, well below any motion."""


def test_every_declared_code_has_its_trial() -> None:
    assert TRIALS.keys() == DECLARED


@pytest.mark.parametrize(("skill", "code"), sorted(TRIALS), ids=str)
def test_failure_is_truthful(
    skill: str, code: str, stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The code, a sentence, and an arm that stands a second later; unmoved where so promised."""
    if code == "NO_PLAN" and skill != "reach_to_pose":
        give_up_soon(monkeypatch)
    trial: Trial = TRIALS[skill, code]
    file = trial.scenario(skill).file(
        {"force_success": {"child": trial.node}}, {"wait": {"seconds": 1.2}}
    )
    play = stage.run(file, deeds=trial.deeds)
    found = [(leaf.code, leaf.reason) for leaf in play.leaves(skill)]
    (leaf,) = [leaf for leaf in play.leaves(skill) if leaf.status == "FAILURE"]
    assert leaf.code == code, found
    assert len(leaf.reason.split()) > 3, "a sentence, not a word"
    assert leaf.ended_s is not None
    assert play.speed_after(leaf.ended_s + 1.0) < STOPPED
    if not trial.moves:
        assert play.ways["arm1"] < STANDS_RAD


@pytest.mark.parametrize(
    ("skill", "code"), sorted(key for key, trial in TRIALS.items() if not trial.moves), ids=str
)
def test_starts_again_after_failure(skill: str, code: str, stage: Stage) -> None:
    """Tried again it fails alike: nothing of the first time is left to trip over."""
    trial: Trial = TRIALS[skill, code]
    again: Tree = {"retry": {"times": 2, "child": trial.node}}
    play = stage.run(trial.scenario(skill).file(again), deeds=trial.deeds)
    failed = [leaf.code for leaf in play.leaves(skill) if leaf.status == "FAILURE"]
    assert failed == [code] * 2
    assert play.ways["arm1"] < STANDS_RAD
