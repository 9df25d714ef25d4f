"""Outcomes of arms and runs, from every mixture of outcomes of an arm's lives."""

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
    remaining = [life for life in lives if life is not Outcome.REMOVED]
    expected = Leniency().outcome_of(remaining) if remaining else Outcome.REMOVED
    assert Leniency(removable=True).outcome_of(lives) is expected


@given(st.lists(st.sampled_from(Outcome), max_size=6))
def test_a_run_succeeds_only_if_all_spawned_arms_did(arms: list[Outcome]) -> None:
    """An arm that was never spawned counts neither as a failure nor as a success."""
    good = set(arms) - {Outcome.NOT_SPAWNED} == {Outcome.SUCCESS}
    assert (combined(arms) is Outcome.SUCCESS) == good
    assert (combined(arms) is Outcome.FAILURE) == (Outcome.FAILURE in arms)
