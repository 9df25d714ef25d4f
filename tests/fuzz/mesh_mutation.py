"""Random mutations of mesh files: of their bytes and their numbers."""

from __future__ import annotations

import random
import re

NUMBERS = (
    b"0",
    b"-1",
    b"nan",
    b"inf",
    b"1e38",
    b"1e-38",
    b"1e308",
    b"4294967295",
    b"-2147483648",
    b"x",
)
PIECES = (
    b"\0", b"\xff" * 4, b"\0" * 50, b"\x00\x00\xc0\x7f", b"\xff\xff\x7f\x7f", b"\n", b"<", b">",
    b"/", b"<!DOCTYPE a [<!ENTITY b 'c'>]>&b;", b"solid ", b"endsolid", b"f 1 2 3\n", b"v 0 0 0\n",
    b"f -1 -2 99\n", b"mtllib /etc/passwd\n", b"<up_axis>Z_UP</up_axis>",
    b'count="4000000000"', b'<unit meter="0"/>',
)  # fmt: skip
_NUMBER = re.compile(rb"-?\d+\.?\d*(?:e-?\d+)?")


def mutated(mesh: bytes, dice: random.Random) -> bytes:
    """The content of a file with a few mutations."""
    for _ in range(dice.randint(1, 4)):
        mesh = _mutate(mesh, dice)
    return mesh


def _mutate(mesh: bytes, dice: random.Random) -> bytes:
    start = dice.randrange(len(mesh) + 1)
    end = min(len(mesh), start + dice.choice((1, 4, 12, 50, 200)))
    choice = dice.random()
    if choice < 0.25:
        return mesh[:start] + mesh[end:]
    if choice < 0.4:
        return mesh[:start] + mesh[start:end] * 2 + mesh[end:]
    if choice < 0.55:
        return mesh[:start] + dice.choice(PIECES) + mesh[dice.choice((start, end)) :]
    if choice < 0.65:
        return mesh[:start] + dice.randbytes(end - start) + mesh[end:]
    if choice < 0.7:
        return mesh[:start]
    if choice < 0.78:  # the count of a binary STL
        return (
            mesh[:80]
            + dice.choice((0, 1, 11, 13, 2**31, 2**32 - 1)).to_bytes(4, "little")
            + mesh[84:]
        )
    found = list(_NUMBER.finditer(mesh))
    if not found:
        return mesh[:start] + bytes(end - start) + mesh[end:]
    number = dice.choice(found)[0]
    value = dice.choice(NUMBERS)
    where = [match for match in found if match[0] == number]
    for match in reversed(where if dice.random() < 0.5 else where[:1]):
        mesh = mesh[: match.start()] + value + mesh[match.end() :]
    return mesh
