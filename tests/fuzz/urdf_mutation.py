"""Random mutations of URDFs."""

from __future__ import annotations

import random
import xml.etree.ElementTree as ET

from tests.fuzz.xml_mutation import Words, mutated_by

WORDS = Words(
    values=(
        "", "0", "-0", "1", "-1", "3", "0.5", "nan", "inf", "-inf", "1e999", "1e-300", "1e300",
        "1e16", "1e-9", "abc", "0,5", "1 2", "1 2 3", "1 2 3 4", "0 0 0", "0 0 1e-12", "nan 0 0",
        "1 -1 1", "1e200 1e200 1e200", "0x10", "1_000", "٣", "1.", ".5", "1e", "--1", "${mass}",
        "\t", " ", "\u2028", "\U0001f916", "a/b", "a\\b", "x" * 200, "<", "&", "world", "base",
        "tool", "pedestal", "camera", "mount", "base_0", "upper_visual_0", "universe",
        "root_joint", "flange/fixed", "revolute", "continuous", "prismatic", "fixed", "floating",
        "planar", "box.stl", "../box.stl", "file:///etc/passwd", "file://box.stl", "package://",
        "package://panda_description/x.stl", "package:///etc/passwd", "https://a.example/a.stl",
        ".", "..", "/dev/zero", "box.stl/", "~/a.stl",
    ),
    tags=(
        "link", "joint", "inertial", "mass", "inertia", "origin", "visual", "collision",
        "geometry", "box", "cylinder", "sphere", "mesh", "capsule", "axis", "limit", "mimic",
        "parent", "child", "dynamics", "material", "gazebo", "robot", "xacro:macro",
        "safety_controller",
    ),
    attributes=(
        "name", "type", "xyz", "rpy", "value", "ixx", "ixy", "ixz", "iyy", "iyz", "izz", "lower",
        "upper", "velocity", "effort", "link", "joint", "radius", "length", "size", "filename",
        "scale",
    ),
    references=("name", "link", "joint"),
)  # fmt: skip


def mutated(root: ET.Element, dice: random.Random) -> bytes:
    """A URDF with a few mutations."""
    return mutated_by(WORDS, root, dice)
