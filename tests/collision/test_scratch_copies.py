"""Scratch copies of a world's model are reused, and each user finds them like new."""

from __future__ import annotations

import gc
import weakref

import numpy as np

from bt_dualarm.collision.checker import CollisionChecker, ScratchModel
from tests.collision.cluttered import anywhere, cluttered


def test_later_checker_reuses_the_copy_and_finds_the_same_contacts() -> None:
    world = cluttered("ur5", 0)
    rng = np.random.default_rng(5)
    limits = world.robots["arm1"].limits
    places = [anywhere(limits, rng) for _ in range(40)]
    first = CollisionChecker(world, "arm1", 0.045)
    model = first.model
    expected = [first.contact(q) for q in places]
    assert any(expected)
    assert not all(expected)
    del first
    other = CollisionChecker(world, "arm2", 0.1, frozenset(world.objects))  # changes the copy
    assert other.model is model
    other.free(other.present)
    del other
    again = CollisionChecker(world, "arm1", 0.045)
    assert again.model is model
    assert [again.contact(q) for q in places] == expected


def test_two_users_at_a_time_do_not_share_a_copy() -> None:
    world = cluttered("ur5", 0)
    one = ScratchModel(world)
    other = ScratchModel(world)
    assert one.model is not other.model
    assert one.data is not other.data
    one.report_gaps(one.solid, 0.5)
    assert (other.model.geom_margin == world.model.geom_margin).all()


def test_recompiled_world_has_new_copies() -> None:
    world = cluttered("ur5", 0)
    before = ScratchModel(world).model
    world.remove_object("ball")
    after = ScratchModel(world).model
    assert after is not before
    assert after.ngeom == world.model.ngeom < before.ngeom


def test_copies_do_not_keep_their_world_alive() -> None:
    world = cluttered("ur5", 0)
    ScratchModel(world)
    gone = weakref.ref(world)
    del world
    gc.collect()
    assert gone() is None
