"""Lease of an arm: at most one leaf holds it, whatever the order of requests."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_dualarm.arm.state import Lease
from bt_dualarm.core.errors import Failure


class Stage:
    """An arm whose rest the test controls, and two of its leaves, which have the same path."""

    def __init__(self) -> None:
        self.at_rest = False
        self.lease = Lease("arm1", lambda: self.at_rest)
        self.first, self.second = self.lease.for_leaf("root/a"), self.lease.for_leaf("root/a")


def test_other_leaf_is_refused_with_the_name_of_the_holder() -> None:
    """Leaves are distinguished by identity, not by path."""
    stage = Stage()
    stage.first.take()
    for refused in (stage.second.take, stage.second.refuse_if_busy):
        with pytest.raises(Failure, match="root/a is already moving arm1") as caught:
            refused()
        assert caught.value.code == "BUSY"
        assert caught.value.numbers == {"owner": "root/a"}
    assert stage.first.has_it
    assert not stage.second.has_it


def test_holder_may_take_the_lease_again() -> None:
    stage = Stage()
    for _ in range(3):
        stage.first.take()
        stage.first.refuse_if_busy()
    assert stage.first.give_back()
    assert not stage.first.has_it


def test_released_lease_is_free_while_the_arm_still_brakes() -> None:
    stage = Stage()
    stage.first.take()
    assert stage.first.give_back()
    stage.second.take()
    assert stage.second.has_it


def test_arm_at_rest_may_be_taken_over_and_its_previous_holder_stops_nothing() -> None:
    """A leaf that is halted or ends after another one began has no lease to give back."""
    stage = Stage()
    stage.first.take()
    stage.at_rest = True
    stage.second.take()
    stage.at_rest = False
    assert not stage.first.give_back()
    assert stage.second.has_it
    with pytest.raises(Failure, match="BUSY"):
        stage.first.take()


def test_giving_back_a_lease_that_is_not_held_is_harmless() -> None:
    stage = Stage()
    assert not stage.second.give_back()
    stage.first.take()
    assert not stage.second.give_back()
    assert stage.first.has_it


@given(
    st.lists(
        st.tuples(st.integers(0, 3), st.sampled_from(["take", "give_back", "rest", "move"])),
        max_size=40,
    )
)
def test_there_is_never_more_than_one_holder(actions: list[tuple[int, str]]) -> None:
    """The holder changes only while the arm rests or when the holder gives the lease back.

    The family: every sequence of up to 40 actions of four leaves and an arm that stops and moves.
    """
    at_rest = False
    holder = None
    lease = Lease("arm1", lambda: at_rest)
    leaves = [lease.for_leaf(f"leaf{number}") for number in range(4)]
    for number, action in actions:
        if action in ("rest", "move"):
            at_rest = action == "rest"
        elif action == "give_back":
            assert leaves[number].give_back() == (holder == number)
            holder = None if holder == number else holder
        elif holder in (None, number) or at_rest:
            leaves[number].take()
            holder = number
        else:
            with pytest.raises(Failure, match="BUSY"):
                leaves[number].take()
        assert [leaf.has_it for leaf in leaves] == [holder == n for n in range(4)]
