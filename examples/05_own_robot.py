"""Describe and run your own robot: a URDF, and a YAML file beside it with the rest.

The URDF has kinematics, inertia, and limits. This one is generated; yours comes from the
manufacturer, and `bt-robot my_arm.urdf --base LINK --tool LINK` writes the YAML file.

Usage: python 05_own_robot.py [FOLDER]

Prints::

    <RunResult own_robot: SUCCESS after 1.8... s, every tree has ended (arm1 SUCCESS)>
    move_linear: 0.027... mm RMS from the line
"""

import sys
import tempfile
from pathlib import Path

import bt_dualarm as bt

LENGTHS = (0.20, 0.40, 0.35, 0.12, 0.10, 0.08)  # of the links, m
AXES = ("0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 0 1", "0 1 0")  # of the joints, in the links
EFFORTS = (150, 150, 100, 30, 30, 30)  # N m

DESCRIPTION = """
title: Six boxes
urdf: six_boxes.urdf
base_link: link0
tool: {link: link6, xyz: [0, 0, 0.08]}
joints: [joint1, joint2, joint3, joint4, joint5, joint6]
limits:
  acceleration: {value: 5.0, source: chosen for this example}
  jerk: {value: 100.0, source: chosen for this example}
postures:   # degrees
  home: [0, 20, 80, 30, 20, 40]
"""

TREE = """
bt_dualarm: 1
name: own_robot
world: {scene: empty, reality: lab}
arms:
  arm1:
    robot: six_boxes.yaml
    tree: {sequence: [{move_linear: {offset: {xyz: [0, 0.1, 0]}}}, go_home]}
"""


def urdf() -> str:
    """URDF of a chain of boxes, each as long as its link."""
    parts = ['<robot name="six_boxes"><link name="link0"/>']
    begins_at = 0.0
    for i, (length, axis, effort) in enumerate(zip(LENGTHS, AXES, EFFORTS, strict=True), start=1):
        mass = 12.0 * length
        across, along = mass * length**2 / 12, mass * 0.06**2 / 6
        middle = f'<origin xyz="0 0 {length / 2}"/>'
        parts.append(f"""
<link name="link{i}">
  <inertial>{middle}<mass value="{mass}"/>
    <inertia ixx="{across}" iyy="{across}" izz="{along}" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision>{middle}<geometry><box size="0.06 0.06 {0.6 * length}"/></geometry></collision>
</link>
<joint name="joint{i}" type="revolute">
  <parent link="link{i - 1}"/><child link="link{i}"/><origin xyz="0 0 {begins_at}"/>
  <axis xyz="{axis}"/><limit lower="-2.9" upper="2.9" velocity="2" effort="{effort}"/>
</joint>""")
        begins_at = length
    return "".join(parts) + "</robot>"


folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
(folder / "six_boxes.urdf").write_text(urdf())
(folder / "six_boxes.yaml").write_text(DESCRIPTION)
(folder / "own_robot.yaml").write_text(TREE)

result = bt.run(folder / "own_robot.yaml")
print(result)
metrics = result.arms["arm1"].leaves["sequence/move_linear"].metrics
print(f"move_linear: {1000 * metrics['path_rms_m']:.4f} mm RMS from the line")
