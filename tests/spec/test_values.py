"""Value types: friendly notations in, SI out."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from bt_dualarm.spec.node_types import PortModel, port, validated
from bt_dualarm.spec.values import (
    Angle,
    Color,
    Duration,
    HsvRange,
    Plane,
    PlaneOrFree,
    PoseSpec,
    Speed,
)
from bt_dualarm.spec.yaml_reader import read_text


class Ports(PortModel):
    pose: PoseSpec | None = port(None, "A pose")
    angle: Angle = port(90, "An angle", ge=-180, le=180)
    time: Duration = port("500 ms", "A time", le=120)
    speed: Speed = port(1.0, "A speed")
    plane: Plane = port("yz", "A plane")
    space: PlaneOrFree = port("yz", "A plane or space")
    color: Color = port("red", "A color")


def read(**ports: object) -> Ports:
    return validated(Ports, ports)  # type: ignore[return-value]


def test_defaults_are_in_yamls_notation() -> None:
    assert read().angle == pytest.approx(math.pi / 2)
    assert read().time == 0.5


@pytest.mark.parametrize(
    ("given_", "radians"),
    [(180, math.pi), ("90 deg", math.pi / 2), ("1.5 rad", 1.5), ("-45°", -math.pi / 4)],
)
def test_angles(given_: object, radians: float) -> None:
    assert read(angle=given_).angle == pytest.approx(radians)


@pytest.mark.parametrize(
    ("given_", "seconds"), [(2, 2.0), ("250 ms", 0.25), ("1.5min", 90.0), ("2 s", 2.0)]
)
def test_durations(given_: object, seconds: float) -> None:
    assert read(time=given_).time == pytest.approx(seconds)


@pytest.mark.parametrize(
    "bad",
    [
        {"angle": 181}, {"angle": "4 rad"}, {"angle": "1 turn"}, {"angle": True}, {"angle": "ten"},
        {"time": -1}, {"time": "3 min"}, {"time": "1 day"}, {"time": [1]},
        {"speed": 0}, {"speed": 1.01}, {"speed": "1"},
        {"plane": "zy"}, {"plane": {"normal": [0, 0, 0]}}, {"plane": {"normal": [0, 1]}},
        {"plane": "free"}, {"space": "fre"}, {"space": {}}, {"space": {"normal": None}},
        {"space": {"normal": [0, 0, 0]}}, {"space": 3}, {"space": None},
        {"color": "pink"}, {"color": []}, {"color": [{"hue": [0, 361]}]}, {"color": 3},
        {"color": [{"hue": [0, 10], "value": [1, 0]}]},
        {"pose": {}}, {"pose": {"xyz": [0, 0]}}, {"pose": {"xyz": [0, 0, "0"]}},
        {"pose": {"xyz": [0, 0, 0], "rpy": [0, 0, 0], "quat": [1, 0, 0, 0]}},
        {"pose": {"xyz": [0, 0, 0], "quat": [0, 0, 0, 0]}},
        {"pose": {"xyz": [0, 0, 0], "look_at": [0, 0, 0]}},
    ],
)  # fmt: skip
def test_invalid_values_are_refused(bad: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        read(**bad)


def test_pose_notations_agree() -> None:
    """A quarter turn about z in two notations."""
    by_rpy = PoseSpec(xyz=(1, 2, 3), rpy=(0, 0, 90)).pose
    half = math.sqrt(0.5)
    by_quat = PoseSpec(xyz=(1, 2, 3), quat=(half, 0, 0, half)).pose
    assert by_rpy.angle(by_quat) < 1e-9
    assert by_rpy.apply(np.array([1.0, 0, 0])) == pytest.approx([1, 3, 3])


coordinates = st.floats(-2, 2, allow_nan=False)
points = st.tuples(coordinates, coordinates, coordinates)


@given(
    st.tuples(coordinates, coordinates, coordinates),
    st.tuples(coordinates, coordinates, coordinates),
)
def test_look_at_points_z_to_the_target(
    eye: tuple[float, float, float], target: tuple[float, float, float]
) -> None:
    """z runs through the target; x is horizontal; the frame is right-handed."""
    if math.dist(eye, target) < 1e-3:
        return
    pose = PoseSpec(xyz=eye, look_at=target).pose
    matrix = pose.matrix[:3, :3]
    distance = math.dist(eye, target)
    assert pose.apply(np.array([0, 0, distance])) == pytest.approx(target, abs=1e-6)
    assert abs(matrix[2, 0]) < 1e-6
    assert np.linalg.det(matrix) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("notation", "u", "v"),
    [("xy", (1, 0, 0), (0, 1, 0)), ("yz", (0, 1, 0), (0, 0, 1)), ("xz", (1, 0, 0), (0, 0, 1))],
)
def test_named_planes(notation: str, u: tuple[int, ...], v: tuple[int, ...]) -> None:
    axes = Plane.model_validate(notation).axes
    assert axes[0] == pytest.approx(u)
    assert axes[1] == pytest.approx(v)


@pytest.mark.parametrize("notation", ["xy", "yz", "xz", {"normal": [1, 2, 0]}])
def test_a_plane_has_the_same_notation_where_space_is_allowed(notation: object) -> None:
    assert read(space=notation).space.plane == read(plane=notation).plane


def test_a_free_plane_is_none() -> None:
    assert read(space="free").space.plane is None


@given(points)
def test_axes_of_a_plane(normal: tuple[float, float, float]) -> None:
    """Unit vectors, at right angles, whose cross product is the normal's direction."""
    if math.hypot(*normal) < 1e-3:
        return
    u, v = Plane(normal=normal).axes
    assert np.cross(u, v) == pytest.approx(np.array(normal) / math.hypot(*normal), abs=1e-6)


def test_red_wraps_around_the_color_circle() -> None:
    boxes = Color.named("red").bounds
    assert [(low[0], high[0]) for low, high in boxes] == [(170, 179), (0, 6)]


@pytest.mark.parametrize("hue", [(0, 360), (0, 359), (0, 358)])
def test_the_whole_color_circle_is_every_hue(hue: tuple[int, int]) -> None:
    ((low, high),) = Color(ranges=(HsvRange(hue=hue),)).bounds
    assert (low[0], high[0]) == (0, 179)


@pytest.mark.parametrize("notation", ["red", [{"hue": [350, 10], "value": [0.25, 1]}]])
def test_a_color_is_read_back_from_its_notation(notation: object) -> None:
    color = Color.model_validate(notation)
    assert Color.model_validate(read_text(color.notation).data) == color


def test_explicit_ranges() -> None:
    color = read(color=[{"hue": [42, 70], "saturation": [0.5, 1]}]).color
    ((low, high),) = color.bounds
    assert low.tolist() == [21, 128, 51]
    assert high.tolist() == [35, 255, 255]
