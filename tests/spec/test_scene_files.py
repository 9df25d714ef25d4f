"""Scene files: fixtures that are objects of the tree, mounts, and every reason to refuse one."""

from __future__ import annotations

from pathlib import Path

import pytest

import bt_dualarm as bt
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.replay.record import Record
from bt_dualarm.replay.rerun import check_record
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry

SCENE = """
bt_dualarm_scene: 1
description: a bench before a wall, with a shelf on it
fixtures:
  bench: {shape: table, size: [0.8, 0.6, 0.4], pose: {xyz: [0.4, -0.5, 0.2]}, color: white}
  wall: {shape: box, size: [2, 0.1, 1.5], pose: {xyz: [0.4, -1.2, 0.75]}}
  rack: {shape: shelf, size: [0.3, 0.2, 0.4], pose: {xyz: [0.65, -0.66, 0.601], rpy: [0, 0, 180]}}
  post:
    shape: cylinder
    size: [0.02, 0.5]
    pose: {xyz: [-0.5, 0, 0.25]}
    many: {grid: [2], spacing: [0.3]}
cameras:
  overhead: {xyz: [0.4, -0.5, 1.4], rpy: [180, 0, 0]}
"""

TREE = """
bt_dualarm: 1
name: cell
world: {scene: scenes/cell.yaml, reality: lab, time_limit: 60}
objects:
  cube: {shape: box, size: [0.04, 0.04, 0.04], mass: 0.1, pose: {xyz: [0.3, -0.4, 0.42]}}
arms:
  arm1:
    robot: ur5
    gripper: robotiq_2f85
    base: {xyz: [0, 0, 0.4]}
    camera: {mount: overhead, resolution: [64, 48]}
    tree: {sequence: [{grasp: {object: cube}}, {place: {at: {xyz: [0.2, -0.5, 0.42]}}}]}
goal:
  on_the_bench: {object: cube, on: bench}
"""


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes" / "cell.yaml").write_text(SCENE, encoding="utf-8")
    path = tmp_path / "cell.yaml"
    path.write_text(TREE, encoding="utf-8")
    return path


def test_fixtures_are_fixed_objects_and_mounts_are_poses(cell: Path) -> None:
    file = load_tree_file(cell)
    assert [*file.objects] == ["bench", "wall", "rack", "post1", "post2", "cube"]
    assert [name for name, obj in file.objects.items() if not obj.fixed] == ["cube"]
    world = World(file)
    assert next(world.overlaps(), None) is None
    assert world.arms["arm1"].camera_id >= 0
    assert len(world.object_geoms("bench")) == 5
    assert len(world.object_geoms("rack")) == 6
    lower, upper = world.object_pose("post1"), world.object_pose("post2")
    assert upper.position[0] - lower.position[0] == pytest.approx(0.3)


@pytest.mark.usefixtures("without_plots")
def test_a_run_in_the_cell_succeeds_and_can_be_replayed_without_the_scene(cell: Path) -> None:
    """The goal names a fixture, and the record contains the text of the scene."""
    result = bt.run(cell, record=cell.parent / "out")
    assert result.outcome == "SUCCESS", result
    (cell.parent / "scenes" / "cell.yaml").unlink()
    assert check_record(Record.read(cell.parent / "out"), Registry.load()).agrees


def test_suggestions_include_names_of_the_scene(cell: Path) -> None:
    cell.write_text(TREE.replace("on: bench", "on: bensh"), encoding="utf-8")
    messages = [str(problem) for problem in bt.check(cell)]
    assert any("bensh" in message and "bench" in message for message in messages), messages


