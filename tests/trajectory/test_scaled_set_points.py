"""Set-points at a varying time scale: machine code agrees with NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.trajectory.set_points import sampled_at
from bt_dualarm.trajectory.trajectory import Trajectory
from bt_dualarm.trajectory.trajectory_kernels import scale, within
from tests.plain_kernels import plain

DT = 0.004


@pytest.fixture
def rng() -> np.random.Generator:
    """Random generator of these tests."""
    return np.random.default_rng(5)


def test_set_points_lie_on_the_motion_at_their_scale(rng: np.random.Generator) -> None:
    """At any path parameter: q(s), r q'(s), r² q''(s) + r' q'(s); at rest beyond the end."""
    motion = Trajectory(DT, *rng.normal(size=(3, 40, 6)))
    parameters = rng.uniform((-0.01, 0.0, -3.0), (motion.duration + 0.01, 1.0, 3.0), (300, 3))
    parameters[:20, 0] = np.arange(20) * DT  # also on the grid
    rows = sampled_at(motion, parameters)
    for i, (s, rate, change) in enumerate(parameters.tolist()):
        q, v, a = motion.at(s)
        moves = s < motion.duration
        assert rows.q[i] == pytest.approx(q, abs=1e-12)
        assert rows.v[i] == pytest.approx(moves * rate * v, abs=1e-12)
        assert rows.a[i] == pytest.approx(moves * (rate**2 * a + change * v), abs=1e-9)


@pytest.mark.parametrize("broken", [None, "velocity", "acceleration", "change", "jerk", "nan"])
def test_limits_are_checked_for_each_joint(rng: np.random.Generator, broken: str | None) -> None:
    """A motion at the limits passes; one that exceeds any limit does not."""
    limits = np.array((rng.uniform(1, 2, 6), rng.uniform(3, 4, 6), rng.uniform(900, 1000, 6)))
    rows = np.zeros((3, 30, 6))
    i = int(rng.integers(1, 30))
    j = int(rng.integers(6))
    if broken == "velocity":
        rows[1, :, j] = limits[0, j] * 1.001
    elif broken == "acceleration":
        rows[2, :, j] = limits[1, j] * 1.001
    elif broken == "change":
        rows[1, i, j] = limits[1, j] * DT * 1.001
    elif broken == "jerk":
        rows[2, i, j] = limits[2, j] * DT * 1.001
    elif broken == "nan":
        rows[2, i, j] = np.nan
    else:
        rows[1], rows[2] = limits[0], limits[1]
    assert within(rows, DT, 1.0 + 1e-6, limits) is (broken is None)


def test_compiled_kernel_agrees_with_plain_python(rng: np.random.Generator) -> None:
    """Set-points agree up to rounding."""
    q, v, a = rng.normal(size=(3, 12, 4))
    parameters = rng.uniform((0.0, 0.0, -3.0), (0.06, 1.0, 3.0), (50, 3))
    found = np.empty((2, 3, 50, 4))
    scale(q, v, a, 0, 12, DT, parameters, found[0])
    plain(scale)(q, v, a, 0, 12, DT, parameters, found[1])
    assert found[0] == pytest.approx(found[1], rel=1e-12, abs=1e-12)
