"""Random mutations of XML files: of their elements, their values and their text."""

from __future__ import annotations

import copy
import itertools
import random
import xml.etree.ElementTree as ET
from dataclasses import dataclass

PIECES = (
    b"<", b">", b"/>", b'"', b"'", b"&", b"&amp;", b"&#0;", b"&a;", b"<!--", b"-->", b"<![CDATA[",
    b"<?x?>", b"<!DOCTYPE a [<!ENTITY b 'c'>]>", b"\0", b"\xff", b"\xc3", b"\r", b"\x1b[2J",
    b"<robot>", b"</robot>", b"</link>", b"\xef\xbb\xbf",
)  # fmt: skip


@dataclass(frozen=True)
class Words:
    """Texts that a mutation inserts.

    Attributes:
        values: Values of attributes.
        tags: Names of elements.
        attributes: Names of attributes.
        references: Names of the attributes whose values are names of elements.
    """

    values: tuple[str, ...]
    tags: tuple[str, ...]
    attributes: tuple[str, ...]
    references: tuple[str, ...]


def mutated_by(words: Words, root: ET.Element, dice: random.Random) -> bytes:
    """A file with a few mutations."""
    root = copy.deepcopy(root)
    for _ in range(dice.randint(1, 4)):
        _mutate(words, root, dice)
    text = ET.tostring(root)
    return _torn(text, dice) if dice.random() < 0.15 else text


def _mutate(words: Words, root: ET.Element, dice: random.Random) -> None:
    elements = list(root.iter())
    parents = [element for element in elements if len(element)]
    choice = dice.random()
    if choice < 0.4:
        _change_value(words, dice.choice(elements), elements, dice)
    elif choice < 0.55 and parents:
        parent = dice.choice(parents)
        parent.remove(dice.choice(list(parent)))
    elif choice < 0.7 and parents:
        parent = dice.choice(parents)
        parent.append(copy.deepcopy(dice.choice(list(parent))))
    elif choice < 0.78:
        dice.choice(elements).append(copy.deepcopy(dice.choice(elements[1:] or elements)))
    elif choice < 0.84:
        dice.choice(elements).tag = dice.choice(words.tags)
    elif choice < 0.9:
        new = ET.SubElement(dice.choice(elements), dice.choice(words.tags))
        for _ in range(dice.randint(0, 3)):
            new.set(dice.choice(words.attributes), dice.choice(words.values[:40]))
    elif choice < 0.95 and parents:
        children = list(dice.choice(parents))
        dice.shuffle(children)
        for element, other in itertools.pairwise(children):
            element.attrib, other.attrib = other.attrib, element.attrib
    else:
        _rename_everywhere(words, elements, dice)


def _change_value(
    words: Words, element: ET.Element, elements: list[ET.Element], dice: random.Random
) -> None:
    names = list(element.attrib)
    if not names:
        element.set(dice.choice(words.attributes), dice.choice(words.values))
        return
    name = dice.choice(names)
    choice = dice.random()
    if choice < 0.6:
        element.set(name, dice.choice(words.values))
    elif choice < 0.7:
        del element.attrib[name]
    elif choice < 0.8:
        element.set(dice.choice(words.attributes), element.attrib.pop(name))
    else:  # the value of another element
        values = [other.attrib[name] for other in elements if name in other.attrib]
        element.set(name, dice.choice(values))


def _rename_everywhere(words: Words, elements: list[ET.Element], dice: random.Random) -> None:
    """Renames a link or joint wherever its name occurs."""
    named = [element.attrib["name"] for element in elements if "name" in element.attrib]
    if not named:
        return
    old = dice.choice(named)
    new = dice.choice(words.values)
    for element in elements:
        for attribute in words.references:
            if element.attrib.get(attribute) == old:
                element.set(attribute, new)


def _torn(text: bytes, dice: random.Random) -> bytes:
    start = dice.randrange(len(text) + 1)
    end = min(len(text), start + dice.randrange(20))
    return text[:start] + dice.choice(PIECES) + text[dice.choice((start, end)) :]
