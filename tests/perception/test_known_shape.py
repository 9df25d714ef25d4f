"""Known shapes: which rotations look alike, and initial guesses of the orientation."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bt_dualarm.core.pose import Pose
from bt_dualarm.perception.known_shape import KnownShape
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.yaml_reader import with_tuples

CUBE = KnownShape("box", (0.05, 0.05, 0.05))
PLATE = KnownShape("box", (0.08, 0.08, 0.02))
BRICK = KnownShape("box", (0.03, 0.05, 0.08))
CAN = KnownShape("cylinder", (0.03, 0.08))
PILL = KnownShape("capsule", (0.02, 0.04))
BALL = KnownShape("sphere", (0.03,))


def bottle(*ends: float, middle: float = 0.0) -> KnownShape:
    """A body with its middle at a height, and a neck on its axis at each of some heights."""
    neck = {"shape": "cylinder", "size": [0.012, 0.04]}
    parts = {f"neck{i}": {**neck, "pose": {"xyz": [0, 0, z]}} for i, z in enumerate(ends)}
    body = {"shape": "cylinder", "size": [0.03, 0.08], "pose": {"xyz": [0, 0, middle]}}
    parts["body"] = body
    given = {"shape": "compound", "mass": 0.2, "parts": parts}
    return KnownShape.of(ObjectSpec.model_validate(with_tuples(given)))


def bars(
    *yaws: float, middle: float = 0.0, at: tuple[float, float, float] = (0, 0, 0)
) -> KnownShape:
    """A compound of equal bars at these angles about an axis along z through `at`, in degrees."""
    parts = {}
    for yaw in yaws:
        x, y = middle * np.cos(np.radians(yaw)), middle * np.sin(np.radians(yaw))
        pose = {"xyz": [float(x) + at[0], float(y) + at[1], at[2]], "rpy": [0, 0, yaw]}
        parts[f"bar{yaw:g}"] = {"shape": "box", "size": [0.08, 0.02, 0.03], "pose": pose}
    given = {"shape": "compound", "mass": 0.2, "parts": parts}
    return KnownShape.of(ObjectSpec.model_validate(with_tuples(given)))


CROSS = bars(0, 90)
STAR = bars(0, 120, 240, middle=0.04)


ELSEWHERE = (0.3, -0.2, 0.1)
"""Position of a center in the frame of an object whose frame is far from it."""


def turned(*rpy: float) -> Pose:
    roll, pitch, yaw = np.radians(rpy)
    return Pose.from_rpy((0.1, 0.2, 0.3), (roll, pitch, yaw))


@pytest.mark.parametrize(
    ("shape", "alike"),
    [
        (CUBE, turned(90, 0, 0)),
        (CUBE, turned(0, 0, -90)),
        (PLATE, turned(180, 0, 90)),
        (BRICK, turned(0, 180, 0)),
        (CAN, turned(0, 0, 77)),
        (CAN, turned(180, 0, 30)),
        (PILL, turned(180, 0, 30)),
        (BALL, turned(10, 20, 30)),
        (bottle(0.06), turned(0, 0, 77)),
        (CROSS, turned(0, 0, 90)),
        (CROSS, turned(180, 0, -90)),
        (STAR, turned(0, 0, 120)),
        (STAR, turned(180, 0, 240)),
        (bottle(0.06, -0.06), turned(180, 0, 30)),
    ],
)
def test_rotations_that_look_alike_are_equal(shape: KnownShape, alike: Pose) -> None:
    """The angle between them is zero, and their canonical poses are the same."""
    one = turned(0, 0, 0)
    assert shape.angle(one, alike) == pytest.approx(0.0, abs=1e-7)
    assert shape.canonical(alike).angle(one) == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize(
    ("shape", "turn"),
    [
        (bars(0, 90, at=ELSEWHERE), (180, 0, -90)),
        (bars(0, 120, 240, middle=0.04, at=ELSEWHERE), (180, 0, 240)),
        (bars(0, at=ELSEWHERE), (0, 180, 0)),
        (bottle(0.02, 0.14, middle=0.08), (180, 0, 30)),
    ],
)
def test_shapes_turn_about_their_center_wherever_their_frame_is(
    shape: KnownShape, turn: tuple[float, float, float]
) -> None:
    """The frame of the object, which moves then, is where the canonical pose has it."""
    one = turned(0, 0, 0)
    about = Pose.from_rpy(shape.center)
    alike = one @ about @ Pose.from_rpy((0, 0, 0), np.radians(turn).tolist()) @ about.inverse
    assert one.distance(alike) > 0.05
    assert shape.away(one, alike) == pytest.approx((0.0, 0.0), abs=1e-7)
    canonical = shape.canonical(alike)
    assert one.distance(canonical) < 1e-9
    assert one.angle(canonical) < 1e-7
    aside = Pose(alike.position + np.array((0.0, 0.003, 0.004)), alike.quaternion)
    assert shape.away(one, aside) == pytest.approx((0.005, 0.0), abs=1e-7)


@pytest.mark.parametrize(
    ("shape", "other", "angle"),
    [
        (CUBE, turned(0, 0, 60), 30),
        (PLATE, turned(90, 0, 0), 90),
        (BRICK, turned(0, 0, 90), 90),
        (CAN, turned(0, 25, 0), 25),
        (bottle(0.06), turned(180, 0, 0), 180),
        (CROSS, turned(0, 0, 60), 30),
        (STAR, turned(0, 0, 180), 60),
        (STAR, turned(0, 180, 0), 60),
    ],
)
def test_other_rotations_differ_by_the_smallest_angle(
    shape: KnownShape, other: Pose, angle: float
) -> None:
    assert math.degrees(shape.angle(turned(0, 0, 0), other)) == pytest.approx(angle, abs=1e-6)


@pytest.mark.parametrize("shape", [CUBE, PLATE, BRICK, CAN, PILL, BALL])
@pytest.mark.parametrize("flat", [True, False])
def test_some_guess_is_near_every_orientation(shape: KnownShape, flat: bool) -> None:
    """Within half a step of yaw for a shape that lies flat, within 40° otherwise."""
    rng = np.random.default_rng(3)
    guesses = [Pose.from_matrix(np.block([[axes, np.zeros((3, 1))], [0, 0, 0, 1]]))
               for axes in shape.guesses(flat=flat)]  # fmt: skip
    for _ in range(50):
        if flat:
            down = [turned(0, 0, 0), turned(90, 0, 0), turned(0, 90, 0)][rng.integers(3)]
            if shape.spins is not None and down.rpy[0] > 1.0:
                down = turned(0, 90, 0)
            true = Pose.from_rpy((0, 0, 0), (0, 0, float(rng.uniform(-4, 4)))) @ down
        else:
            quaternion = rng.normal(size=4)
            true = Pose(np.zeros(3), quaternion / np.linalg.norm(quaternion))
        nearest = min(math.degrees(shape.angle(guess, true)) for guess in guesses)
        assert nearest < (8.0 if flat else 40.0)


def test_the_outline_of_a_ball_is_where_lines_of_sight_are_tangent() -> None:
    """Every point is on the ball, and the line of sight to it is square to the radius."""
    eye = np.array((0.1, -0.2, 0.3))
    points = BALL.seen_from(eye, np.eye(3))
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 0.03, rtol=1e-12)
    np.testing.assert_allclose(np.sum(points * (eye - points), axis=1), 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("shape", "size", "turned", "tilt"),
    [
        ("box", (0.04, 0.05, 0.1), 180.0, 0.0),
        ("box", (0.04, 0.05, 0.1), 170.0, 10.0),
        ("box", (0.04, 0.05, 0.1), 90.0, 90.0),
        ("box", (0.05, 0.05, 0.05), 90.0, 0.0),
        ("cylinder", (0.03, 0.1), 180.0, 0.0),
        ("sphere", (0.03,), 65.0, 0.0),
        ("cup", (0.03, 0.1), 180.0, 180.0),
        ("bin", (0.1, 0.1, 0.1), 180.0, 180.0),
    ],
)
def test_tilt_is_up_to_the_symmetry_of_the_object(
    shape: str, size: tuple[float, ...], turned: float, tilt: float
) -> None:
    known = KnownShape.of(ObjectSpec.model_validate({"shape": shape, "size": size, "mass": 0.1}))
    pose = Pose.from_rpy((0.0, 0.0, 0.0), (np.radians(turned), 0.0, 0.4))
    assert np.degrees(known.tilt(pose)) == pytest.approx(tilt, abs=1e-4)
