"""Read a record as arrays: joints, tool and gripper over time, objects, and a table of all.

A table needs the extra ``export`` (``pip install 'bt_dualarm[export]'``), which brings pyarrow.

Usage: python 19_load_a_record.py [FOLDER]

Prints::

    <RunData grasp_and_lift: SUCCESS, 14... states until 2.9... s, arms arm1>
    largest joint error: 0.1... degrees
    lifted by 40 mm, held from 2... s on
    the pads close from 85 to 50 mm
    14... rows, 43 columns: time_s, arm1.q_rad.shoulder_pan_joint, ...
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import bt_dualarm as bt

TREE = """
bt_dualarm: 1
name: grasp_and_lift
world: {scene: table, reality: lab}
objects:
  cube: {shape: box, size: [0.05, 0.05, 0.05], mass: 0.2, pose: {xyz: [0.40, -0.45, 0.425]}}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 0, 0.40]}
    gripper: robotiq_2f85
    tree: {grasp: {object: cube}}
"""

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
bt.run(TREE, record=folder / "record")

# The record may come from someone else: it is validated, and no code is loaded from it.
data = bt.load(folder / "record")
print(data)

# Each array has one row for each state, 50 a second of simulated time.
arm = data.arms["arm1"]
error = np.degrees(np.abs(arm.q - arm.setpoint_q).max())
print(f"largest joint error: {error:.3f} degrees")

height = data.objects["cube"].position[:, 2]
since = next(time for time, names in arm.held if "cube" in names)
print(f"lifted by {1000 * (height[-1] - height[0]):.0f} mm, held from {since:.1f} s on")
if arm.gripper is not None:
    width_mm = 1000 * arm.gripper.width
    print(f"the pads close from {width_mm[0]:.0f} to {width_mm.min():.0f} mm")

# `data.signals` has all of these by name: `pandas.DataFrame(data.signals)`, or as a pyarrow table.
table = data.table()
print(f"{table.num_rows} rows, {table.num_columns} columns:", ", ".join(table.column_names[:3]))
