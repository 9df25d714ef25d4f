"""Why a leaf missed an object: it is not where the arm assumed it."""

from __future__ import annotations

from pathlib import Path

from bt_dualarm.diagnosis.story import stories
from tests.replay.runs import recorded

MOVED = """
bt_dualarm: 1
name: moved
world: {scene: empty, time_limit: 30}
objects:
  cube: {shape: box, size: [0.05, 0.05, 0.05], mass: 0.1, pose: {xyz: [0.45, -0.3, 0.1253]}}
  stand: {shape: box, size: [0.1, 0.1, 0.1], mass: 1, fixed: true, pose: {xyz: [0.45, -0.3, 0.05]}}
  box: {shape: box, size: [0.12, 0.12, 0.1], mass: 0.5, pose: {xyz: [0.55, 0.15, 0.0501]}}
cell: {signals: {moved: {type: boolean, written_by: [other]}}}
arms:
  arm1:
    robot: ur5
    gripper: robotiq_2f85
    tree: {sequence: [{grasp: {object: cube}}, {await: moved}, {place: {at: {on: box}}}]}
  other:
    robot: ur5
    base: {xyz: [0.9, 0.6, 0], rpy: [0, 0, -120]}
    tree:
      sequence:
        - approach_and_attach: {object: box}
        - transport: {object: box, to: {xyz: [0.8, 0.2, 0.051]}}
        - detach: {object: box}
        - go_home
        - signal: moved
"""


BESIDE = """
bt_dualarm: 1
name: beside
world: {{scene: table, time_limit: 30}}
objects:
  bin: {{shape: bin, size: [0.14, 0.12, 0.06], wall: 0.01, mass: 1,
    pose: {{xyz: [0.45, -0.4, 0.43]}}{noise}}}
  bar: {{shape: box, size: [{long}, 0.03, 0.03], mass: 0.1, pose: {{xyz: [0.25, -0.45, 0.415]}}}}
arms:
  arm1:
    robot: z1
    gripper: panda_hand
    base: {{xyz: [0, -0.35, 0.4]}}
    tree: {{sequence: [{{grasp: {{object: bar}}}}, {{place: {{at: {{on: bin, rpy: [0, 0, 0]}}}}}}]}}
"""


def test_object_that_its_noise_displaces(tmp_path: Path) -> None:
    """That a cube would tip, or a wall was in the path, was all."""
    text = BESIDE.format(noise=", noise: {xyz: [0.05, 0.05, 0]}", long=0.11)
    [story] = stories(recorded(tmp_path, text))
    cause = story.causes[0]
    assert cause.kind == "POSE_OUTDATED", cause
    assert "from where arm1 assumed it" in cause.sentence
    assert cause.sentence.endswith("; its noise displaces it from its pose in the file")


def test_object_too_long_for_what_it_is_to_stand_in(tmp_path: Path) -> None:
    """It was advised to move the bin away."""
    [story] = stories(recorded(tmp_path, BESIDE.format(noise="", long=0.125)))
    cause = story.causes[0]
    assert cause.kind == "TOO_NARROW", cause
    assert cause.sentence == "bar, which arm1 holds, would touch bin"
    assert cause.remedy.startswith("another place relative to bin")


def test_object_that_another_arm_has_moved_since(tmp_path: Path) -> None:
    [story] = stories(recorded(tmp_path, MOVED))
    cause = story.causes[0]
    assert cause.kind == "POSE_OUTDATED", cause
    assert "box was 255 mm from where arm1 assumed it" in cause.sentence
    assert "other held it meanwhile" in cause.sentence
    assert "locate" in cause.remedy
