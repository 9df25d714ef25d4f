"""Things by their names, of which an unknown one is answered with the nearest there is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TypeVar

from bt_dualarm.errors import NameUnknownError
from bt_dualarm.spec.problems import suggestion

T = TypeVar("T")


class Named(Mapping[str, T]):
    """A mapping that cannot be changed and helps with a misspelt name.

    Args:
        noun: What the things are, in one word.
        things: The things by name, in the order in which they are to be listed.
    """

    def __init__(self, noun: str, things: Mapping[str, T]) -> None:
        self._noun = noun
        self._things = dict(things)

    def __getitem__(self, name: str) -> T:
        try:
            return self._things[name]
        except KeyError:
            hint = suggestion(str(name), self._things, self._noun)
            raise NameUnknownError(f"there is no {self._noun} '{name}'; {hint}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._things)

    def __len__(self) -> int:
        return len(self._things)

    def __repr__(self) -> str:
        return repr(self._things)
