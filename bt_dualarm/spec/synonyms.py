"""What other libraries of behaviour trees call the words of this language."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Final

from bt_dualarm.spec.language import LANGUAGE
from bt_dualarm.spec.problems import suggestion

SYNONYMS: Final[Mapping[str, str]] = MappingProxyType(
    {
        synonym: f"{word.name}, with {besides}" if besides else word.name
        for word in LANGUAGE.values()
        for synonym, besides in word.synonyms.items()
    }
)
"""Names of BehaviorTree.CPP and py_trees where they are not ours in another case; our words."""

_OWN_SKILLS: Final = "(skills of your own: --skills DIR)"


def kind_hint(given: str, kinds: Iterable[str]) -> str:
    """A hint for an unknown kind of node: our word for it, the nearest one, or all of them."""
    name, colon, rest = given.partition(":")
    if colon and rest:
        return f"write a space after the colon: '{name}: {rest}'"
    known = {_letters(kind): kind for kind in kinds}
    ours = {_letters(name): word for name, word in SYNONYMS.items()} | known
    word = ours.get(_letters(given), "")
    if word:
        name, comma, how = word.partition(",")
        return f"here it is '{name}'{comma}{how}"
    return f"{suggestion(given, known.values(), 'kind of node')} {_OWN_SKILLS}"


@lru_cache(maxsize=1024)
def _letters(name: str) -> str:
    """A name as it is compared: without case and underscores."""
    return re.sub("[^a-z0-9]", "", name.lower())
