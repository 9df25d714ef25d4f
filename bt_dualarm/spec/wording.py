"""Values and texts in words for people, short and on one line."""

from __future__ import annotations

from bt_dualarm.spec.ports import shown
from bt_dualarm.spec.source import Data


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
