"""Fixtures of the tests that read records."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.no_plots import no_plots
from tests.own_models import tried_here


@pytest.fixture(autouse=True, scope="package")
def records_without_images() -> Iterator[None]:
    """Record without rendering camera images, which these tests do not look at."""
    with no_plots():
        yield


@pytest.fixture(autouse=True, scope="module")
def models_tried_here() -> Iterator[None]:
    """Most of these tests make the records that they read."""
    with tried_here():
        yield
