"""What the tests of all that shows runs in a browser share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.undrawn import undrawn


@pytest.fixture(autouse=True, scope="package")
def records_without_pictures() -> Iterator[None]:
    """A browser is shown what is in a record's numbers, not the pictures beside them."""
    with undrawn():
        yield
