"""Small kernels without tests of their own agree with plain Python."""

from __future__ import annotations

import sys
from collections.abc import Callable
from copy import deepcopy
from typing import Any

import numpy as np
import pytest

from bt_dualarm.collision import distance_kernels
from bt_dualarm.control.control_kernels import detect_collision
from bt_dualarm.control.kernel_rows import COMPARE, DETECTOR_ROWS, FIRST, JUDGE, LEARN
from bt_dualarm.core.pose import Vector
from bt_dualarm.perception.perception_kernels import blend_in_plane
from bt_dualarm.sim.device_kernels import (
    any_foreign_contact,
    drive_fingers,
    drive_plant,
    find_held,
    held_body,
    move_held,
    move_with_palm,
    palm_motion,
    pass_between,
    read_fingers,
    write_pad_forces,
)
from bt_dualarm.sim.kernel_arrays import (
    DRIVE,
    DRIVES,
    FINGER_NUMBERS,
    FINGER_READINGS,
    FRICTION,
    LATE,
    PADS_S,
    WHOLE,
)
from bt_dualarm.sim.ray_trace_kernels import enter
from bt_dualarm.trajectory.trajectory_kernels import longest_free_time
from tests.plain_kernels import plain

N = 5
DOF = 6
BODIES = 7

Arguments = Callable[[np.random.Generator], tuple[object, ...]]


def quaternions(rng: np.random.Generator, count: int) -> Any:
    """Unit quaternions, of shape (count, 4)."""
    drawn = rng.normal(size=(count, 4))
    return drawn / np.linalg.norm(drawn, axis=1, keepdims=True)


def limits(rng: np.random.Generator) -> Any:
    """Limits of joints: lowest and highest position, velocity, acceleration, jerk; (5, dof)."""
    return np.vstack((-np.ones(DOF), np.ones(DOF), rng.uniform(1.0, 3.0, (3, DOF))))


def fingers(rng: np.random.Generator) -> Any:
    """Indices of three grippers, two with fingers, one of which has sensors in its pads."""
    numbers = np.zeros((3, FINGER_NUMBERS), np.int64)
    numbers[:, :3] = (1, 3, 0), (-1, 0, 0), (4, 0, 1)
    numbers[:, 3:6] = rng.integers(0, 3, (3, 3))
    numbers[:, 6:] = (0, 2, 1), (-1, 0, 0), (-1, 0, 0)
    return numbers


def drives(rng: np.random.Generator) -> Any:
    """Drives of three joints, with delays of up to three steps."""
    rows = rng.uniform(0.5, 1.0, (3, DRIVES))
    rows[:, WHOLE] = rng.integers(0, 3, 3)
    rows[:, LATE] = rng.random(3)
    return rows


def finger_readings(rng: np.random.Generator, last_s: float) -> Any:
    """Readings of three grippers whose pads were last read at a time in s."""
    readings = rng.uniform(0.01, 0.02, (3, FINGER_READINGS))
    readings[:, PADS_S] = last_s
    return readings


