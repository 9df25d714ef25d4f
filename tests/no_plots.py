"""Records without plots, for tests that do not use them: plots take half of the time of a run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

BT_RUN_NO_PLOTS = """
import sys
from bt_dualarm.cli import run
from bt_dualarm.runtime import plots
plots.files_of = lambda *_: iter(())
sys.exit(run())
"""
"""Program for ``python -c`` that is ``bt-run`` without plots."""


@contextmanager
def no_plots() -> Iterator[None]:
    """Within the context, this process draws no plots.

    tests/runtime/test_record.py and tests/test_trees.py check that they are drawn otherwise.
    """
    from bt_dualarm.runtime import plots

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plots, "files_of", lambda *_: iter(()))
        yield
