"""A small valid arm of two joints, of which tests make one detail invalid at a time."""

from __future__ import annotations

from pathlib import Path

URDF = """\
<?xml version="1.0" encoding="utf-8"?>
<robot name="small">
  <link name="base">
    <collision><geometry><cylinder radius="0.05" length="0.1"/></geometry></collision>
  </link>
  <link name="upper">
    <inertial>
      <origin xyz="0 0 0.1" rpy="0 0 0"/>
      <mass value="2.0"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.005"/>
    </inertial>
    <collision>
      <origin xyz="0 0 0.15"/>
      <geometry><box size="0.06 0.06 0.2"/></geometry>
    </collision>
  </link>
  <link name="lower">
    <inertial>
      <mass value="1.0"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.005"/>
    </inertial>
    <collision>
      <origin xyz="0 0 0.15"/>
      <geometry><sphere radius="0.03"/></geometry>
    </collision>
  </link>
  <link name="finger"/>
  <link name="flange"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/>
    <child link="upper"/>
    <origin xyz="0 0 0.1" rpy="0 0 0"/>
    <axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" velocity="2" effort="40"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="upper"/>
    <child link="lower"/>
    <origin xyz="0 0 0.3" rpy="0 0 0"/>
    <axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="2" effort="20"/>
  </joint>
  <joint name="slide" type="prismatic">
    <parent link="lower"/>
    <child link="finger"/>
    <axis xyz="1 0 0"/>
    <limit lower="0" upper="0.04" velocity="1" effort="5"/>
  </joint>
  <joint name="flange_joint" type="fixed">
    <parent link="lower"/>
    <child link="flange"/>
    <origin xyz="0 0 0.3"/>
  </joint>
</robot>
"""

DESCRIPTION = """\
title: Small arm
urdf: small.urdf
base_link: base
tool: {link: flange}
joints: [shoulder, elbow]
limits:
  acceleration: {value: 5.0, source: chosen for these tests}
  jerk: {value: 100.0, source: chosen for these tests}
postures:
  home: [0, 30]
"""

NAME = "small.yaml"


def write_robot(folder: Path, urdf: str = URDF, description: str = DESCRIPTION) -> str:
    """Write description and URDF into a folder; return the description's file name."""
    (folder / "small.urdf").write_text(urdf, encoding="utf-8")
    (folder / NAME).write_text(description, encoding="utf-8")
    return NAME


def line_of(text: str, part: str) -> int:
    """The line, counted from 1, in which a part of a text begins."""
    return text[: text.index(part)].count("\n") + 1
