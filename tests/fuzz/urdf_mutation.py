"""Random mutations of URDFs: of their elements, of their values, of their text."""

from __future__ import annotations

import copy
import itertools
import random
import xml.etree.ElementTree as ET

VALUES = (
    "", "0", "-0", "1", "-1", "3", "0.5", "nan", "inf", "-inf", "1e999", "1e-300", "1e300", "1e16",
    "1e-9", "abc", "0,5", "1 2", "1 2 3", "1 2 3 4", "0 0 0", "0 0 1e-12", "nan 0 0", "1 -1 1",
    "1e200 1e200 1e200", "0x10", "1_000", "٣", "1.", ".5", "1e", "--1", "${mass}", "\t", " ",
    "\u2028", "\U0001f916", "a/b", "a\\b", "x" * 200, "<", "&", "world", "base", "tool", "pedestal",
    "camera", "mount", "base_0", "upper_visual_0", "universe", "root_joint", "flange/fixed",
    "revolute", "continuous", "prismatic", "fixed", "floating", "planar", "box.stl", "../box.stl",
    "file:///etc/passwd", "file://box.stl", "package://", "package://panda_description/x.stl",
    "package:///etc/passwd", "https://a.example/a.stl", ".", "..", "/dev/zero", "box.stl/",
    "~/a.stl",
)  # fmt: skip
TAGS = (
    "link", "joint", "inertial", "mass", "inertia", "origin", "visual", "collision", "geometry",
    "box", "cylinder", "sphere", "mesh", "capsule", "axis", "limit", "mimic", "parent", "child",
    "dynamics", "material", "gazebo", "robot", "xacro:macro", "safety_controller",
)  # fmt: skip
ATTRIBUTES = (
    "name", "type", "xyz", "rpy", "value", "ixx", "ixy", "ixz", "iyy", "iyz", "izz", "lower",
    "upper", "velocity", "effort", "link", "joint", "radius", "length", "size", "filename", "scale",
)  # fmt: skip
PIECES = (
    b"<", b">", b"/>", b'"', b"'", b"&", b"&amp;", b"&#0;", b"&a;", b"<!--", b"-->", b"<![CDATA[",
    b"<?x?>", b"<!DOCTYPE a [<!ENTITY b 'c'>]>", b"\0", b"\xff", b"\xc3", b"\r", b"\x1b[2J",
    b"<robot>", b"</robot>", b"</link>", b"\xef\xbb\xbf",
)  # fmt: skip


def mutated(root: ET.Element, dice: random.Random) -> bytes:
    """A file with a few mutations."""
    root = copy.deepcopy(root)
    for _ in range(dice.randint(1, 4)):
        _mutate(root, dice)
    text = ET.tostring(root)
    return _torn(text, dice) if dice.random() < 0.15 else text


def _mutate(root: ET.Element, dice: random.Random) -> None:
    elements = list(root.iter())
    parents = [element for element in elements if len(element)]
    choice = dice.random()
    if choice < 0.4:
        _change_value(dice.choice(elements), elements, dice)
    elif choice < 0.55 and parents:
        parent = dice.choice(parents)
        parent.remove(dice.choice(list(parent)))
    elif choice < 0.7 and parents:
        parent = dice.choice(parents)
        parent.append(copy.deepcopy(dice.choice(list(parent))))
    elif choice < 0.78:
        dice.choice(elements).append(copy.deepcopy(dice.choice(elements[1:] or elements)))
    elif choice < 0.84:
        dice.choice(elements).tag = dice.choice(TAGS)
    elif choice < 0.9:
        new = ET.SubElement(dice.choice(elements), dice.choice(TAGS))
        for _ in range(dice.randint(0, 3)):
            new.set(dice.choice(ATTRIBUTES), dice.choice(VALUES[:40]))
    elif choice < 0.95 and parents:
        children = list(dice.choice(parents))
        dice.shuffle(children)
        for element, other in itertools.pairwise(children):
            element.attrib, other.attrib = other.attrib, element.attrib
    else:
        _rename_everywhere(elements, dice)


def _change_value(element: ET.Element, elements: list[ET.Element], dice: random.Random) -> None:
    names = list(element.attrib)
    if not names:
        element.set(dice.choice(ATTRIBUTES), dice.choice(VALUES))
        return
    name = dice.choice(names)
    choice = dice.random()
    if choice < 0.6:
        element.set(name, dice.choice(VALUES))
    elif choice < 0.7:
        del element.attrib[name]
    elif choice < 0.8:
        element.set(dice.choice(ATTRIBUTES), element.attrib.pop(name))
    else:  # as some other element has it
        values = [other.attrib[name] for other in elements if name in other.attrib]
        element.set(name, dice.choice(values))


def _rename_everywhere(elements: list[ET.Element], dice: random.Random) -> None:
    """A link or joint that is called otherwise, wherever it is named."""
    named = [element.attrib["name"] for element in elements if "name" in element.attrib]
    if not named:
        return
    old = dice.choice(named)
    new = dice.choice(VALUES)
    for element in elements:
        for attribute in ("name", "link", "joint"):
            if element.attrib.get(attribute) == old:
                element.set(attribute, new)


def _torn(text: bytes, dice: random.Random) -> bytes:
    start = dice.randrange(len(text) + 1)
    end = min(len(text), start + dice.randrange(20))
    return text[:start] + dice.choice(PIECES) + text[dice.choice((start, end)) :]
