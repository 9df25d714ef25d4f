"""Recorded samples are valid, and can be plotted, or are refused at the call with a message."""

from __future__ import annotations

import io
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from matplotlib.backends.backend_agg import FigureCanvasAgg

from bt_dualarm.core.errors import SkillError
from bt_dualarm.runtime.outcome import SeriesLog
from bt_dualarm.runtime.plots import in_plane, over_time
from bt_dualarm.skill.skill import Samples
from tests.families import some

NAMES = st.sampled_from(["planned", "executed", "target", "error_m", "error", "m", "_", "ü\n_m"])
NUMBERS = st.floats(-1e6, 1e6) | st.sampled_from([float("nan"), float("inf"), 0.0, 1e300, -1e-300])
SHAPES = st.sampled_from(
    [(), (0,), (1,), (3,), (4,), (0, 3), (1, 3), (3, 1), (3, 3), (4, 3), (4, 2), (2, 4, 3)]
)
ODD: st.SearchStrategy[Any] = st.sampled_from(
    [None, "1.0", "soon", b"x", {}, [[1.0], [1.0, 2.0]], [None], object(), 1j, [1, "two"], True]
)
GIVEN = SHAPES.flatmap(lambda shape: arrays.arrays(float, shape, elements=NUMBERS)) | ODD
"""Arrays of many shapes, some of them with non-finite numbers, and values of other types."""


@given(NAMES | st.just("") | ODD, GIVEN, GIVEN)
def test_samples_are_valid_or_refused(name: Any, time: Any, values: Any) -> None:
    """No other exception is raised, and kept samples are finite and in order of time."""
    try:
        samples = Samples.of(name, time, values)
    except SkillError:
        return
    assert samples.values.shape == (len(samples.time), 3) or samples.values.shape[1:] == (1,)
    assert np.isfinite(samples.time).all()
    assert np.isfinite(samples.values).all()
    assert (np.diff(samples.time) > -1e-8).all()


FITTING = [
    (0.5, 1.0, (1, 1)),
    (0.5, [1, 2, 3], (1, 3)),
    ([0.5], 2, (1, 1)),
    ([0.1, 0.2], [1.0, 2.0], (2, 1)),
    ([0.1, 0.2], np.zeros((2, 3)), (2, 3)),
    (np.arange(3), np.arange(3), (3, 1)),
    ([], [], (0, 1)),
    ([], np.zeros((0, 3)), (0, 3)),
]


@pytest.mark.parametrize(("time", "values", "shape"), FITTING)
def test_scalars_and_points_are_accepted_alone_and_in_rows(
    time: Any, values: Any, shape: Any
) -> None:
    assert Samples.of("error_m", time, values).values.shape == shape


MISFITS = [
    (0.1, "far", "not numbers"),
    (0.1, float("nan"), "finite"),
    (float("inf"), 1.0, "finite"),
    ([0.1, 0.2, 0.3], np.zeros(9), r"shape \(9,\) at 3 times"),
    ([0.1, 0.2], np.zeros((3, 3)), r"shape \(3, 3\) at 2 times"),
    ([0.1, 0.2], np.zeros((2, 2)), r"shape \(2, 2\)"),
    ([0.2, 0.1], [1.0, 2.0], "decrease"),
    ([], [1.0], r"shape \(1,\) at 0 times"),
    ([[0.1], [0.2]], [1.0, 2.0], "times are of shape"),
]


@pytest.mark.parametrize(("time", "values", "message"), MISFITS)
def test_invalid_samples_are_refused_with_a_message(time: Any, values: Any, message: str) -> None:
    with pytest.raises(SkillError, match=message) as caught:
        Samples.of("planned", time, values)
    assert str(caught.value).startswith("record('planned')")


def test_series_keeps_its_order_and_dimension() -> None:
    log = SeriesLog()
    log.add("arm1", "leaf", "planned", 1.0, [0, 0, 0])
    for time, values, message in ((2.0, 1.0, "points, as they were"), (0.5, [0, 0, 0], "1.000 s")):
        with pytest.raises(SkillError, match=message):
            log.add("arm1", "leaf", "planned", time, values)
    log.add("arm1", "leaf", "planned", 2.0, [0, 0, 1])
    assert len(log.of("arm1")["leaf"]["planned"].time) == 2


@pytest.mark.parametrize("seed", some(range(4), 2))
def test_kept_samples_can_be_plotted(seed: int) -> None:
    """No accepted sample can break the plots at the end of a run."""
    rng = np.random.default_rng(seed)
    log = SeriesLog()
    for number in range(10):
        leaf = rng.choice(["draw", "track/x", "a b"])
        name = rng.choice(["planned", "error_m", "m"])
        count = rng.integers(1, 6)
        columns = rng.choice([1, 3])
        values = rng.choice([0.0, 1e-9, 1.0, 1e12]) * rng.normal(size=(count, columns))
        with suppress(SkillError):
            log.add("arm1", str(leaf), str(name), number + np.linspace(0.0, 0.5, count), values)
    leaves = log.of("arm1")
    for figure in (in_plane(leaves, np.zeros(0), {}, "arm1"), over_time(leaves, "arm1")):
        FigureCanvasAgg(figure).print_figure(io.BytesIO())


def test_hundreds_of_series_fit_in_one_plot() -> None:
    """The number of rows of a figure is limited."""
    log = SeriesLog()
    for number in range(300):
        log.add("arm1", "leaf", f"force{number}_N", 0.0, 1.0)
    figure = over_time(log.of("arm1"), "arm1")
    width, height = figure.get_size_inches() * figure.dpi
    assert max(width, height) < 2**16, "the limit of matplotlib"
