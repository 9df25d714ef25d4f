"""Python's search for circles of references, put off while much is made that stays."""

from __future__ import annotations

import gc
import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType


@contextmanager
def paused() -> Iterator[None]:
    """No search for circles, and none of it made up for afterwards: what was made counts as old.

    It stays, but for circles that imports leave; those go with the next search of everything. A
    tenth of the time from the first import to the first second of a run went into such searches. A
    collector that is switched off, or that somebody has told to spare what there is, is left alone.
    """
    if not gc.isenabled() or gc.get_freeze_count():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.unfreeze()  # into the oldest generation, without a look at it
        gc.enable()


def imported(name: str) -> ModuleType:
    """Import a module, without a search where it was not there."""
    if name in sys.modules:
        return importlib.import_module(name)  # waits for another thread that is at it
    with paused():
        return importlib.import_module(name)
