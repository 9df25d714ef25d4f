"""The words of the tree language by name: every node that is not a skill."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from bt_dualarm.spec import composite_words, decorator_words, leaf_words
from bt_dualarm.spec.word import Word

LANGUAGE: Final[Mapping[str, Word]] = MappingProxyType(
    {
        word.name: word
        for module in (composite_words, decorator_words, leaf_words)
        for word in vars(module).values()
        if isinstance(word, Word)
    }
)
"""Every word of the language, in the order of its definition."""
