"""What Ruckig says of one time after the other, all at once."""

from __future__ import annotations

import numpy as np
import ruckig

from bt_dualarm.motion.timing.ruckig_solver import answer, states_of


def motion_of(rng: np.random.Generator, number: int) -> ruckig.Trajectory:
    """Of one joint: to rest at a place, in a time that is given now and then, or to a speed."""
    request = ruckig.InputParameter(1)
    request.current_position, request.target_position = [rng.uniform(-1, 1)], [1.0]
    request.max_velocity, request.max_acceleration = (10 ** rng.uniform(-1.0, 2.0, (2, 1))).tolist()
    if number % 3 == 0:
        request.minimum_duration = rng.uniform(0.1, 10.0)
    if number % 3 == 1:
        request.control_interface = ruckig.ControlInterface.Velocity
        request.current_velocity, request.target_velocity = [rng.uniform()], [rng.uniform()]
    return answer(request, 10 ** rng.uniform(-1.0, 3.0, 1))


def test_all_at_once_are_the_same_to_the_last_bit() -> None:
    """From the first time to that of the end, which is there twice."""
    rng = np.random.default_rng(7)
    for number in range(300):
        motion = motion_of(rng, number)
        times = np.append(np.linspace(0.0, motion.duration, 40), motion.duration)
        one_by_one = np.array([motion.at_time(time) for time in times.tolist()])[:, :, 0]
        np.testing.assert_array_equal(states_of(motion, times), one_by_one)
