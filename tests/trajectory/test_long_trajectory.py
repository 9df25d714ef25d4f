"""What a motion takes in memory does not depend on how long it lasts, nor do its set-points."""

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
    """All joints turn evenly."""
    return point_to_point(start, start + 0.3, limits, DT)


def wave(start: np.ndarray, limits: JointLimits) -> Trajectory:
    """A smooth path."""
    turn = np.linspace(0.0, np.pi, 40)[:, None]
    return time_path(start + 0.2 * np.sin(turn * np.linspace(1, 2, len(start))), limits, DT)


def loop(start: np.ndarray, limits: JointLimits) -> Trajectory:
    """A path that ends where it begins."""
    turn = np.linspace(0.0, 2 * np.pi, 60)[:, None]
    shifts = np.linspace(0, 1, len(start))
    return time_path(
        start + 0.2 * (np.sin(turn + shifts) - np.sin(shifts)), limits, DT, closed=True
    )


def slower(start: np.ndarray, limits: JointLimits) -> Trajectory:
    """What a load has slowed."""
    return at_scale(wave(start, limits), 0.37)


def corners(start: np.ndarray, limits: JointLimits) -> Trajectory:
    """There and back: a stop in between."""
    ways = np.concatenate((np.linspace(0, 0.2, 12), np.linspace(0.19, 0, 12)))[:, None]
    return time_path(start + ways, limits, DT)


def slowed(name: str, share: float) -> JointLimits:
    """Limits that are only a share of the robot's, however small."""
    limits = load_robot(name).limits
    kinds = {kind: share * getattr(limits, kind) for kind in ("velocity", "acceleration", "jerk")}
    return replace(limits, **kinds)


MOTIONS: tuple[Motion, ...] = (straight, wave, loop, corners, slower)


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("name", ROBOTS)
def test_set_points_that_are_worked_out_late_are_the_same_to_the_bit(
    name: str, motion: Motion, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One by one, by the piece and by their numbers, also on the other side of a pipe."""
    robot = load_robot(name)
    limits = robot.limits.scaled(0.3)
    whole = motion(robot.postures["home"], limits)
    assert type(whole) is Trajectory
    monkeypatch.setattr(trajectory, "LONG", 16)
    monkeypatch.setattr(trajectory, "_BLOCK", 50)
    made = motion(robot.postures["home"], limits)
    assert isinstance(made, LongTrajectory)
    for late in (made, pickle.loads(pickle.dumps(made))):  # noqa: S301 - our own
        assert len(late) == len(whole)
        for kind in ("q", "v", "a"):
            assert np.array_equal(getattr(late, kind), getattr(whole, kind)), kind
        for i in (0, len(whole) - 1, len(whole) // 2, len(whole) // 2 + 1, 3):
            assert all(map(np.array_equal, late.set_point(i), whole.set_point(i)))
        times = np.sort(np.random.default_rng(0).uniform(-0.1, whole.duration + 0.1, 70))
        places = np.column_stack((times, np.full(70, 0.7), np.full(70, 0.1)))
        slower = sampled_at(late, places), sampled_at(whole, places)
        assert all(np.array_equal(*(getattr(one, kind) for one in slower)) for kind in "qva")
        at = float(times[30])
        assert all(map(np.array_equal, late.at(at), whole.at(at)))
    assert np.array_equal(made.start, whole.q[0])
    assert np.array_equal(made.end, whole.q[-1])
    twice = made.then(straight(whole.end, limits))
    assert np.array_equal(twice.q[: len(whole)], whole.q)
    assert twice.end == pytest.approx(whole.end + 0.3)


@pytest.mark.parametrize("motion", MOTIONS)
def test_memory_does_not_depend_on_the_length(motion: Motion) -> None:
    """From minutes to days, planned, checked against obstacles and gone through in part."""
    robot = load_robot("ur5")
    radii = np.full(6, 0.8)
    lengths = []
    peaks = []
    for speed in (1e-3, 1e-6):
        tracemalloc.start()
        made = motion(robot.postures["home"], slowed("ur5", speed))
        outline(made, radii, 0.005)
        for i in range(len(made) // 2, len(made) // 2 + 3000):
            made.set_point(i)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        lengths.append(len(made))
    assert lengths[0] > LONG
    assert lengths[-1] > 300 * lengths[0]
    assert max(peaks) < 40e6
    assert peaks[-1] < 1.5 * peaks[0]


@settings(max_examples=12, deadline=None)
@given(
    st.sampled_from(MOTIONS), st.sampled_from(ROBOTS), st.floats(-6.0, -2.0), st.floats(0.0, 1.0)
)
def test_a_long_motion_keeps_its_limits_wherever_one_looks(
    motion: Motion, name: str, exponent: float, place: float
) -> None:
    """Up to the rounding of its own clock: after weeks a step is a difference of large times."""
    robot = load_robot(name)
    limits = slowed(name, 10.0**exponent)
    made = motion(robot.postures["home"], limits)
    last = len(made) - 1
    most = 1.0 + 1e-9 + float(np.spacing(made.duration)) / DT
    for first in (0, round(place * last), max(last - 2000, 0)):
        piece = made.piece(first, min(first + 2000, len(made)))
        use = use_of_limits(piece, limits)
        assert max(use.velocity, use.acceleration, use.jerk) <= most
        assert use.position_margin >= 0.0
    for rest in (made.set_point(0), made.set_point(last)):
        assert not rest[1].any()
        assert not rest[2].any()


@pytest.mark.parametrize("motion", MOTIONS)
def test_an_outline_leaves_no_room_between_two_configurations(motion: Motion) -> None:
    robot = load_robot("panda")
    radii = np.linspace(1.0, 0.1, 7)
    made = motion(robot.postures["home"], slowed("panda", 1e-4))
    rows = outline(made, radii, 0.0002)
    assert len(rows) > LONG, "those that are too far apart are to be parted"
    assert (np.abs(np.diff(rows, axis=0)) @ radii).max() <= 0.0001
    assert np.array_equal(rows[[0, -1]], [made.start, made.end])
