"""Reservations of an arm: others know them as long as the controller that made them exists."""

from __future__ import annotations

import numpy as np

from bt_dualarm.control.controller import JointController
from bt_dualarm.safety.failsafe import Reservation, Reservations
from tests.sim.worlds import world_with

PERIOD = 0.004


def reserved(count: int) -> Reservation:
    """Set-points 0, 1, 2, … of one joint, from one second on."""
    q = np.arange(count, dtype=np.float64)[:, None]
    return Reservation(1.0, PERIOD, q, 0.0, 0.0, np.zeros((0, 4)), 0)


def test_rows_are_those_of_their_time_and_the_last_one_stays() -> None:
    one = reserved(5)
    assert one.rows(1.0 + 2 * PERIOD, 6)[:, 0].tolist() == [2, 3, 4, 4, 4, 4]
    assert one.rows(0.5, 2)[:, 0].tolist() == [0, 1]
    assert [one.left(1.0 + late * PERIOD) for late in (0, 3, 4, 99)] == [5, 2, 1, 1]


def test_a_new_controller_discards_the_reservation_of_an_earlier_one() -> None:
    """An arm that was removed and is spawned again is not where it was."""
    reservations = Reservations()
    reservations.publish("arm1", reserved(3))
    JointController(world_with("ur5"), "arm1", PERIOD, reservations)
    assert reservations.of("arm1") is None
