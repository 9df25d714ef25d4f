"""Conditions that use the wrist camera, in a run."""

from __future__ import annotations

import bt_dualarm as bt
from tests.no_plots import no_plots

TREE = """
bt_dualarm: 1
world: {scene: table}
objects:
  cube:
    shape: box
    size: [0.05, 0.05, 0.05]
    color: yellow
    mass: 0.1
    pose: {xyz: [0.4, -0.4, 0.425]}
  ball: {shape: sphere, size: [0.03], color: red, mass: 0.1, pose: {xyz: [-0.4, 0.4, 0.43]}}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 0, 0.40]}
    camera: {}
    tree:
      sequence:
        - not: {sees: {object: ball}}
        - look_at: {at: {xyz: [0.4, -0.4, 0.42]}, distance: 0.4}
        - all: [{sees: {object: cube}}, {not: {sees: {object: cube, least: 2}}}]
        - object_at: {object: cube, at: [0.4, -0.4, 0.425], within: 0.01}
        - not: {object_at: {object: cube, at: [0.4, -0.3, 0.425], within: 0.02}}
        - not: {object_at: {object: ball, at: [-0.4, 0.4, 0.43], within: 0.5}}
"""


def test_conditions_on_what_the_camera_sees() -> None:
    """The ball is where the last condition expects it, but out of view, so this is unknown."""
    with no_plots():
        result = bt.run(TREE)
    assert result.outcome == "SUCCESS", result.arms["arm1"].leaves
    leaves = result.arms["arm1"].leaves
    assert leaves["sequence/object_at"].metrics["distance_m"] < 0.005
    assert leaves["sequence/not#3/object_at"].reason == "ball is not in view"
