"""A draft of a robot's page as YAML, with a word on every guess."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np

from bt_dualarm.pose import Vector
from bt_dualarm.spec.scalars import ScalarError, plain_value
from bt_dualarm.world.robots.page_draft import PageDraft

_PLAIN: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_./-]*", re.ASCII)

_SOURCES: Final = {
    "velocity": "Guessed by bt-robot where the URDF gives none of use; see the data sheet",
    "effort": "Guessed by bt-robot, three times what gravity asks for; see the data sheet",
    "acceleration": "Guessed by bt-robot, half of what efforts allow at home; see the data sheet",
    "jerk": "Guessed by bt-robot, full acceleration is reached in 50 ms; see the data sheet",
}


def page_text(draft: PageDraft, title: str, urdf: str, srdf: str | None) -> str:
    """The page; it can be used as it is, and is meant to be edited.

    Args:
        draft: What was measured.
        title: Name for people.
        urdf: URDF as the page is to name it; likewise ``srdf``.
        srdf: SRDF, if there is one.
    """
    return "\n".join(_lines(draft, title, urdf, srdf)) + "\n"


def _lines(draft: PageDraft, title: str, urdf: str, srdf: str | None) -> Iterator[str]:
    yield "# A first page, by bt-robot. Replace what is guessed by the data sheet's numbers."
    yield f"title: {_text(title)}"
    yield f"urdf: {_text(urdf)}"
    if srdf is not None:
        yield f"srdf: {_text(srdf)}"
    yield f"base_link: {_text(draft.base_link)}"
    yield f"tool: {{link: {_text(draft.tool_link)}}}   # its z axis is to point out of the tool"
    yield f"joints: [{_list(draft.joints)}]"
    if draft.locked:
        pairs = (f"{_text(name)}: {_number(value)}" for name, value in draft.locked.items())
        yield f"locked: {{{', '.join(pairs)}}}   # these cannot be at zero"
    yield "limits:   # rad/s, rad/s², rad/s³, N m"
    for what in ("velocity", "effort", "acceleration", "jerk"):
        yield from _limit(what, getattr(draft, what))
    if draft.weak:
        yield f"# The efforts hardly hold the arm at home: {', '.join(draft.weak)}."
    yield "postures:   # degrees"
    yield f"  home: [{', '.join(map(_number, draft.home))}]"
    if draft.exclude:
        yield "exclude:   # these touch in nearly every posture, by how they are modelled"
        yield from (f"  - [{_list(pair)}]" for pair in draft.exclude)


def _limit(what: str, values: Vector | None) -> Iterator[str]:
    if values is None:
        return
    same = bool((values == values[0]).all())
    shown = _number(values[0]) if same else f"[{', '.join(map(_number, values))}]"
    yield f"  {what}:"
    yield f"    value: {shown}"
    yield f"    source: {_SOURCES[what]}"


def _list(names: Iterable[str]) -> str:
    return ", ".join(map(_text, names))


def _number(value: float) -> str:
    return np.format_float_positional(round(float(value), 6), trim="-")


def _text(text: str) -> str:
    """As it is where YAML reads it as text, else in quotes."""
    try:
        plain = _PLAIN.fullmatch(text) is not None and isinstance(plain_value(text), str)
    except ScalarError:
        plain = False
    return text if plain else json.dumps(text, ensure_ascii=False)
