"""What the tests of all that reads records share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from bt_dualarm.runtime import pictures


@pytest.fixture(autouse=True, scope="package")
def records_without_pictures() -> Iterator[None]:
    """Nothing that reads records looks at their pictures, and to draw them takes half of a run.

    That they are drawn is for tests/runtime/test_record.py and tests/test_trees.py.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pictures, "files_of", lambda *_: iter(()))
        yield
