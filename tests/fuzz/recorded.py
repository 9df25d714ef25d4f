"""The record that is mutated: short, with cameras, frames, a gripper, keys and failures."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import bt_dualarm
from tests.fuzz.record_mutation import Files

TREE: Final = """\
bt_dualarm: 1
name: small
include: [parts.yaml]
world: {scene: table, time_limit: 20}
objects:
  ball: {shape: sphere, size: [0.03], mass: 0.1, color: yellow, pose: {xyz: [0.4, 0.2, 0.43]}}
  block: {shape: box, size: [0.04, 0.04, 0.04], mass: 0.2, pose: {xyz: [0.5, -0.2, 0.42]}}
arms:
  arm1:
    robot: ur5
    gripper: robotiq_2f85
    base: {xyz: [0, 0, 0.4]}
    camera: {mount: wrist, resolution: [48, 36], fps: 20}
    tree:
      sequence:
        - set: {key: goal, value: {xyz: [3, 0, 0]}}
        - subtree: {use: aside}
        - reach_to_pose: {offset: "{goal}"}
  arm2:
    robot: ur3
    base: {xyz: [1.4, 0, 0.4], rpy: [0, 0, 180]}
    camera: {mount: wrist, resolution: [48, 36], fps: 20}
    tree:
      sequence:
        - track: {color: yellow, plane: xy, duration: 5}
"""
PARTS: Final = """\
bt_dualarm: 1
subtrees:
  aside: {tree: {wait: {seconds: 0.15}}}
"""


def recorded(folder: Path) -> Files:
    """Records a run of 0.3 s."""
    folder.mkdir(exist_ok=True)
    (folder / "parts.yaml").write_text(PARTS)
    (folder / "tree.yaml").write_text(TREE)
    bt_dualarm.run(folder / "tree.yaml", record=folder / "out", frames=True, duration=0.3)
    return Files.of(folder / "out")
