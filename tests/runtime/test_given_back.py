"""A run that is over and forgotten is gone at once: Python's search for circles comes late."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Iterator
from pathlib import Path

import pytest

import bt_dualarm as bt
from bt_dualarm.perception.localization import Sighting

COMING_AND_GOING = """
bt_dualarm: 1
name: coming and going
world: {scene: empty, renderer: ray}
objects:
  cube: {shape: box, size: [0.05, 0.05, 0.05], mass: 0.1, color: red, fixed: false,
         pose: {xyz: [0.45, -0.40, 0.025]}}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 0, 0]}
    tree:
      sequence:
        - approach_and_attach: {object: cube}
        - retry: {times: 2, child: {reach_to_pose: {offset: {xyz: [0, 0, 0.1]}}}}
        - spawn: {arm: arm2}
        - wait: 0.2
        - remove: {arm: arm2}
        - reach_to_pose: {to: {xyz: [0.45, -0.40, -0.5]}}
  arm2:
    robot: panda
    base: {xyz: [3, 0, 0]}
    spawned: false
    removable: true
    camera: {mount: wrist}
    tree: {repeat: {times: forever, child: {circle: {plane: yz, radius: 0.05, speed: 0.3}}}}
"""


@pytest.fixture
def no_search() -> Iterator[None]:
    """While this lasts, only what nobody refers to any more is given back."""
    gc.collect()
    gc.disable()
    yield
    gc.enable()


@pytest.mark.parametrize("tree", [COMING_AND_GOING, "pick_and_track"])
def test_the_world_of_a_run_is_gone_with_the_run(no_search: None, tree: str) -> None:
    with bt.open(tree, duration=6.0, seed=1) as run:
        result = run.finish()
        world = weakref.ref(run.world)
        arms = weakref.ref(run.assembly.arms)
    assert run.arms["arm1"].outcome is result.arms["arm1"].outcome, "it can be looked at"
    del run
    assert (world(), arms()) == (None, None)
    assert result.arms["arm1"].runs, "what it came to stays"


def test_so_is_that_of_a_run_that_was_recorded(no_search: None, tmp_path: Path) -> None:
    """The second one: what the first imports keeps who asked for it, once in a process."""
    for name in ("first", "second"):
        with bt.open("circle", duration=0.2, record=tmp_path / name) as run:
            run.finish()
            world = weakref.ref(run.world)
            arms = weakref.ref(run.assembly.arms)
        del run
    assert (world(), arms()) == (None, None)


def test_what_a_run_has_seen_is_gone_with_it(no_search: None) -> None:
    """A tracker, its camera's callback and all sightings: nobody refers to them any more."""

    def sightings() -> int:
        return sum(isinstance(one, Sighting) for one in gc.get_objects())

    before = sightings()
    with bt.open("visual_tracking", duration=2.0, seed=1) as run:
        run.finish()
        assert sightings() > before, "it has seen something"
    del run
    assert sightings() == before


def test_so_is_that_of_a_run_that_was_never_begun(no_search: None) -> None:
    with bt.open("pick_and_track", seed=1) as run:
        world = weakref.ref(run.world)
    del run
    assert world() is None