KERNELS: dict[Callable[..., Any], Arguments] = {
    distance_kernels.place: lambda rng: (
        rng.normal(size=(N, 4)),
        rng.integers(0, BODIES, N),
        rng.normal(size=(BODIES, 3)),
        rng.normal(size=(BODIES, 9)),
        np.empty((N, 4)),
    ),
    distance_kernels.lever: lambda rng: (
        rng.normal(size=(N, 4)),
        rng.permutation(DOF),
        rng.normal(size=(DOF, 3)),
        np.tile((0.6, 0.0, 0.8), (DOF, 1)),
        rng.integers(0, 2, (N, DOF)).astype(float),
        np.empty((N, DOF)),
    ),
    distance_kernels.reach: lambda rng: (rng.random((N, DOF)), 0.2 * rng.random(DOF), 1.5),
    distance_kernels.sphere_distance: lambda rng: (
        rng.normal(size=(N, 4)),
        rng.normal(size=(3, 4)),
    ),
    distance_kernels.moved: lambda rng: (
        *rng.normal(size=(2, N, 3)),
        rng.random(N),
        rng.integers(0, 2, (N, DOF)).astype(float),
        rng.random(DOF),
    ),
    longest_free_time: lambda rng: (
        rng.uniform(0.0, 0.3),
        np.array((0.2, 0.1, 0.02)),
        rng.random((N, DOF)),
        1.5,
        limits(rng),
        rng.uniform(-0.5, 0.5, (2, DOF)),
        np.empty(DOF),
    ),
    detect_collision: lambda rng: (
        rng.normal(size=(DOF, DOF)),
        rng.normal(size=(2, DOF)),
        rng.normal(size=DOF),
        1.0,
        int(rng.choice((FIRST, 0, COMPARE, COMPARE | JUDGE, COMPARE | JUDGE | LEARN))),
        30.0 * rng.random((DETECTOR_ROWS, DOF)),
        rng.normal(size=(9, DOF)),
        0.1 * rng.random((24, DOF)),
    ),
    blend_in_plane: lambda rng: (
        rng.normal(size=(3, 4)),
        0.1,
        rng.normal(size=(3, 4)),
        0.2,
        0.3,
        rng.normal(size=(2, 3)),
        rng.normal(size=3),
        np.empty((3, 2)),
    ),
    write_pad_forces: lambda rng: (
        1,
        2,
        int(rng.integers(BODIES)),
        int(rng.integers(N)),
        rng.normal(size=9),
        rng.normal(size=(BODIES, 9)),
        rng.normal(size=(2, 3, 3)),
        rng.random((2, 2)),
        rng.normal(size=(2, N, 6)),
        np.empty((2, 2, 3)),
    ),
    held_body: lambda rng: (
        rng.integers(0, 4, (8, 2), dtype=np.int32),
        rng.uniform(-1.0, 0.5, 8),
        0,
        1,
        rng.integers(0, 2, 4, dtype=np.int32),
    ),
    find_held: lambda rng: (
        rng.integers(0, 4, (8, 2), dtype=np.int32),
        rng.uniform(-1.0, 0.5, 8),
        np.array(((0, 1, 5), (0, 1, 6))),
        rng.integers(0, 2, 4, dtype=np.int32),
        rng.integers(-1, 2, BODIES),
        rng.normal(size=(BODIES, 3)),
        quaternions(rng, BODIES),
        np.zeros(2, np.int64),
        np.zeros((2, 3, 7)),
    ),
    move_held: lambda rng: (
        np.array(((0, 1, 5), (2, 3, 6))),
        np.array((-1, 0, 7, -1, -1, -1, -1)),
        rng.normal(size=(BODIES, 3)),
        quaternions(rng, BODIES),
        np.array((rng.choice((-1, 1)), rng.choice((-1, 2)))),
        np.concatenate((rng.normal(size=(2, 3, 3)), rng.normal(size=(2, 3, 4))), axis=2),
        np.array(((1, 0, 2, 3, -1), (4, 5, 6, 7, 8))),
        rng.normal(size=(9, 6)),
        rng.normal(size=(BODIES, 3)),
        rng.normal(size=9),
        0.002,
        rng.normal(size=14),
    ),
    palm_motion: lambda rng: (
        np.array((1, 0, 2, 3, -1)),
        rng.normal(size=7),
        rng.normal(size=(9, 6)),
        rng.normal(size=(BODIES, 3)),
        rng.normal(size=9),
    ),
    move_with_palm: lambda rng: (
        np.concatenate((rng.normal(size=3), *quaternions(rng, 1))),
        np.hstack((rng.normal(size=(3, 3)), quaternions(rng, 3))),
        tuple(rng.normal(size=3).tolist()),
        tuple(rng.normal(size=3).tolist()),
        0.002,
    ),
    drive_plant: lambda rng: (
        np.array(((0, 2), (2, 3))),
        rng.normal(size=(4, 3)),
        int(rng.integers(4)),
        drives(rng),
        fingers(rng),
        rng.uniform(0.5, 2.0, (3, DRIVE)),
        *rng.normal(size=(2, 9)),
        0.002,
        np.append(np.zeros(3), rng.choice((0.0, np.inf))),
    ),
    pass_between: lambda rng: (
        rng.choice((1.0, 1e4)),
        *rng.normal(size=(2, 9)),
        np.array(((0, 2), (2, 3))),
        rng.uniform(0.5, 2.0, (3, FRICTION)),
        *rng.random((2, 9)),
        rng.integers(0, 4, (8, 2), dtype=np.int32),
        rng.uniform(-1.0, 0.5, 8),
        np.array(((0, 1, 5), (0, 1, 6))),
        rng.integers(0, 2, 4, dtype=np.int32),
        rng.integers(-1, 2, BODIES),
        rng.normal(size=(BODIES, 3)),
        quaternions(rng, BODIES),
        np.zeros(2, np.int64),
        np.zeros((2, 3, 7)),
        rng.integers(-1, 2, 4),
        rng.choice((-2, 0, 1), 4),
    ),
    read_fingers: lambda rng: (
        0.5,
        rng.normal(size=9),
        fingers(rng),
        rng.uniform(0.5, 2.0, (3, DRIVE)),
        finger_readings(rng, rng.choice((-1.0, 0.3, 0.5))),
        rng.normal(size=(3, 3)),
        rng.uniform(0.0, 0.4, (3, 3, 2)),
        rng.normal(size=6),
        rng.normal(size=(BODIES, 9)),
        rng.normal(size=(3, 3, 3)),
        rng.random((3, 2)),
        rng.normal(size=(3, 2, 6)),
        np.zeros((3, 2, 3)),
    ),
    drive_fingers: lambda rng: (*rng.normal(size=2), rng.uniform(0.5, 2.0, DRIVE), 0.002),
    enter: lambda rng: (
        np.zeros((12, 14, 3), np.uint8),
        (3, 2, 12, 10),
        (2, 1),
        2,
        rng.integers(0, 256, (5, 5, 3), dtype=np.uint8),
    ),
    any_foreign_contact: lambda rng: (
        rng.integers(0, 6, (3, 2), dtype=np.int32),
        np.array((-1, -1, 0, 0, 1, 1)),
        rng.choice((-2, 0, 1), 6),
    ),
}


