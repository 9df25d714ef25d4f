"""Which pages look on: each names itself whenever it asks, and says when it is closed."""

from __future__ import annotations

import time
from threading import Lock
from typing import Final

_SILENT_S: Final = 600.0
"""Seconds on the wall after which a page that says nothing more is taken for closed: browsers let
the pages of a window that is hidden ask once a minute, and a machine may sleep for a while."""

_NAMELESS_S: Final = 2.0
"""The same for whoever asks without a name: no page of ours does."""

_OPENING_S: Final = 10.0
"""Seconds that a page may take from being fetched to asking for the first time."""

_RELOAD_S: Final = 3.0
"""Seconds for which a page that was closed may come back: it is only being loaded anew."""

_MOST: Final = 100
_LONGEST: Final = 64


class Viewers:
    """Who looks on; asked and told by the threads that answer."""

    def __init__(self) -> None:
        self._until: dict[str, float] = {}
        self._lock = Lock()

    def fetched(self) -> None:
        """The page was sent: it is about to ask."""
        self._extend("fetched", _OPENING_S)

    def asked(self, page: str) -> None:
        """A page of this name has asked how the run stands; empty for whoever has none."""
        if page:
            self._extend(f"page {page[:_LONGEST]}", _SILENT_S)
        else:
            self._extend("nameless", _NAMELESS_S)

    def left(self, page: str) -> None:
        """A page of this name was closed, or is being loaded anew."""
        with self._lock:
            self._until.pop(f"page {page[:_LONGEST]}", None)
        self._extend("left", _RELOAD_S)

    @property
    def is_anyone_there(self) -> bool:
        """Whether a page is open, or about to be."""
        with self._lock:
            return any(until > time.monotonic() for until in self._until.values())

    def _extend(self, who: str, seconds: float) -> None:
        with self._lock:
            self._until[who] = time.monotonic() + seconds
            if len(self._until) > _MOST:  # the one that has been silent for longest goes
                del self._until[min(self._until, key=self._until.__getitem__)]
