"""Importing a file of skills, which may raise anything."""

from __future__ import annotations

import hashlib
import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Final

from bt_dualarm.errors import Interruption, Overrun

_OUTSIDE: Final = (KeyboardInterrupt, Interruption, Overrun)
"""What ends an import from outside. Where the file itself has raised it, nothing tells that."""


def imported(file: Path) -> ModuleType:
    """Import a file under a name of its own, the same for the same file."""
    digest = hashlib.sha256(str(file.resolve()).encode()).hexdigest()[:12]
    name = f"bt_dualarm_skills_{digest}_{file.stem}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, file)
    if spec is None or spec.loader is None:
        raise ImportError("is no Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def import_error(error: BaseException, origin: str) -> ImportError:
    """The reason why nothing of ``origin`` is there; what ends the import goes on, with a note."""
    line = " ".join(str(error).split())
    sentence = f"cannot be imported: {type(error).__name__}" + (f": {line}" if line else "")
    if isinstance(error, _OUTSIDE):
        error.add_note(f"{origin}: {sentence}")
        raise error
    return ImportError(sentence)