@pytest.mark.parametrize(
    ("old", "new", "message", "line"),
    [
        ("shape: table", "shape: tabel", "not text 'tabel'", 5),
        ("[0.8, 0.6, 0.4]", "[0.8, 0.6]", "the size of a table is [x, y, z]", 5),
        ("wall:", "the wall:", "cannot be a name", 6),
        ("shape: shelf", "shape: shelf, boards: 1", "boards: must be at least 2", 7),
        ("fixtures:", "fixture:", "unknown field 'fixture'", 4),
        ("rpy: [180, 0, 0]", "rpy: [180, 0]", "rpy", 14),
        ("bt_dualarm_scene: 1", "bt_dualarm: 1", "is not a scene", 0),
        ("description:", "description: !!python/name:os.system", "tag", 3),
    ],
)
def test_errors_of_a_scene_have_its_lines(
    cell: Path, old: str, new: str, message: str, line: int
) -> None:
    scene = cell.parent / "scenes" / "cell.yaml"
    scene.write_text(SCENE.replace(old, new), encoding="utf-8")
    problems = [one for one in bt.check(cell) if message in one.message]
    assert problems, bt.check(cell)
    assert all(Path(one.place.file) == scene for one in problems)
    assert not line or line in {one.place.line for one in problems}


@pytest.mark.parametrize("scene", ["boards: 1", "fov: 3"])
def test_mounts_of_a_scene_with_errors_are_not_called_unknown(cell: Path, scene: str) -> None:
    broken = SCENE.replace("shape: shelf", f"shape: shelf, {scene}")
    (cell.parent / "scenes" / "cell.yaml").write_text(broken, encoding="utf-8")
    messages = [problem.message for problem in bt.check(cell)]
    assert len(messages) == 1, messages
    assert "overhead" not in messages[0]


def test_an_error_elsewhere_in_the_tree_file_leaves_the_scene_known(cell: Path) -> None:
    """Its mounts exist all the same, and an error of a fixture is at the fixture's line."""
    scene = cell.parent / "scenes" / "cell.yaml"
    mesh = "shape: mesh, file: wall.stl"
    scene.write_text(SCENE.replace("shape: box, size: [2, 0.1, 1.5]", mesh), encoding="utf-8")
    cell.write_text(TREE.replace("on: bench", "on: [bench]"), encoding="utf-8")
    fixture, goal = sorted(bt.check(cell), key=lambda one: one.message)
    assert "wall.stl" in fixture.message
    assert (Path(fixture.place.file), fixture.place.line) == (scene, 6)
    assert Path(goal.place.file) == cell
    assert "on: expected" in goal.message


def test_an_object_within_a_fixture_is_an_error(cell: Path) -> None:
    cell.write_text(TREE.replace("[0.3, -0.4, 0.42]", "[0.4, -1.2, 0.42]"), encoding="utf-8")
    (problem,) = [one for one in bt.check(cell) if one.severity == "error"]
    assert {"cube", "wall"} <= set(problem.message.replace("'", " ").split())


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("scenes/nothing.yaml", "no such file"),
        ("../cell.yaml", "is outside the folder"),
        ("/etc/cell.yaml", "is outside the folder"),
        ("scenes/link.yaml", "is outside the folder"),
        ("scenes/loop.yaml", "cannot be resolved"),
        ("scenes/big.yaml", "is larger than"),
    ],
)
def test_unsafe_scene_files_are_refused(cell: Path, path: str, message: str) -> None:
    scenes = cell.parent / "scenes"
    outside = cell.parent.parent / f"{cell.parent.name}_outside.yaml"
    outside.write_text(SCENE, encoding="utf-8")
    (scenes / "link.yaml").symlink_to(outside)
    (scenes / "loop.yaml").symlink_to(scenes / "loop.yaml")
    (scenes / "big.yaml").write_text(SCENE + "#" * 300_000, encoding="utf-8")
    cell.write_text(TREE.replace("scenes/cell.yaml", path), encoding="utf-8")
    assert any(message in problem.message for problem in bt.check(cell)), bt.check(cell)


def test_a_name_of_a_fixture_is_taken(cell: Path) -> None:
    cell.write_text(TREE.replace("  cube:", "  wall:").replace("cube", "wall"), encoding="utf-8")
    messages = [problem.message for problem in bt.check(cell)]
    assert "'wall' is already the name of a fixture of the scene" in messages
