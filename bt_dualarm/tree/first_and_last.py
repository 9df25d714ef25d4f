"""What is kept of a list that may grow without an end: how it began, and how it went lately."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Generic, TypeVar

_Item = TypeVar("_Item")


class FirstAndLast(Generic[_Item]):
    """Keeps all items as long as they are few, then the first and the last ones.

    Args:
        each: Number of items kept from the beginning, and as many from the end.

    Attributes:
        left_out: Number of items between them that were dropped.
    """

    def __init__(self, each: int) -> None:
        self.left_out = 0
        self._each = each
        self._first: list[_Item] = []
        self._last: deque[_Item] = deque()

    def add(self, item: _Item) -> None:
        """Take up one more."""
        if len(self._first) < self._each:
            self._first.append(item)
            return
        self._last.append(item)
        if len(self._last) > self._each:
            self._last.popleft()
            self.left_out += 1

    def __iter__(self) -> Iterator[_Item]:
        yield from self._first
        yield from self._last
