"""The search for circles of references is put off, and afterwards all is as it was."""

from __future__ import annotations

import gc
from collections.abc import Iterator

import pytest

from bt_dualarm.collector import imported, paused


@pytest.fixture(autouse=True)
def searching() -> Iterator[None]:
    """The collector as Python begins, whatever the tests before have made of it."""
    frozen, enabled, threshold = gc.get_freeze_count(), gc.isenabled(), gc.get_threshold()
    gc.unfreeze()
    gc.enable()
    gc.set_threshold(700, 10, 10)
    yield
    if frozen:
        gc.freeze()
    gc.set_threshold(*threshold)
    if not enabled:
        gc.disable()


def test_it_is_put_off_and_what_was_made_counts_as_old() -> None:
    """As old as after the collections that it was spared; nothing stays frozen."""
    with paused():
        assert not gc.isenabled()
        with paused():
            assert not gc.isenabled()
        assert not gc.isenabled()
        made: list[list[int]] = [[] for _ in range(1000)]
    assert gc.isenabled()
    assert gc.get_freeze_count() == 0
    old = {id(one) for one in gc.get_objects(generation=2)}
    assert {id(one) for one in made} <= old


def test_it_goes_on_after_an_error() -> None:
    with pytest.raises(ValueError, match="no matter"), paused():
        raise ValueError("no matter")
    assert gc.isenabled()


def test_circles_made_meanwhile_are_found_later() -> None:
    """They are put off, not lost."""

    class Circle:
        def __init__(self) -> None:
            self.me = self

    with paused():
        for _ in range(10):
            Circle()
    assert sum(isinstance(one, Circle) for one in gc.get_objects()) == 10
    gc.collect()
    assert not any(isinstance(one, Circle) for one in gc.get_objects())


def test_what_others_have_set_is_left_alone() -> None:
    """A collector that is off stays off; what is frozen stays frozen."""
    gc.disable()
    with paused():
        pass
    assert not gc.isenabled()
    gc.enable()
    gc.freeze()
    frozen = gc.get_freeze_count()
    with paused():
        assert gc.isenabled()
    assert gc.get_freeze_count() >= 0.9 * frozen > 0
    gc.unfreeze()


def test_what_is_imported_already_stirs_nothing() -> None:
    """New objects stay new where a name of the package is only looked up."""
    imported("bt_dualarm.pose")
    new: list[list[int]] = [[]]
    imported("bt_dualarm.pose")
    assert any(one is new for one in gc.get_objects(generation=0))
