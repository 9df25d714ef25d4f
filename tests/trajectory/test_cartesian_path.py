from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose
from bt_dualarm.trajectory.paths import Axes, CartesianPath, circle, line, lissajous, through

TOOL = Pose.from_rpy((0.5, 0.1, 0.7), (0.1, 0.2, 0.3))
YZ: Axes = (np.array((0.0, 1.0, 0.0)), np.array((0.0, 0.0, 1.0)))


def in_plane(path: CartesianPath) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Coordinates along the axes, relative to the tool, of shape (n, 2)."""
    offsets: np.ndarray[tuple[int, int], np.dtype[np.float64]] = (
        path.positions - TOOL.position
    ) @ np.array(YZ).T
    return offsets


def assert_through_waypoints(path: CartesianPath) -> None:
    distance, _ = cKDTree(path.positions).query(path.waypoints)
    assert distance.max() < 1e-12


@given(st.floats(0.01, 0.5), st.integers(8, 40), st.sampled_from([1, -1]))
def test_circle_keeps_its_radius_and_plane(radius: float, waypoints: int, direction: int) -> None:
    path = circle(TOOL, YZ, radius, waypoints=waypoints, direction=direction)
    assert path.closed
    assert len(path.waypoints) == waypoints + 1
    # Error of a periodic cubic spline: h⁴/384 of the fourth derivative, both coordinates.
    allowed = 2 * radius * (2 * math.pi / waypoints) ** 4 / 384
    np.testing.assert_allclose(np.linalg.norm(in_plane(path), axis=1), radius, atol=allowed)
    np.testing.assert_allclose(path.positions[:, 0], TOOL.position[0], atol=1e-12)
    np.testing.assert_array_equal(path.positions[-1], path.positions[0])
    assert_through_waypoints(path)


def test_circle_of_20_waypoints_is_accurate_to_20_um() -> None:
    path = circle(TOOL, YZ, 0.1)
    assert np.abs(np.linalg.norm(in_plane(path), axis=1) - 0.1).max() < 2e-5


def test_circle_around_the_tool_starts_on_the_first_axis() -> None:
    offsets = in_plane(circle(TOOL, YZ, 0.1))
    np.testing.assert_allclose(offsets[0], (0.1, 0.0), atol=1e-12)
    assert offsets[5][1] > 0.0
    assert in_plane(circle(TOOL, YZ, 0.1, direction=-1))[5][1] < 0.0


def test_circle_from_the_tool_starts_at_the_tool() -> None:
    path = circle(TOOL, YZ, 0.1, mode="from")
    assert path.start.distance(TOOL) < 1e-12
    assert path.start.angle(TOOL) < 1e-7


def test_turns_repeat_one_circle_and_multiply_its_length() -> None:
    path = circle(TOOL, YZ, 0.1, turns=3)
    assert path.repeats == 3
    assert path.length == pytest.approx(6 * math.pi * 0.1, rel=1e-3)


def test_half_a_turn_is_an_arc_to_the_opposite_point() -> None:
    path = circle(TOOL, YZ, 0.1, turns=0.5)
    assert not path.closed
    assert path.start.distance(path.end) == pytest.approx(0.2)
    assert np.abs(np.linalg.norm(in_plane(path), axis=1) - 0.1).max() < 1e-4


def test_arc_starts_at_the_given_angle() -> None:
    """A quarter turn from the second axis to the negative or, reversed, positive first one."""
    offsets = in_plane(circle(TOOL, YZ, 0.1, turns=0.25, begin=math.pi / 2))
    np.testing.assert_allclose(offsets[0], (0.0, 0.1), atol=1e-12)
    np.testing.assert_allclose(offsets[-1], (-0.1, 0.0), atol=1e-12)
    reversed_arc = in_plane(circle(TOOL, YZ, 0.1, turns=0.25, begin=math.pi / 2, direction=-1))
    np.testing.assert_allclose(reversed_arc[-1], (0.1, 0.0), atol=1e-12)


@pytest.mark.parametrize("repeats", [0.25, 0.5, 1.3])
def test_part_of_a_lissajous_curve_is_open(repeats: float) -> None:
    path = lissajous(TOOL, YZ, (0.1, 0.05), (1, 2), phase=0.4, repeats=repeats, waypoints=60)
    assert not path.closed
    t = np.linspace(0.0, 2 * math.pi * repeats, len(path.positions))
    expected = np.column_stack((0.1 * np.sin(t + 0.4), 0.05 * np.sin(2 * t)))
    np.testing.assert_allclose(in_plane(path), expected, atol=5e-5)


def test_tilt_is_proportional_to_the_distance_from_the_center() -> None:
    """It is zero where the curve passes through its center."""
    tool = Pose.from_rpy((0, 0, 0), (0, math.pi / 2, 0))  # looks along x, the curve in YZ
    path = lissajous(tool, YZ, (0.1, 0.1), (1, 2), tilt=0.3)
    distance = np.linalg.norm(path.positions, axis=1)
    farthest = np.linalg.norm(path.waypoints, axis=1).max()
    tilt = [pose.angle(tool) for pose in path.poses]
    np.testing.assert_allclose(tilt, 0.3 * distance / farthest, atol=1e-6)
    inward = [pose.rotation_matrix[:, 2] @ pose.position for pose in path.poses]
    assert np.all(np.array(inward)[distance > 0.01] < 0.0)


@given(
    st.sampled_from([(1, 2), (1, 1), (3, 2), (2, 4)]),
    st.floats(0.0, 2 * math.pi),
    st.sampled_from(["around", "from"]),
)
def test_lissajous_curve_follows_its_formula(
    frequencies: tuple[int, int], phase: float, mode: str
) -> None:
    count = 80
    path = lissajous(
        TOOL,
        YZ,
        (0.1, 0.05),
        frequencies,
        phase=phase,
        mode="from" if mode == "from" else "around",
        waypoints=count,
    )
    divisor = math.gcd(*frequencies)
    a = frequencies[0] // divisor
    b = frequencies[1] // divisor
    t = np.linspace(0.0, 2 * math.pi, len(path.positions))
    expected = np.column_stack((0.1 * np.sin(a * t + phase), 0.05 * np.sin(b * t)))
    if mode == "from":
        expected -= expected[0]
    np.testing.assert_allclose(in_plane(path), expected, atol=2e-5)
    assert path.closed
    assert_through_waypoints(path)


def test_line_is_straight_and_rotates_evenly() -> None:
    end = TOOL @ Pose.from_rpy((0.0, 0.3, 0.4), (0.0, 0.0, 1.0))
    path = line(TOOL, end)
    assert path.length == pytest.approx(0.5)
    assert path.start.distance(TOOL) < 1e-12
    assert path.end.angle(end) < 1e-7
    turns = [one.angle(two) for one, two in zip(path.poses, path.poses[1:], strict=False)]
    np.testing.assert_allclose(turns, turns[0], rtol=1e-6)


@pytest.mark.parametrize("closed", [True, False])
def test_spline_passes_through_its_poses(closed: bool) -> None:
    poses = [
        TOOL @ Pose.from_rpy(xyz, (0.0, 0.0, xyz[0]))
        for xyz in ((0.0, 0.0, 0.0), (0.2, 0.0, 0.0), (0.2, 0.1, 0.0), (0.0, 0.1, 0.3))
    ]
    path = through(poses, closed=closed)
    assert_through_waypoints(path)
    assert path.start.distance(poses[0]) < 1e-12
    assert path.end.angle(poses[0] if closed else poses[-1]) < 1e-7
    assert len(path.waypoints) == len(poses) + closed


@pytest.mark.parametrize(
    ("numbers", "reason"),
    [
        ({"radius": 0.0}, "radius"),
        ({"radius": math.nan}, "radius"),
        ({"radius": 0.1, "turns": 0.0}, "turns"),
        ({"radius": 0.1, "waypoints": 3}, "4 waypoints"),
        ({"radius": 0.1, "direction": 2}, "direction"),
    ],
)
def test_invalid_circle_is_refused(numbers: dict[str, float], reason: str) -> None:
    with pytest.raises(Failure, match=reason) as caught:
        circle(TOOL, YZ, **numbers)  # type: ignore[arg-type]
    assert caught.value.code == "INVALID_TARGET"


def test_axes_that_span_no_plane_are_refused() -> None:
    with pytest.raises(Failure, match="orthogonal"):
        circle(TOOL, (YZ[0], YZ[0]), 0.1)


def test_invalid_lissajous_curve_is_refused() -> None:
    with pytest.raises(Failure, match="frequencies"):
        lissajous(TOOL, YZ, (0.1, 0.1), (0, 1))
    with pytest.raises(Failure, match="amplitude"):
        lissajous(TOOL, YZ, (0.0, 0.0), (1, 2))
    with pytest.raises(Failure, match="repeats"):
        lissajous(TOOL, YZ, (0.1, 0.1), (1, 2), repeats=0.0)


def test_path_through_fewer_than_two_positions_is_refused() -> None:
    with pytest.raises(Failure, match="two poses"):
        through([TOOL])
    with pytest.raises(Failure, match="same place"):
        through([TOOL, TOOL])
