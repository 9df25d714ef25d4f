"""Records without their pictures, for tests that do not look at them: they take half of a run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

BT_RUN_UNDRAWN = """
import sys
from bt_dualarm.cli import run
from bt_dualarm.runtime import plots
plots.files_of = lambda *_: iter(())
sys.exit(run())
"""
"""What ``python -c`` takes to be ``bt-run`` without pictures."""


@contextmanager
def undrawn() -> Iterator[None]:
    """No picture is drawn meanwhile, by this process.

    That they are drawn is for tests/runtime/test_record.py and tests/test_trees.py.
    """
    from bt_dualarm.runtime import plots

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plots, "files_of", lambda *_: iter(()))
        yield