@pytest.mark.parametrize("kernel", KERNELS, ids=lambda kernel: kernel.__name__)
@pytest.mark.parametrize("seed", range(6))
def test_compiled_kernels_agree_with_plain_python(kernel: Callable[..., Any], seed: int) -> None:
    """Returned values and changed arrays agree except for rounding."""
    arguments = KERNELS[kernel](np.random.default_rng(seed))
    compiled = deepcopy(arguments)
    interpreted = deepcopy(arguments)
    found = kernel(*compiled)
    expected = plain(kernel)(*interpreted)
    if found is not None:
        assert np.asarray(found) == pytest.approx(np.asarray(expected), rel=1e-12, abs=1e-12)
    for one, other in zip(arrays(compiled), arrays(interpreted), strict=True):
        assert one == pytest.approx(other, rel=1e-12, abs=1e-12)


def arrays(arguments: tuple[object, ...]) -> list[Vector]:
    """The arguments that a kernel can change."""
    return [one for one in arguments if isinstance(one, np.ndarray)]


def test_plain_kernels_call_plain_ones() -> None:
    """Imports elsewhere still give the compiled kernel."""
    inner = vars(sys.modules[plain(longest_free_time).__module__])
    assert not hasattr(plain(longest_free_time), "py_func")
    assert plain(longest_free_time).__globals__["reach"] is not distance_kernels.reach
    assert not hasattr(plain(longest_free_time).__globals__["reach"], "py_func")
    assert inner["longest_free_time"] is longest_free_time
