"""Memory of a motion does not depend on its duration, and set-points are the same if lazy."""

from __future__ import annotations

import pickle
import tracemalloc
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_dualarm.planning.problem import outline
from bt_dualarm.robots.robot import JointLimits
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.trajectory import trajectory
from bt_dualarm.trajectory.path_timing import point_to_point, time_path
from bt_dualarm.trajectory.set_points import at_scale, sampled_at
from bt_dualarm.trajectory.trajectory import LONG, LongTrajectory, Trajectory, use_of_limits

DT = 0.004
ROBOTS = ("ur5", "panda", "xarm7")

Motion = Callable[[np.ndarray, JointLimits], Trajectory]


def straight(start: np.ndarray, limits: JointLimits) -> Trajectory:
    """All joints move by the same angle."""
    return point_to_point(start, start + 0.3, limits, DT)


def wave(start: np.ndarray, limits: JointLimits) -> Trajectory:
    """A smooth path."""
    turn = np.linspace(0.0, np.pi, 40)[:, None]
    return time_path(start + 0.2 * np.sin(turn * np.linspace(1, 2, len(start))), limits, DT)


def loop(start: np.ndarray, limits: JointLimits) -> Trajectory:
    """A closed path."""
    turn = np.linspace(0.0, 2 * np.pi, 60)[:, None]
    shifts = np.linspace(0, 1, len(start))
    return time_path(
        start + 0.2 * (np.sin(turn + shifts) - np.sin(shifts)), limits, DT, closed=True
    )


def slower(start: np.ndarray, limits: JointLimits) -> Trajectory:
    """A motion slowed by a load."""
    return at_scale(wave(start, limits), 0.37)


def corners(start: np.ndarray, limits: JointLimits) -> Trajectory:
    """There and back, with a stop in between."""
    steps = np.concatenate((np.linspace(0, 0.2, 12), np.linspace(0.19, 0, 12)))[:, None]
    return time_path(start + steps, limits, DT)


def slowed(name: str, fraction: float) -> JointLimits:
    """A fraction of the robot's limits, however small."""
    limits = load_robot(name).limits
    kinds = {
        kind: fraction * getattr(limits, kind) for kind in ("velocity", "acceleration", "jerk")
    }
    return replace(limits, **kinds)


MOTIONS: tuple[Motion, ...] = (straight, wave, loop, corners, slower)


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("name", ROBOTS)
def test_lazy_set_points_are_identical_bit_for_bit(
    name: str, motion: Motion, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Individually, in pieces, by index, and after pickling."""
    robot = load_robot(name)
    limits = robot.limits.scaled(0.3)
    whole = motion(robot.postures["home"], limits)
    assert type(whole) is Trajectory
    monkeypatch.setattr(trajectory, "LONG", 16)
    monkeypatch.setattr(trajectory, "_BLOCK", 50)
    planned = motion(robot.postures["home"], limits)
    assert isinstance(planned, LongTrajectory)
    for lazy in (planned, pickle.loads(pickle.dumps(planned))):  # noqa: S301 - our own
        assert len(lazy) == len(whole)
        for kind in ("q", "v", "a"):
            assert np.array_equal(getattr(lazy, kind), getattr(whole, kind)), kind
        for i in (0, len(whole) - 1, len(whole) // 2, len(whole) // 2 + 1, 3):
            assert all(map(np.array_equal, lazy.set_point(i), whole.set_point(i)))
        times = np.sort(np.random.default_rng(0).uniform(-0.1, whole.duration + 0.1, 70))
        parameters = np.column_stack((times, np.full(70, 0.7), np.full(70, 0.1)))
        slower = sampled_at(lazy, parameters), sampled_at(whole, parameters)
        assert all(np.array_equal(*(getattr(one, kind) for one in slower)) for kind in "qva")
        at = float(times[30])
        assert all(map(np.array_equal, lazy.at(at), whole.at(at)))
    assert np.array_equal(planned.start, whole.q[0])
    assert np.array_equal(planned.end, whole.q[-1])
    twice = planned.then(straight(whole.end, limits))
    assert np.array_equal(twice.q[: len(whole)], whole.q)
    assert twice.end == pytest.approx(whole.end + 0.3)


@pytest.mark.parametrize("motion", MOTIONS)
def test_memory_does_not_depend_on_the_duration(motion: Motion) -> None:
    """From minutes to days: planned, outlined for collision checks, and partly executed."""
    robot = load_robot("ur5")
    radii = np.full(6, 0.8)
    lengths = []
    peaks = []
    for speed in (1e-3, 1e-6):
        tracemalloc.start()
        planned = motion(robot.postures["home"], slowed("ur5", speed))
        outline(planned, radii, 0.005)
        for i in range(len(planned) // 2, len(planned) // 2 + 3000):
            planned.set_point(i)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        lengths.append(len(planned))
    assert lengths[0] > LONG
    assert lengths[-1] > 300 * lengths[0]
    assert max(peaks) < 40e6
    assert peaks[-1] < 1.5 * peaks[0]


@settings(max_examples=12, deadline=None)
@given(
    st.sampled_from(MOTIONS), st.sampled_from(ROBOTS), st.floats(-6.0, -2.0), st.floats(0.0, 1.0)
)
def test_long_motion_respects_its_limits_everywhere(
    motion: Motion, name: str, exponent: float, fraction: float
) -> None:
    """Up to the rounding of time: after weeks, a step is a difference of large times."""
    robot = load_robot(name)
    limits = slowed(name, 10.0**exponent)
    planned = motion(robot.postures["home"], limits)
    last = len(planned) - 1
    most = 1.0 + 1e-9 + float(np.spacing(planned.duration)) / DT
    for first in (0, round(fraction * last), max(last - 2000, 0)):
        piece = planned.piece(first, min(first + 2000, len(planned)))
        use = use_of_limits(piece, limits)
        assert max(use.velocity, use.acceleration, use.jerk) <= most
        assert use.position_margin >= 0.0
    for rest in (planned.set_point(0), planned.set_point(last)):
        assert not rest[1].any()
        assert not rest[2].any()


@pytest.mark.parametrize("motion", MOTIONS)
def test_outline_bounds_the_distance_between_configurations(motion: Motion) -> None:
    robot = load_robot("panda")
    radii = np.linspace(1.0, 0.1, 7)
    planned = motion(robot.postures["home"], slowed("panda", 1e-4))
    rows = outline(planned, radii, 0.0002)
    assert len(rows) > LONG, "the test needs refined steps"
    assert (np.abs(np.diff(rows, axis=0)) @ radii).max() <= 0.0001
    assert np.array_equal(rows[[0, -1]], [planned.start, planned.end])
