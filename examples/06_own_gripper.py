"""Describe your own gripper and grasp with it: one YAML file, which fits any robot.

Usage: python 06_own_gripper.py [FOLDER]

Prints::

    grasp: SUCCESS
      approach_force_n = 5.4...
      width_m = 0.050
      grip_force_n = 5.0...
      ...
    after 3.0 s the cube is 40 mm above the table
"""

import sys
import tempfile
from pathlib import Path

import bt_dualarm as bt

GRIPPER = """
title: Two plates
tool: {xyz: [0, 0, 0.10]}   # between the pads; z points out, fingers move along y
palm:
  mass: 0.5
  shapes:
    - {shape: box, size: [0.06, 0.14, 0.05], xyz: [0, 0, 0.025]}
fingers:
  place: {xyz: [0, 0, 0.05]}
  part:   # one closed finger; y points outward
    mass: 0.05
    shapes:
      - {shape: box, size: [0.02, 0.01, 0.07], xyz: [0, 0.01, 0.035]}
  pad: {xyz: [0, 0.0025, 0.05], size: [0.02, 0.005, 0.03]}
stroke: {value: 0.08, source: chosen for this example}
force: {value: [5, 80], source: chosen for this example}
speed: {value: [0.01, 0.1], source: chosen for this example}
payload: {value: 2, source: chosen for this example}
"""

TREE = """
bt_dualarm: 1
name: own_gripper
world: {scene: table, reality: lab}
objects:
  cube: {shape: box, size: [0.05, 0.05, 0.05], mass: 0.2, pose: {xyz: [0.40, -0.45, 0.425]}}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 0, 0.40]}
    gripper: two_plates.yaml
    tree: {grasp: {object: cube}}
"""

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
(folder / "two_plates.yaml").write_text(GRIPPER)
(folder / "own_gripper.yaml").write_text(TREE)

with bt.open(folder / "own_gripper.yaml") as run:
    result = run.finish()
    height = run.world.object_pose("cube").position[2] - 0.425  # the simulator's truth
leaf = result.arms["arm1"].leaves["grasp"]
print(f"grasp: {leaf.status} {leaf.reason}".rstrip())
for name, value in leaf.metrics.items():
    print(f"  {name} = {value:.3f}")
print(f"after {result.sim_time_s:.1f} s the cube is {1000 * height:.0f} mm above the table")
