"""What theory allows: the smallest error that a camera of this rate, latency and noise permits."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from bt_dualarm.experiments.cases import Cell
from bt_dualarm.experiments.trial import Trial
from bt_dualarm.vision.estimate import TargetEstimate
from bt_dualarm.vision.motion_model import MotionModel

_ASKED_A_FRAME = 4
_REST_S = 0.5  # that the filter has seen before the curve begins


def bound(cell: Cell, trial: Trial) -> float:
    """Root mean square error in m below which this controller cannot come on this curve."""
    if cell.controller == "proportional":
        return proportional_bound(trial.speed_rms, cell)
    return estimator_bound(trial, cell)


def proportional_bound(speed: float, cell: Cell) -> float:
    """``v / k`` at the highest gain k that is stable at all.

    On a ramp of speed v the error of ``x' = -k e(t - d)`` comes to rest at v / k, and the loop
    is stable up to k = π / 2d; without overshoot k ends at 1 / (e d), and the error at 2.7 v d.
    The delay d is the latency and, as a step is held for a frame, half a frame.
    """
    delay = cell.latency_s + 0.5 / cell.fps
    return 2.0 / np.pi * speed * delay


def estimator_bound(trial: Trial, cell: Cell, model: MotionModel | None = None) -> float:
    """The filter's error where camera and arm are perfect: true positions plus white noise.

    The true path, with the rest before it, is sampled at the camera's rate with the measured
    deviation of a sighting; each sample is known one latency later, and the prediction to now
    compared with the truth.
    """
    rng = np.random.default_rng(trial.seed)
    spline = CubicSpline(trial.times, trial.cube)
    begin, end = trial.times[0], trial.times[-1]
    estimate, errors = TargetEstimate(model), []
    for stamp in np.arange(begin - _REST_S, end, 1.0 / cell.fps):
        if rng.random() < cell.drop:
            continue
        seen = spline(max(stamp, begin)) + rng.normal(0.0, trial.sighting_sd, 2)
        estimate.update(float(stamp), seen, max(trial.sighting_sd, 1e-6))
        for share in range(_ASKED_A_FRAME):
            now = stamp + cell.latency_s + share / _ASKED_A_FRAME / cell.fps
            if begin <= now <= end:
                errors.append(estimate.predict(now).position - spline(now))
    return float(np.sqrt(np.mean(np.sum(np.square(errors), axis=1)))) if errors else 0.0
