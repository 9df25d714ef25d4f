"""`move_joints` turns all or some joints to or by angles, or is refused before any motion."""

from __future__ import annotations

import numpy as np
import pytest

from tests.plays import Stage, joints

WORLD = """
name: test
world: {scene: empty}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 0, 0.4]}
    tree: {move_joints: {PORTS, speed: 1.0}}
"""


@pytest.mark.parametrize(
    ("ports", "turned"),
    [
        ("by: [10, -5, 5, 0, 0, 30]", (10, -5, 5, 0, 0, 30)),
        ("by: {wrist_3_joint: -20, elbow_joint: 10}", (0, 0, 10, 0, 0, -20)),
    ],
)
def test_by_is_relative_to_the_current_angles(
    stage: Stage, ports: str, turned: tuple[float, ...]
) -> None:
    play = stage.play(WORLD.replace("PORTS", ports))
    start = joints(play.world)
    play.run()
    assert play.leaf("move_joints").status == "SUCCESS"
    assert joints(play.world) - start == pytest.approx(np.deg2rad(turned), abs=1e-3)


def test_to_is_absolute_and_keeps_other_joints(stage: Stage) -> None:
    play = stage.play(WORLD.replace("PORTS", "to: {wrist_3_joint: 12}"))
    start = joints(play.world)
    play.run()
    assert joints(play.world)[5] == pytest.approx(np.deg2rad(12), abs=1e-3)
    assert joints(play.world)[:5] == pytest.approx(start[:5], abs=1e-3)


@pytest.mark.parametrize(
    ("ports", "code", "word"),
    [
        ("to: [0, 0]", "INVALID_TARGET", "2 angles were given for 6 joints"),
        ("to: {elbow: 3}", "INVALID_TARGET", "elbow_joint"),
        ("to: {elbow_joint: 350}", "JOINT_LIMIT", "170.0° beyond its limit of 180.0°"),
        ("by: {shoulder_lift_joint: 120}", "IN_COLLISION", "floor"),
    ],
)
def test_invalid_target_is_refused_without_motion(
    stage: Stage, ports: str, code: str, word: str
) -> None:
    play = stage.run(WORLD.replace("PORTS", ports))
    leaf = play.leaf("move_joints")
    assert (leaf.status, leaf.code) == ("FAILURE", code)
    assert word in leaf.reason
    assert play.speed_after(0.0) < 0.02
