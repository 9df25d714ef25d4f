"""Recorded runs for the tests that read records."""

from __future__ import annotations

from pathlib import Path

import bt_dualarm
from bt_dualarm.replay.record import Record

SHORT = """\
bt_dualarm: 1
name: short
include: [parts.yaml]
world: {scene: empty, time_limit: 20}
objects:
  ball: {shape: sphere, size: [0.05], mass: 1, pose: {xyz: [1, 1, 0.5]}}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 0, 0.4]}
    posture: present
    tree:
      sequence:
        - set: {key: goal, value: {xyz: [0, 0.06, 0]}}
        - subtree: {use: aside}
        - reach_to_pose: {offset: "{goal}"}
"""
PARTS = """\
bt_dualarm: 1
subtrees:
  aside: {tree: {reach_to_pose: {offset: {xyz: [0, -0.06, 0]}, speed: 0.35}}}
"""

WATCHING = """\
bt_dualarm: 1
name: watching
world: {scene: empty, reality: lab, time_limit: 20}
objects:
  block:
    shape: box
    size: [0.06, 0.06, 0.04]
    mass: 0.1
    color: yellow
    pose: {xyz: [0.45, 0, 0.02]}
arms:
  arm1:
    robot: panda
    camera: {mount: wrist, resolution: [160, 120], fov: 50, fps: 30}
    tree:
      sequence:
        - look_at: {at: {xyz: [0.45, 0, 0.02]}, distance: 0.35}
        - track: {color: yellow, plane: xy, duration: 0.5}
"""
RETURNING = """\
bt_dualarm: 1
name: returning
world: {scene: empty, time_limit: 20}
arms:
  arm1:
    robot: ur5
    tree:
      sequence:
        - wait: 0.5 s
        - remove: {arm: arm2}
        - spawn: {arm: arm2}
        - wait: 0.1 s
  arm2:
    robot: panda
    base: {xyz: [0, 1.5, 0]}
    removable: true
    last_life_counts: true
    tree: {sequence: [{reach_to_pose: {offset: {xyz: [0.1, 0, 0.1]}, speed: 1}}, {wait: 0.2 s}]}
"""
"""A run in which an arm is removed and spawned again."""


def write_short(folder: Path, text: str = SHORT) -> Path:
    """Write the tree of an arm that moves aside and back, with its include; return its path."""
    folder.mkdir(exist_ok=True)
    (folder / "parts.yaml").write_text(PARTS)
    path = folder / "short.yaml"
    path.write_text(text)
    return path


def recorded(folder: Path, text: str = SHORT, **options: object) -> Record:
    """The record of a run of that tree."""
    bt_dualarm.run(write_short(folder, text), record=folder / "out", **options)  # type: ignore[arg-type]
    return Record.read(folder / "out")
