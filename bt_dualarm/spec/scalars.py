"""What a plain YAML scalar means: what it looks like, or nothing, with advice."""

from __future__ import annotations

import math
import re
from typing import Final

_INTEGER = re.compile(r"[-+]?(?:0|[1-9][0-9]*)")
_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_CLOCK = re.compile(r"[-+]?[0-9]+(?::[0-5]?[0-9])+(?:\.[0-9]*)?")
_OTHER_BASE = re.compile(r"[-+]?0[xXoObB][0-9a-fA-F_]+")
_LEADING_ZERO = re.compile(r"[-+]?0[0-9]+")
_GROUPED = re.compile(r"[-+]?[0-9][0-9_]*_[0-9_.]*")
_NOT_FINITE = re.compile(r"[-+]?\.(?:inf|nan)", re.IGNORECASE)
LARGEST_INTEGER: Final = 2**53
"""Beyond it, whole numbers cannot be told apart as JSON and doubles have them."""

_LONGEST_NUMBER = 40
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


class ScalarError(ValueError):
    """A scalar that means different things to different readers; carries the advice."""

    def __init__(self, message: str, hint: str) -> None:
        super().__init__(message)
        self.hint = hint


def control_character(text: str) -> str:
    """The first character that would act on a terminal rather than be shown: ``U+001B``.

    Empty where there is none. Line feed and tab are allowed; what changes the direction of writing
    is not: it lets a text look like another one.
    """
    found = _CONTROL.search(text)
    return f"U+{ord(found[0]):04X}" if found else ""


def plain_value(text: str) -> bool | int | float | str | None:
    """The value of an unquoted scalar.

    Raises:
        ScalarError: YAML readers disagree on it, or it is no finite number of sensible size.
    """
    if text in ("", "~", "null", "Null", "NULL"):
        return None
    if text in ("true", "True", "TRUE"):
        return True
    if text in ("false", "False", "FALSE"):
        return False
    _refuse_ambiguous(text)
    if text[0] in "+-.0123456789":
        return _number_or_text(text)
    return text


def _refuse_ambiguous(text: str) -> None:
    quoted = f'"{text}"'
    if text.lower() in ("yes", "no", "on", "off"):
        meant = "true" if text.lower() in ("yes", "on") else "false"
        raise ScalarError(
            f"'{text}' is a truth value to some YAML readers and text to others",
            f"write {meant}, or {quoted} if text is meant",
        )
    if _CLOCK.fullmatch(text):
        raise ScalarError(
            f"'{text}' is {_sexagesimal(text)} to some YAML readers and text to others",
            f"write {_sexagesimal(text)} if a number is meant, or {quoted} if text is meant",
        )
    if _NOT_FINITE.fullmatch(text):
        raise ScalarError(f"'{text}' is not a finite number", f"or quote it as text: {quoted}")


def _number_or_text(text: str) -> int | float | str:
    quoted = f'"{text}"'
    if _INTEGER.fullmatch(text):
        if len(text) > _LONGEST_NUMBER or abs(int(text)) > LARGEST_INTEGER:
            raise ScalarError("this number is too large", f"at most {LARGEST_INTEGER} is allowed")
        return int(text)
    if _OTHER_BASE.fullmatch(text) or _GROUPED.fullmatch(text) or _LEADING_ZERO.fullmatch(text):
        raise ScalarError(
            f"'{text}' is a number in some notations only",
            f"write it in plain decimal digits, or {quoted} if text is meant",
        )
    if not _NUMBER.fullmatch(text):
        return text
    number = float(text)
    if not math.isfinite(number):
        raise ScalarError("this number is too large", "it has no finite value")
    return number


def _sexagesimal(text: str) -> str:
    """What ``1:30`` is in YAML 1.1: 90."""
    sign = -1.0 if text.startswith("-") else 1.0
    total = 0.0
    for part in text.lstrip("+-").split(":"):
        total = total * 60 + float(part)
    return f"{sign * total:g}"
