"""Compiled kernels of timing agree with plain Python and with NumPy."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys

import numpy as np
import pytest

from bt_dualarm.core.pose import Matrix
from bt_dualarm.trajectory.kernel_arrays import Parabolas
from bt_dualarm.trajectory.path_timing import (
    AveragedMotion,
    StretchedMotion,
    TimeOptimal,
    spline_through,
)
from bt_dualarm.trajectory.trajectory import shares_of_limits
from bt_dualarm.trajectory.trajectory_kernels import write_average, write_joints, write_shares
from tests.source import ROOT
from tests.trajectory.timed import LIMITS, timed

SEEDS = range(4)
STEP = 0.004


def test_compiled_kernels_agree_with_plain_python() -> None:
    command = [sys.executable, "-m", "tests.trajectory.timed", *map(str, SEEDS)]
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    for seed, theirs in zip(SEEDS, pickle.loads(done.stdout), strict=True):  # noqa: S301
        for mine, kind in zip(timed(seed), theirs, strict=True):
            assert mine == pytest.approx(kind, abs=1e-9)


def motion_of(seed: int, width: float, closed: bool) -> AveragedMotion:
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 2.0 * np.pi, 20)[:, None]
    path = spline_through(0.3 * np.sin(t + rng.uniform(0.0, 6.0, 3)), LIMITS, closed)
    return AveragedMotion(path, TimeOptimal(path, LIMITS).fastest, width)


def evaluated(motion: AveragedMotion, most: float) -> tuple[Matrix, Matrix, int]:
    """Path states of a motion, used fractions of the limits, and the number of evaluated steps."""
    path = motion.path
    profile = motion.profile
    parabolas = Parabolas(profile.time, profile.place, profile.rate, *profile.pieces)
    states = np.empty((3, len(StretchedMotion(motion, STEP, 1.0))))
    fractions = np.empty_like(states)
    limits = np.array((LIMITS.velocity, LIMITS.acceleration, LIMITS.jerk))
    v, a = np.empty((2, states.shape[1], 3))
    write_average(parabolas, motion.width, STEP, states)
    write_joints(path, states, v, a)
    return states, fractions, write_shares(v, a, STEP, limits, most, fractions)


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize("width", [STEP, 0.1, 3.0])
@pytest.mark.parametrize("seed", SEEDS)
def test_used_fractions_of_limits_are_those_of_the_set_points(
    seed: int, width: float, closed: bool
) -> None:
    """Even if the averaging window is wider than the motion."""
    motion = motion_of(seed, width, closed)
    states, fractions, count = evaluated(motion, np.inf)
    times = np.minimum(np.arange(count) * STEP, motion.unstretched)
    assert count == states.shape[1]
    for mine, theirs in zip(states, motion.profile.smoothed(times, width), strict=True):
        assert mine == pytest.approx(theirs, abs=1e-9)
    whole = StretchedMotion(motion, STEP, 1.0).whole()
    assert fractions == pytest.approx(np.array(shares_of_limits(whole, LIMITS)), rel=1e-6, abs=1e-6)


def test_evaluation_stops_at_the_first_violation() -> None:
    """Evaluated steps are the same, and the last one is the first violation."""
    motion = motion_of(0, 0.05, closed=False)
    _, whole, count = evaluated(motion, np.inf)
    needed = np.maximum(np.maximum(whole[0], np.sqrt(whole[1])), np.cbrt(whole[2]))
    most = 0.9 * float(needed.max())
    _, fractions, stopped = evaluated(motion, most)
    assert stopped == int(np.argmax(needed > most)) + 1 < count
    assert (fractions[:, :stopped] == whole[:, :stopped]).all()
