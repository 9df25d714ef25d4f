"""Models in records that the tests have made themselves, tried in their own process."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import pytest

from bt_dualarm.replay import stored_model
from bt_dualarm.replay.stored_model import Vector


@contextmanager
def tried_here() -> Iterator[None]:
    """No process is started meanwhile to try models of records: each takes 0.3 s to start.

    They are loaded, checked and used all the same. That a model which is not the tests' own harms
    nobody is for tests/replay/test_stored_model.py, tests/fuzz/test_records.py and tests/docs/.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stored_model, "_spawned", lambda trials: [_tried(*one) for one in trials])
        yield


def _tried(content: bytes, states: Sequence[Vector]) -> str:
    """As `_tried` of stored_model.py, without the limits that would stay with this process."""
    model = stored_model._loaded(content)
    complaint = stored_model.complaint_about(model)
    if not complaint:
        stored_model._use(model, states)
    return complaint
