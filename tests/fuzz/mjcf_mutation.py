"""Random mutations of scenes in MuJoCo's format."""

from __future__ import annotations

import random
import xml.etree.ElementTree as ET

from tests.fuzz.xml_mutation import Words, mutated_by

WORDS = Words(
    values=(
        "", "0", "-1", "1", "0.05", "nan", "inf", "1e999", "1e-300", "1e300", "abc", "0,5", "1 2",
        "1 2 3", "1 2 3 4", "0 0 0", "nan 0 0", "1 -1 1", "0 0 0 0", "0x10", "٣", "true", "false",
        "auto", "box", "sphere", "capsule", "ellipsoid", "cylinder", "plane", "mesh", "hfield",
        "sdf", "hinge", "slide", "ball", "free", "steel", "world", "press", "arm1", "\t", "\u2028",
        "x" * 200, "<", "&", "../a.stl", "/etc/passwd", "/dev/zero", "-40 40", "40 -40", "degree",
    ),
    tags=(
        "body", "geom", "joint", "freejoint", "inertial", "site", "camera", "light", "default",
        "compiler", "option", "include", "asset", "mesh", "texture", "material", "contact", "pair",
        "exclude", "equality", "weld", "actuator", "motor", "sensor", "plugin", "extension",
        "composite", "flexcomp", "attach", "replicate", "frame", "keyframe", "size", "worldbody",
    ),
    attributes=(
        "name", "type", "pos", "quat", "euler", "size", "rgba", "mass", "density", "class",
        "childclass", "mocap", "range", "limited", "axis", "stiffness", "damping", "frictionloss",
        "springref", "fromto", "mesh", "file", "contype", "conaffinity", "friction", "group",
        "fovy", "count", "offset", "gravcomp", "margin", "armature", "diaginertia",
    ),
    references=("name", "class", "childclass", "body1", "mesh", "material"),
)  # fmt: skip


def mutated(root: ET.Element, dice: random.Random) -> bytes:
    """A scene with a few mutations."""
    return mutated_by(WORDS, root, dice)
