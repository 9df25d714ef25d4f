"""A camera's mount comes out of views of one point, whatever it is off by."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.core.pose import Pose
from bt_dualarm.perception.scan import MarkView, hand_eye

MARK = np.array((0.7, 0.1, 0.6))
FOCAL_PX = 257.0


def views(off: Pose, rng: np.random.Generator, noise_px: float) -> list[MarkView]:
    """Sixteen looks of a camera that is ``off`` from where it is believed to be."""
    seen = []
    for _ in range(16):
        turn = rng.uniform(-0.3, 0.3, 3).tolist()
        around = Pose(MARK, np.array((1.0, 0.0, 0.0, 0.0))) @ Pose.from_rpy((0, 0, 0), turn)
        beside = rng.uniform(-0.15, 0.15, 2).tolist()
        camera = around @ Pose.from_rpy((0, 0, -rng.uniform(0.25, 0.45)), (*beside, 0.0))
        x, y, z = (camera @ off).inverse.apply(MARK).tolist()
        pixel = FOCAL_PX * np.array((x, y)) / z + rng.normal(0.0, noise_px, 2)
        seen.append(MarkView(camera, pixel, FOCAL_PX))
    return seen


@pytest.mark.parametrize("seed", range(5))
def test_the_correction_is_where_the_camera_is(seed: int) -> None:
    rng = np.random.default_rng(seed)
    off = Pose.from_rpy(rng.uniform(-3e-3, 3e-3, 3).tolist(), rng.uniform(-0.02, 0.02, 3).tolist())
    found = hand_eye(views(off, rng, 0.03), MARK + rng.uniform(-0.02, 0.02, 3))
    assert found.correction.angle(off) < 2e-3
    assert found.correction.distance(off) < 2.5e-3
    assert found.residual_px < 0.15 < found.before_px


def test_a_mount_that_is_right_is_left_alone() -> None:
    found = hand_eye(views(Pose.identity(), np.random.default_rng(9), 0.0), MARK)
    assert found.correction.angle(Pose.identity()) < 1e-6
    assert found.residual_px < 1e-6
