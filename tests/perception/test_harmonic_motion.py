"""Harmonic motion: periodic motion is detected and predicted, other motion is rejected."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.perception.harmonic_motion import fit_harmonic

NOISE_M = 1e-4


def seen(path: Matrix, seed: int = 0) -> Matrix:
    """Sightings of a path, with the noise of a camera."""
    sighted: Matrix = path + np.random.default_rng(seed).normal(0.0, NOISE_M, path.shape)
    return sighted


def times(duration: float, fps: float = 60.0) -> Vector:
    return np.arange(round(duration * fps)) / fps


def ellipse(t: Vector, w: float) -> Matrix:
    return np.column_stack((0.3 + 0.08 * np.cos(w * t), 0.05 * np.sin(w * t + 0.3), 0.2 + 0 * t))


def test_an_ellipse_is_predicted_for_a_second() -> None:
    w = 4.0
    t = times(1.5)
    motion = fit_harmonic(t, seen(ellipse(t, w)))
    assert motion is not None
    assert motion.frequency == pytest.approx(w, rel=0.01)
    later = t[-1] + np.array((0.0, 0.5, 1.0))
    step = 1e-4
    for time in later:
        position, velocity, acceleration = motion.predict(time)
        around = ellipse(time + np.array((-step, 0.0, step)), w)
        np.testing.assert_allclose(position, around[1], atol=1e-3)
        np.testing.assert_allclose(velocity, (around[2] - around[0]) / (2 * step), atol=5e-3)
        bend = (around[2] - 2 * around[1] + around[0]) / step**2
        np.testing.assert_allclose(acceleration, bend, atol=0.03)
    assert motion.doubt(later[2]) > motion.doubt(later[0]) > 0.0


def test_the_expected_state_is_that_of_the_prediction() -> None:
    t = times(1.5)
    motion = fit_harmonic(t, seen(ellipse(t, 4.0)))
    assert motion is not None
    state, spread = motion.expect(t[-1] + 0.3)
    np.testing.assert_array_equal(state[:, :3].T, np.array(motion.predict(t[-1] + 0.3)))
    assert (state[:, 3] == motion.frequency).all()
    assert spread[0] == motion.doubt(t[-1] + 0.3)


def test_rest_before_the_motion_is_ignored() -> None:
    t = times(1.5)
    rested = np.tile(ellipse(t[:1], 4.0), (60, 1))
    path = seen(np.vstack((rested, ellipse(t, 4.0))))
    motion = fit_harmonic(times(2.5), path)
    assert motion is not None
    assert motion.frequency == pytest.approx(4.0, rel=0.01)


@pytest.mark.parametrize(
    "what", ["at rest", "half a period", "straight from rest to rest", "two frequencies", "ramp"]
)
def test_other_motions_are_rejected(what: str) -> None:
    t = times(1.5)
    zero = 0.0 * t
    wave = 0.06 * np.sin(4.0 * t)
    share = np.minimum(t / 1.5, 1.0)
    paths = {
        "at rest": np.column_stack((zero, zero, zero)),
        "half a period": ellipse(t, 2.2),
        "straight from rest to rest": np.column_stack(
            (0.1 * share**3 * (10 - 15 * share + 6 * share**2), zero, zero)
        ),
        "two frequencies": np.column_stack((wave, 0.06 * np.sin(8.0 * t), zero)),
        "ramp": np.column_stack((0.1 * t, zero, zero)),
    }
    assert fit_harmonic(t, seen(paths[what])) is None


def test_an_exact_rest_is_not_harmonic() -> None:
    assert fit_harmonic(times(1.0), np.zeros((60, 3))) is None


def test_one_sighting_is_too_few() -> None:
    assert fit_harmonic(np.zeros(1), np.zeros((1, 3))) is None
