"""Fixtures shared by the tests of browser views."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.own_models import tried_here
from tests.undrawn import undrawn


@pytest.fixture(autouse=True, scope="package")
def records_without_pictures() -> Iterator[None]:
    """Record without plots, which the browser views do not use."""
    with undrawn():
        yield


@pytest.fixture(autouse=True, scope="package")
def models_tried_here() -> Iterator[None]:
    """The records that a browser shows are the tests' own."""
    with tried_here():
        yield
