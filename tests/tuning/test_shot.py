"""Images from cameras of tree files."""

from __future__ import annotations

import pytest

from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.runtime.options import find_tree
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.values import Color
from bt_dualarm.tuning import ColorView, ShotError, ShotTime, camera_arm, camera_shot

TREE = """\
bt_dualarm: 1
world: {scene: empty, renderer: ray}
objects:
  cube: {shape: box, size: [0.05, 0.05, 0.05], mass: 0.1, color: yellow, fixed: true,
    pose: {xyz: [0.9, 0, 0.45]}}
arms:
  arm1:
    robot: panda
    posture: look_out
    camera: {mount: wrist, noise: 5, drop: 0.9, latency: 1}
    tree: {sequence: [{wait: 0.2}, {move_joints: {to: [0, -30, 0, -130, 0, 100, 45]}}]}
  arm2:
    robot: ur5
    base: {xyz: [0, 1.5, 0]}
    spawned: false
    camera: {mount: wrist}
    tree: {sequence: [wait: 0.1]}
"""


@pytest.fixture(scope="module")
def registry() -> Registry:
    return Registry.load()


@pytest.fixture(scope="module")
def file(registry: Registry, tmp_path_factory: pytest.TempPathFactory) -> TreeFile:
    path = tmp_path_factory.mktemp("shot") / "tree.yaml"
    path.write_text(TREE, encoding="utf-8")
    return load_tree_file(path, registry.kinds)


def test_shot_shows_its_time_without_camera_errors(file: TreeFile, registry: Registry) -> None:
    """While the arm rests, images are equal; later the arm has moved."""
    first = camera_shot(file, registry, "arm1", ShotTime())
    later = camera_shot(file, registry, "arm1", ShotTime(0.1))
    last = camera_shot(file, registry, "arm1", ShotTime(0.7))
    assert [shot.frame.stamp for shot in (first, later)] == pytest.approx([0.0, 0.1])
    assert "arm1 at 0.100 s, renderer ray" in later.what
    seen = [ColorView(shot.frame, Color.named("yellow")).found for shot in (first, later, last)]
    assert seen[0][0].centroid_px == pytest.approx(seen[1][0].centroid_px, abs=0.3)
    assert abs(seen[2][0].centroid_px[1] - seen[0][0].centroid_px[1]) > 3


def test_posture_sets_the_start_of_the_arm(file: TreeFile, registry: Registry) -> None:
    poses = [
        camera_shot(file, registry, "arm1", ShotTime(posture=posture)).frame.pose
        for posture in (None, "look_out", "home")
    ]
    assert poses[0].distance(poses[1]) == 0.0
    assert poses[0].distance(poses[2]) > 0.1


def test_shot_reports_an_earlier_end_of_the_run(file: TreeFile, registry: Registry) -> None:
    shot = camera_shot(file, registry, "arm1", ShotTime(60.0))
    assert "where the run ended" in shot.what
    assert shot.frame.stamp < 20


def test_absent_arm_has_no_shot(file: TreeFile, registry: Registry) -> None:
    for seconds in (0.0, 0.05):
        with pytest.raises(ShotError, match="arm2 is not in the world at"):
            camera_shot(file, registry, "arm2", ShotTime(seconds))


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (None, r"several arms have one \(arm1, arm2\); give --arm NAME"),
        ("arm3", "there is no arm 'arm3': did you mean"),
    ],
)
def test_camera_must_be_unambiguous(name: str | None, message: str, file: TreeFile) -> None:
    assert camera_arm(file, "arm1") == "arm1"
    with pytest.raises(ShotError, match=message):
        camera_arm(file, name)


def test_tree_without_a_camera_is_an_error(registry: Registry) -> None:
    with pytest.raises(ShotError, match="which camera\\? no arm has one"):
        camera_arm(load_tree_file(find_tree("circle"), registry.kinds), None)
