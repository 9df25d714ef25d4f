"""Values and texts in words for people, short and on one line."""

from __future__ import annotations

import unicodedata
from typing import Final

from bt_dualarm.spec.ports import shown
from bt_dualarm.spec.source import Data

_ACTED_ON: Final = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})
"""Categories of characters by which a terminal moves, colours, hides or turns around text."""


def in_words(value: Data) -> str:
    """A value in words, short enough for a message."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        value = one_line(shown(value))
        return f"text '{value if len(value) <= 40 else value[:37] + '...'}'"
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, (list, tuple)):
        return f"a list of {len(value)}"
    return f"{value:g}" if isinstance(value, float) else str(value)[:40]


def one_line(text: str) -> str:
    """The same text on one line, with a mark for each character that a terminal would not show."""
    return "".join(
        letter if letter.isprintable() else "\ufffd" for letter in " ".join(text.split())
    )


def counted(number: int, noun: str) -> str:
    """A number of things: ``1 item``, ``3 items``."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def escaped(text: str, keep: str = "\n\t") -> str:
    r"""Text from somebody else for a terminal or a table: what would be acted on is written out.

    Control characters, marks of direction and halves of pairs become ``\u001b`` and the like, as
    JSON writes them; so JSON stays what it says.

    Args:
        text: The text.
        keep: Characters that stay.
    """
    if text.isprintable():
        return text
    return "".join(
        letter if letter in keep or unicodedata.category(letter) not in _ACTED_ON else _code(letter)
        for letter in text
    )


def _code(letter: str) -> str:
    number = ord(letter)
    if number > 0xFFFF:
        number -= 0x10000
        return f"\\u{0xD800 + (number >> 10):04x}\\u{0xDC00 + (number & 0x3FF):04x}"
    return f"\\u{number:04x}"
