"""Memory of a run is released with its last reference, before Python's search for cycles."""

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
def no_cycle_search() -> Iterator[None]:
    """Disable the search for reference cycles: only reference counts release memory."""
    gc.collect()
    gc.disable()
    yield
    gc.enable()


@pytest.mark.parametrize("tree", [COMING_AND_GOING, "pick_and_track"])
def test_the_world_of_a_run_is_released_with_the_run(no_cycle_search: None, tree: str) -> None:
    with bt.open(tree, duration=6.0, seed=1) as run:
        result = run.finish()
        world = weakref.ref(run.world)
        arms = weakref.ref(run.assembly.arms)
    assert run.arms["arm1"].outcome is result.arms["arm1"].outcome, "it can still be read"
    del run
    assert (world(), arms()) == (None, None)
    assert result.arms["arm1"].runs, "the result stays"


def test_the_world_of_a_recorded_run_is_released_with_the_run(
    no_cycle_search: None, tmp_path: Path
) -> None:
    """This is tested for a second run: modules that the first imports keep their importer alive."""
    for name in ("first", "second"):
        with bt.open("circle", duration=0.2, record=tmp_path / name) as run:
            run.finish()
            world = weakref.ref(run.world)
            arms = weakref.ref(run.assembly.arms)
        del run
    assert (world(), arms()) == (None, None)


def test_sightings_of_a_run_are_released_with_it(no_cycle_search: None) -> None:
    """Nothing refers to the tracker, its camera's callback, and the sightings anymore."""

    def sightings() -> int:
        return sum(isinstance(one, Sighting) for one in gc.get_objects())

    before = sightings()
    with bt.open("visual_tracking", duration=2.0, seed=1) as run:
        run.finish()
        assert sightings() > before, "it has seen something"
    del run
    assert sightings() == before


def test_the_world_of_a_run_that_never_began_is_released(no_cycle_search: None) -> None:
    with bt.open("pick_and_track", seed=1) as run:
        world = weakref.ref(run.world)
    del run
    assert world() is None
