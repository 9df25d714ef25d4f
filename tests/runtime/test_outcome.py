"""What lives come to, and arms: over every mixture of outcomes that a life can have."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from bt_dualarm.runtime.outcome import Leniency, Outcome, combined

LIFE = st.sampled_from((Outcome.SUCCESS, Outcome.FAILURE, Outcome.UNFINISHED, Outcome.REMOVED))
LIVES = st.lists(LIFE, min_size=1, max_size=6)


@given(LIVES)
def test_an_arm_succeeds_only_if_all_its_lives_did(lives: list[Outcome]) -> None:
    found = Leniency().outcome_of(lives)
    assert (found is Outcome.SUCCESS) == (set(lives) == {Outcome.SUCCESS})
    assert (found is Outcome.FAILURE) == (Outcome.FAILURE in lives)
    assert found in lives


@given(LIVES)
def test_a_file_can_let_the_last_life_count(lives: list[Outcome]) -> None:
    assert Leniency(last_life_counts=True).outcome_of(lives) is lives[-1]


@given(LIVES)
def test_a_file_can_forgive_removals_and_nothing_else(lives: list[Outcome]) -> None:
    left = [life for life in lives if life is not Outcome.REMOVED]
    wanted = Leniency().outcome_of(left) if left else Outcome.REMOVED
    assert Leniency(removable=True).outcome_of(lives) is wanted


@given(st.lists(st.sampled_from(Outcome), max_size=6))
def test_a_run_succeeds_only_if_an_arm_did_and_none_went_wrong(arms: list[Outcome]) -> None:
    """That an arm was never spawned is nobody's fault, and nobody's success."""
    good = set(arms) - {Outcome.NOT_SPAWNED} == {Outcome.SUCCESS}
    assert (combined(arms) is Outcome.SUCCESS) == good
    assert (combined(arms) is Outcome.FAILURE) == (Outcome.FAILURE in arms)
