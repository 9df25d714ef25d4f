"""Fixtures shared by the tests of browser views."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.no_plots import no_plots
from tests.own_models import tried_here


@pytest.fixture(autouse=True, scope="package")
def records_without_plots() -> Iterator[None]:
    """Record without plots, which the browser views do not use."""
    with no_plots():
        yield


@pytest.fixture(autouse=True, scope="package")
def models_tried_here() -> Iterator[None]:
    """The records that a browser shows are the tests' own."""
    with tried_here():
        yield
