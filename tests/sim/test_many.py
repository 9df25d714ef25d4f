"""Many objects from one entry: names, positions, sizes and colors, and the effect of the seed."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

import bt_dualarm as bt
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.replay.record import Record
from bt_dualarm.replay.rerun import check_record
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import TreeFile


def file_of(tree: str = "", **objects: str) -> str:
    lines = "\n".join(f"  {name}: {text}" for name, text in objects.items())
    return f"""
bt_dualarm: 1
name: many
params: {{n: {{type: integer, default: 3}}}}
world: {{scene: empty}}
objects:
{lines}
arms:
  arm1: {{robot: ur5, base: {{xyz: [0, 0, 0]}}, tree: {{sequence: [{tree or "stop"}]}}}}
"""


def loaded(**objects: str) -> TreeFile:
    return load_tree_file(file_of(**objects))


CUBE = "shape: box, size: [0.04, 0.04, 0.04], mass: 0.1, pose: {xyz: [0.8, 0, 0.02]}"


def positions(world: World) -> np.ndarray:
    return np.array([world.object_pose(name).position for name in world.objects])


def test_grid_is_centered_at_its_pose_with_x_first() -> None:
    world = World(loaded(cube=f"{{{CUBE}, many: {{grid: [3, 2], spacing: [0.1, 0.2]}}}}"))
    assert [*world.objects] == [f"cube{i}" for i in range(1, 7)]
    expected = [(0.8 + dx, dy, 0.02) for dy in (-0.1, 0.1) for dx in (-0.1, 0.0, 0.1)]
    assert positions(world) == pytest.approx(np.array(expected))


def test_grid_without_spacing_keeps_the_gap() -> None:
    world = World(loaded(cube=f"{{{CUBE}, many: {{grid: [2], gap: 0.03}}}}"))
    assert np.diff(positions(world)[:, 0]) == pytest.approx(0.07)


def test_stack_is_stable() -> None:
    world = World(
        loaded(
            cube=f"{{{CUBE}, many: {{stack: 4, sizes: [[0.04, 0.04, 0.02], [0.05, 0.05, 0.05]]}}}}"
        )
    )
    assert next(world.overlaps(), None) is None
    before = positions(world)
    for _ in range(500):
        world.step()
    assert positions(world) == pytest.approx(before, abs=2e-3)
    heights = [world.objects[f"cube{i}"].size[2] for i in range(1, 5)]
    assert before[3, 2] - before[0, 2] == pytest.approx(
        sum(heights) - 0.5 * (heights[0] + heights[3]), abs=1e-3
    )


SCATTERED = f"{{{CUBE}, many: {{scatter: 12, area: [0.5, 0.4], gap: 0.02, colors: [red, blue]}}}}"


@pytest.mark.parametrize("seed", range(3))
def test_scattered_objects_keep_their_gap_within_the_area(seed: int) -> None:
    world = World(loaded(cube=SCATTERED), seed)
    found = positions(world)
    assert (np.abs(found[:, :2] - (0.8, 0.0)) <= (0.25 - 0.02, 0.2 - 0.02)).all()
    geoms = [world.object_geom(name) for name in world.objects]
    gaps = [
        mujoco.mj_geomDistance(world.model, world.data, one, other, 1.0, None)
        for i, one in enumerate(geoms)
        for other in geoms[i + 1 :]
    ]
    assert min(gaps) >= 0.02 - 1e-6
    assert {world.objects[name].color for name in world.objects} == {"red", "blue"}


def test_positions_depend_only_on_seed_and_entry() -> None:
    file = loaded(cube=SCATTERED)
    first = positions(World(file, 1))
    assert positions(World(file, 1)) == pytest.approx(first, abs=0.0)
    assert np.abs(positions(World(file, 2)) - first).max() > 0.05
    more = loaded(
        cube=SCATTERED, ball="{shape: sphere, size: [0.02], mass: 1, pose: {xyz: [2, 2, 1]}}"
    )
    assert positions(World(more, 1))[:12] == pytest.approx(first, abs=0.0)


def test_scattered_objects_avoid_other_objects() -> None:
    """They overlap neither a wall in the middle of the area nor a tray below."""
    fixed = "mass: 1, fixed: true"
    wall = f"{{shape: box, size: [0.02, 0.4, 0.3], {fixed}, pose: {{xyz: [0.8, 0, 0.15]}}}}"
    tray = f"{{shape: tray, size: [0.5, 0.4, 0.01], {fixed}, pose: {{xyz: [0.8, 0, 0.005]}}}}"
    cube = SCATTERED.replace("[0.8, 0, 0.02]", "[0.8, 0, 0.0231]")
    cube = cube.replace("0.5, 0.4", "0.48, 0.38")
    world = World(loaded(cube=cube, wall=wall, tray=tray))
    assert next(world.overlaps(), None) is None
    found = [world.object_pose(f"cube{i}").position[0] for i in range(1, 13)]
    assert np.abs(np.array(found) - 0.8).min() > 0.03 + 0.02 - 1e-3


def test_pile_comes_to_rest_in_a_bin() -> None:
    bin_ = (
        "{shape: bin, size: [0.3, 0.3, 0.15], mass: 1, fixed: true, pose: {xyz: [0.8, 0, 0.075]}}"
    )
    cube = f"{{{CUBE.replace('0.02]}', '0.05]}')}, many: {{pile: 10, area: [0.12, 0.12]}}}}"
    world = World(loaded(bin=bin_, cube=cube), 4)
    assert next(world.overlaps(), None) is None
    for _ in range(1000):
        world.step()
    found = np.array([world.object_pose(f"cube{i}").position for i in range(1, 11)])
    assert (np.abs(found[:, :2] - (0.8, 0.0)) < 0.15).all()
    assert (found[:, 2] > 0.02).all()


def test_count_may_be_a_parameter() -> None:
    text = file_of(
        "{spawn: {object: cube2}}", cube=f"{{{CUBE}, spawned: false, many: {{grid: ['{{n}}']}}}}"
    )
    assert not [one for one in bt.check(text) if one.severity == "error"]
    found = bt.check(text, params={"n": 1})
    assert [one.message for one in found] == ["spawn: there is no object 'cube2'"]


@pytest.mark.usefixtures("without_plots")
def test_sampled_objects_are_recorded_and_repeatable(tmp_path: Any) -> None:
    text = file_of("{wait: 0.2}", cube=SCATTERED)
    runs = [bt.run(text, seed=5, record=tmp_path / f"{i}") for i in range(2)]
    assert runs[0].outcome == "SUCCESS"
    assert check_record(Record.read(tmp_path / "0"), Registry.load()).agrees
    records = [Record.read(tmp_path / f"{i}") for i in range(2)]
    objects = [record.start["objects"] for record in records]
    assert objects[0] == objects[1]
    assert {one["color"] for one in objects[0].values()} == {"red", "blue"}


def test_lack_of_room_is_an_error_of_the_entry() -> None:
    (problem,) = bt.check(file_of(cube=SCATTERED.replace("[0.5, 0.4]", "[0.1, 0.1]")))
    assert problem.place.line == 7
    assert "of 12 objects found room in 0.1 m by 0.1 m" in problem.message
