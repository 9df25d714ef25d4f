"""What the tests of all that reads records share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.undrawn import undrawn


@pytest.fixture(autouse=True, scope="package")
def records_without_pictures() -> Iterator[None]:
    """Nothing that reads records looks at their pictures."""
    with undrawn():
        yield
