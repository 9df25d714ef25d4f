"""Read why a tree failed: the result's codes and numbers, then the diagnosis of `bt-why`.

Usage: python 12_why_it_failed.py [FOLDER]

Prints::

    FAILURE: every tree has ended
    sequence/reach_to_pose: SUCCESS
    sequence/too far: FAILURE INVALID_TARGET ...1.38 m from the first joint ...
      numbers: distance_m = 1.376, reach_m = 0.953
    too_far, seed 0, 1.42 s
    ...
    arm1: sequence/too far (<text>:12) FAILURE at 1.42 s INVALID_TARGET
      why: ...423 mm outside the reach of ur5...
    ...
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import bt_dualarm as bt

TREE = """
bt_dualarm: 1
name: too_far
world: {scene: empty}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 0, 0.40]}
    tree:
      sequence:
        - reach_to_pose: {to: {xyz: [0.4, 0.3, 0.7], rpy: [180, 0, 0]}}
        - reach_to_pose: {name: too far, to: {xyz: [0.4, 1.3, 0.7], rpy: [180, 0, 0]}}
        - go_home
"""

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
result = bt.run(TREE, record=folder / "record")
print(f"{result.outcome}: {result.ending}")
for leaf in result.arms["arm1"].leaves.values():
    print(f"{leaf.path}: {leaf.status} {leaf.code} {leaf.reason}".rstrip())
    if leaf.status == "FAILURE":
        print("  numbers:", ", ".join(f"{k} = {v:.3f}" for k, v in leaf.metrics.items()))

# `bt-why` derives causes from the record: from what the leaf knew and what truly happened.
program = Path(sys.executable).with_name("bt-why")
story = subprocess.run([program, folder / "record"], capture_output=True, text=True, check=True)
print(story.stdout)
