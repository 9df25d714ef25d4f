"""The observer estimates velocity and disturbance of joints from positions alone."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.control.computed_torque import StateObserver
from bt_dualarm.control.dynamics import DRIVE_DELAY_S, control_law
from bt_dualarm.control.kernel_rows import MODEL_A, MODEL_A_BEFORE, STATE
from bt_dualarm.core.pose import Vector

PERIOD = 0.004
STEP = 0.002


class Joints:
    """Double integrators as MuJoCo steps them, with the drive delay that the observer assumes."""

    def __init__(self, push: Vector) -> None:
        self.q, self.v = np.zeros((2, len(push)))
        self.push = push
        self._before = np.zeros(len(push))

    def step(self, commanded: Vector) -> None:
        late = DRIVE_DELAY_S / PERIOD
        a = commanded + late * (self._before - commanded) + self.push
        self._before = commanded
        for _ in range(round(PERIOD / STEP)):
            self.v = self.v + STEP * a
            self.q = self.q + STEP * self.v


def watched(push: Vector, noise: float, seconds: float) -> tuple[StateObserver, Joints, Vector]:
    """The observer after a motion of joints, the joints, and the errors of its velocities."""
    rng = np.random.default_rng(4)
    joints = Joints(push)
    law = control_law(PERIOD, STEP, np.zeros(3))
    state = np.zeros((STATE, len(push)))
    observer = StateObserver(law, state, joints.q)
    errors = []
    for k in range(round(seconds / PERIOD)):
        observer.read(joints.q + rng.normal(0.0, noise, len(push)))
        errors.append(observer.v - joints.v)
        commanded = 5.0 * np.sin(8.0 * k * PERIOD) * np.ones(len(push))
        state[MODEL_A_BEFORE] = state[MODEL_A]
        state[MODEL_A] = commanded
        joints.step(commanded)
    return observer, joints, np.array(errors)


def test_estimate_is_exact_for_joints_that_follow_the_model() -> None:
    """Commands cause no estimated disturbance, and the velocity does not lag."""
    observer, _, errors = watched(np.zeros(3), 0.0, 1.0)
    assert np.abs(errors).max() < 1e-9
    assert np.abs(observer.disturbance).max() < 1e-6


@pytest.mark.parametrize("push", [-40.0, 0.3, 7.0])
def test_push_is_found_within_40_ms(push: float) -> None:
    observer, _, errors = watched(np.array([push, 0.0]), 0.0, 0.04)
    assert observer.disturbance[0] == pytest.approx(push, rel=0.02)
    assert abs(errors[-1, 0]) < 1e-3 * abs(push)
    assert abs(observer.disturbance[1]) < 1e-6


def test_encoder_noise_is_filtered() -> None:
    """The noise of the velocity is less than that of differences of readings, without their lag."""
    noise = 2e-5
    _, _, errors = watched(np.zeros(6), noise, 2.0)
    assert errors[50:].std() < 0.95 * np.sqrt(2) * noise / PERIOD
