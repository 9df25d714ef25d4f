"""Internal wrenches of several arms on one object: those that neither move nor carry it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bt_dualarm.control.internal_wrench import (
    InternalWrenchRegulator,
    crossed,
    internal_wrenches,
    without_load,
)
from bt_dualarm.sim.arm_models import BORNE_GYRATION_M

POINTS = np.array([[-0.5, 0.1, 0.0], [0.5, 0.0, 0.05]])
SHARES = (0.5, 0.5)


def total(points: np.ndarray, wrenches: np.ndarray) -> np.ndarray:
    """Sum of all wrenches about the origin."""
    moments = wrenches[:, 3:] + np.cross(points, wrenches[:, :3])
    return np.concatenate((wrenches[:, :3].sum(axis=0), moments.sum(axis=0)))


def test_opposing_forces_are_wholly_internal() -> None:
    wrenches = np.zeros((2, 6))
    along = (POINTS[1] - POINTS[0]) / np.linalg.norm(POINTS[1] - POINTS[0])
    wrenches[0, :3] = 30.0 * along
    wrenches[1, :3] = -30.0 * along
    np.testing.assert_allclose(internal_wrenches(SHARES, POINTS, wrenches), wrenches, atol=1e-9)


def test_shares_of_a_weight_are_not_internal() -> None:
    shares = (0.3, 0.7)
    wrenches = np.zeros((2, 6))
    wrenches[:, 2] = np.array(shares) * 40.0
    np.testing.assert_allclose(internal_wrenches(shares, POINTS, wrenches), 0.0, atol=1e-9)


def test_internal_wrenches_sum_to_zero() -> None:
    rng = np.random.default_rng(0)
    for count in (2, 3):
        for _ in range(20):
            shares = rng.dirichlet(np.ones(count))
            points = rng.normal(size=(count, 3))
            wrenches = rng.normal(size=(count, 6))
            internal = internal_wrenches(list(shares), points, wrenches)
            np.testing.assert_allclose(total(points, internal), 0.0, atol=1e-9)
            # The remainder has no internal part.
            again = internal_wrenches(list(shares), points, wrenches - internal)
            np.testing.assert_allclose(again, 0.0, atol=1e-9)


def test_opposing_moments_are_internal() -> None:
    wrenches = np.zeros((2, 6))
    wrenches[0, 3] = 4.0
    wrenches[1, 3] = -4.0
    found = internal_wrenches(SHARES, POINTS, wrenches)
    assert np.abs(found[:, 3:]).max() == pytest.approx(4.0)


def test_cross_products_of_rows() -> None:
    first, second = np.random.default_rng(1).normal(size=(2, 5, 3))
    np.testing.assert_allclose(crossed(first, second), np.cross(first, second))


@pytest.mark.parametrize("count", [2, 3])
def test_uncertainties_in_proportion_to_shares_give_the_same_internal_wrenches(count: int) -> None:
    rng = np.random.default_rng(count)
    shares = rng.dirichlet(np.ones(count))
    points = rng.normal(size=(count, 3))
    wrenches = rng.normal(size=(count, 6))
    square = BORNE_GYRATION_M**2
    doubts = np.array([share * np.diag((1, 1, 1, square, square, square)) for share in shares])
    np.testing.assert_allclose(
        without_load(points, wrenches, doubts),
        internal_wrenches(list(shares), points, wrenches),
        atol=1e-9,
    )


def test_measurement_with_less_uncertainty_prevails() -> None:
    """The arms press with 10 N; friction adds 30 N to what the second one measures."""
    along = (POINTS[1] - POINTS[0]) / np.linalg.norm(POINTS[1] - POINTS[0])
    true = np.zeros((2, 6))
    true[0, :3] = 10.0 * along
    true[1, :3] = -10.0 * along
    measured = true.copy()
    measured[1, :3] += 30.0 * along
    doubts = np.array([np.eye(6), 1e4 * np.eye(6)])
    found = without_load(POINTS, measured, doubts)
    np.testing.assert_allclose(total(POINTS, found), 0.0, atol=1e-9)
    np.testing.assert_allclose(found, true, atol=0.02)


def test_support_bears_no_more_than_the_weight() -> None:
    """Of 78 N that an arm feels by its own dry friction, a support of 12 N explains a part."""
    measured = np.zeros((2, 6))
    measured[1, :3] = -78.0, -78.0, -49.0
    doubts = np.array([np.eye(6), 40.0**2 * np.eye(6)])
    likely = without_load(POINTS, measured, doubts, support_n=12.0)
    assert np.linalg.norm(total(POINTS, likely)[:3]) < 12.0
    assert np.linalg.norm(internal_wrenches(SHARES, POINTS, likely)[:, :3], axis=1).max() < 12.0
    # A support that may bear anything explains all of it.
    np.testing.assert_allclose(without_load(POINTS, measured, doubts, 1e9), measured, atol=1e-6)


PERIOD_S = 0.004
STIFFNESS = np.array((8e5, 8e5, 8e5, 2e3, 2e3, 2e3))
"""Growth of an arm's force per displacement, N/m/s, by its disturbance observer, as measured with a
UR10; N m/rad/s for a rotation."""


class PressingArm:
    """An arm whose six joints move its tool along and about the axes of the world.

    It holds the end of a rigid bar at rest. Its disturbance observer is an integrator: the force
    grows as long as the tool is not at its commanded pose.
    """

    def __init__(self, position: np.ndarray) -> None:
        self.position = position
        self.lag = np.zeros(6)
        self.wrench = np.zeros(6)
        self.doubt = np.eye(6)

    def look(self, time: float) -> None:
        """Does nothing: the test sets all measurements."""

    def joint_velocity(self, twist: np.ndarray) -> np.ndarray:
        return twist

    def command(self, correction: np.ndarray, displaced: np.ndarray) -> None:
        """One period with a correction of the commanded pose and a constant displacement."""
        self.lag = -(displaced + correction)
        self.wrench = self.wrench - STIFFNESS * PERIOD_S * self.lag


def pressed(
    displaced: np.ndarray,
) -> tuple[InternalWrenchRegulator, list[PressingArm], list[float]]:
    """Lets two arms, commanded in opposite directions by a twist, hold a bar for a second."""
    arms = [PressingArm(point) for point in POINTS]
    named: dict[str, Any] = {"arm1": arms[0], "arm2": arms[1]}
    parts = {"arm1": slice(0, 6), "arm2": slice(6, 12)}
    shares = dict(zip(parts, SHARES, strict=True))
    regulator = InternalWrenchRegulator(named, shares, parts, PERIOD_S)
    regulator.begin()
    forces = []
    correction = np.zeros(12)
    for _ in range(250):
        correction = correction + PERIOD_S * regulator(0.0)
        arms[0].command(correction[:6], displaced)
        arms[1].command(correction[6:], -displaced)
        forces.append(float(np.linalg.norm(arms[0].wrench[:3])))
    return regulator, arms, forces


def test_regulator_removes_the_displacement_and_the_force() -> None:
    """Two integrators in series would oscillate; the force decreases steadily from its peak."""
    along = np.zeros(6)
    along[:3] = 2e-4 * (POINTS[1] - POINTS[0]) / np.linalg.norm(POINTS[1] - POINTS[0])
    regulator, arms, forces = pressed(along)
    assert np.abs(arms[0].lag).max() < 2e-5
    assert regulator.strain_m < 2e-5
    assert not regulator.is_pressed()
    highest = int(np.argmax(forces))
    assert forces[-1] < 0.3 * forces[highest]
    assert (np.diff(forces[highest:]) < 1e-3).all()


def test_common_lag_of_both_arms_causes_no_correction() -> None:
    """Both tools lag by the same motion of the bar, which is not internal."""
    arms = [PressingArm(point) for point in POINTS]
    turn = np.array((0.1, -0.2, 0.3))
    center = POINTS.mean(axis=0)
    for arm in arms:
        moved = np.array((1e-3, 2e-3, -1e-3)) + 1e-3 * np.cross(turn, arm.position - center)
        arm.lag = np.concatenate((moved, 1e-3 * turn))
    named: dict[str, Any] = {"arm1": arms[0], "arm2": arms[1]}
    parts = {"arm1": slice(0, 6), "arm2": slice(6, 12)}
    regulator = InternalWrenchRegulator(named, {"arm1": 0.5, "arm2": 0.5}, parts, PERIOD_S)
    regulator.begin()
    for _ in range(100):
        assert np.abs(regulator(0.0)).max() < 1e-12
    assert regulator.strain_m < 1e-12
