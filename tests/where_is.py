"""Where is X? Answered as a newcomer would, by the names of folders and files and the rooms' maps.

    python -m tests.where_is when does an arm brake for another arm

A file has the words of its name, those that its room's map says of it in brackets, and shares the
words of the whole map. A word counts the more, the fewer files have it.
"""

from __future__ import annotations

import ast
import math
import re
import sys
from collections import Counter
from functools import cache
from pathlib import Path

from tests.source import MODULES, PACKAGE, SKILLS, parsed

_OWN, _ROOM = 2.0, 1.0
"""Weight of a word that is said of the file itself, and of one that is said of its room."""

_SAID = re.compile(r"`(\w+)`(?: and `(\w+)`)?\s+\(([^)]*)\)")
"""What a map says of one file or two."""

_IDLE = frozenset(
    re.findall(
        r"\w+",
        "a an and are as at by does for from how in is it of on one or the to what when where "
        "which who with file first open out its that they",
    )
)


def words(text: str) -> set[str]:
    """Its words, without endings that only grammar asks for."""
    found = re.findall(r"[a-z]+", text.lower())
    return {re.sub(r"(?<=\w{3})(?:ments?|ing|ed|es|s|e)$", "", word) for word in found} - _IDLE


@cache
def _index() -> dict[str, tuple[set[str], set[str]]]:
    """For every file the words that are its own, and those of its room."""
    index = {}
    for path in [*MODULES, *SKILLS]:
        if path.name.startswith("__"):
            continue
        base = PACKAGE if path.is_relative_to(PACKAGE) else PACKAGE.parent
        text = _map_of(path) if path.parent not in {PACKAGE, base} else ""
        said = [gloss for *files, gloss in _SAID.findall(text) if path.stem in files]
        own = words(" ".join([path.stem, *said]))
        index[path.relative_to(base).as_posix()] = (own, words(f"{text} {path.parent.name}"))
    return index


def _map_of(path: Path) -> str:
    room = path.with_name("__init__.py")
    return (ast.get_docstring(parsed(room)) or "") if room.exists() else ""


def where_is(question: str) -> list[str]:
    """Files that may answer a question, best first; none that shares no word with it."""
    asked = words(question)
    rarity: Counter[str] = Counter()
    for own, room in _index().values():
        rarity.update(own | room)
    weight = {word: math.log(1 + len(_index()) / rarity[word]) for word in asked if rarity[word]}
    marks = {}
    for place, (own, room) in _index().items():
        mark = _OWN * sum(weight[word] for word in asked & own)
        mark += _ROOM * sum(weight[word] for word in asked & room)
        if mark:
            marks[place] = mark
    return sorted(marks, key=lambda place: (-marks[place], place))


if __name__ == "__main__":
    sys.stdout.write("\n".join(where_is(" ".join(sys.argv[1:]))[:3]) + "\n")
