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


def test_object_that_another_arm_has_moved_since(tmp_path: Path) -> None:
    [story] = stories(recorded(tmp_path, MOVED))
    cause = story.causes[0]
    assert cause.kind == "POSE_OUTDATED", cause
    assert "box was 255 mm from where arm1 assumed it" in cause.sentence
    assert "other held it meanwhile" in cause.sentence
    assert "locate" in cause.remedy
