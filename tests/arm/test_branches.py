"""The choice of a branch: the first possible one, and the first refusal if there is none."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from bt_dualarm.arm.branches import MOST_BRANCHES, first_possible
from bt_dualarm.core.errors import Failure


def attempt(number: int) -> str:
    if number % 5:
        raise Failure("IN_COLLISION", f"branch {number}")
    return f"plan {number}"


def computed(numbers: range, requested: list[int]) -> Iterator[int]:
    for number in numbers:
        requested.append(number)
        yield number


@pytest.mark.parametrize(("per_tick", "ticks"), [(1, 4), (2, 2), (3, 1)])
def test_first_possible_branch_is_taken_and_no_later_one_computed(
    per_tick: int, ticks: int
) -> None:
    requested: list[int] = []
    search = first_possible(computed(range(1, 100), requested), attempt, per_tick=per_tick)
    for _ in range(ticks):
        next(search)
    with pytest.raises(StopIteration) as end:
        next(search)
    assert end.value.value == "plan 5"
    assert requested == [1, 2, 3, 4, 5]


@pytest.mark.parametrize("most", [1, 3])
def test_the_refusal_is_that_of_the_preferred_branch(most: int) -> None:
    requested: list[int] = []
    with pytest.raises(Failure, match="branch 1") as refused:
        list(first_possible(computed(range(1, 100), requested), attempt, most=most))
    assert requested == [*range(1, most + 1)]
    assert refused.value.code == "IN_COLLISION"


def test_number_of_attempted_branches_is_limited() -> None:
    requested: list[int] = []
    with pytest.raises(Failure, match="branch 1"):
        list(first_possible(computed(range(1, 1000, 5), requested), attempt))
    assert len(requested) == MOST_BRANCHES


def test_empty_list_of_branches_is_an_error() -> None:
    with pytest.raises(ValueError, match="no branches"):
        list(first_possible([], attempt))
