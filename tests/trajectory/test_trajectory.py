from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.trajectory.trajectory import Trajectory, use_of_limits

DT = 0.01
TIMES = np.linspace(0.0, 1.0, 101)[:, None]


def cubic() -> Trajectory:
    """One joint on q = t² (3 - 2t), at rest at both ends."""
    return Trajectory(DT, TIMES**2 * (3 - 2 * TIMES), 6 * TIMES * (1 - TIMES), 6 - 12 * TIMES)


@pytest.mark.parametrize("time", [0.0, 0.01, 0.0137, 0.5, 0.777, 0.999, 1.0])
def test_cubic_is_exact_between_set_points(time: float) -> None:
    q, v, a = cubic().at(time)
    assert q[0] == pytest.approx(time**2 * (3 - 2 * time), abs=1e-12)
    assert v[0] == pytest.approx(6 * time * (1 - time), abs=2e-4)  # linear: h² |v''| / 8
    assert a[0] == pytest.approx(6 - 12 * time)


def test_trajectory_is_constant_before_and_after_its_ends() -> None:
    assert cubic().at(-1.0)[0][0] == 0.0
    assert cubic().at(9.0)[0][0] == pytest.approx(1.0)


def test_duration_counts_the_steps_between_set_points() -> None:
    assert cubic().duration == pytest.approx(1.0)
    assert Trajectory.rest(np.zeros(6), DT).duration == 0.0


def test_consecutive_motions_share_the_set_point_between_them() -> None:
    first = cubic()
    second = Trajectory(DT, first.q + 1.0, first.v, first.a)
    both = first.then(second)
    assert len(both) == 201
    assert both.at(1.5)[0][0] == pytest.approx(1.5)


def test_motion_that_starts_elsewhere_cannot_be_appended() -> None:
    with pytest.raises(ValueError, match="does not start"):
        cubic().then(cubic())
    with pytest.raises(ValueError, match="grids"):
        cubic().then(Trajectory.rest(np.ones(1), 0.02))


def test_rows_of_different_shape_are_refused() -> None:
    with pytest.raises(ValueError, match="shape"):
        Trajectory(DT, np.zeros((3, 6)), np.zeros((3, 6)), np.zeros((2, 6)))


def test_use_of_limits_includes_changes_of_velocity() -> None:
    limits = load_robot("ur5").limits
    v = np.zeros((3, 6))
    v[1, 0] = limits.acceleration[0] * DT * 2.0  # twice the limit, though a says zero
    use = use_of_limits(Trajectory(DT, np.zeros((3, 6)), v, np.zeros((3, 6))), limits)
    assert use.acceleration == pytest.approx(2.0)
    assert not use.within
