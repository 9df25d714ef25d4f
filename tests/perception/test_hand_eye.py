"""Hand-eye calibration: views of one point reveal the error of a camera's mount."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.core.pose import Pose
from bt_dualarm.perception.scan import MarkView, hand_eye

MARK = np.array((0.7, 0.1, 0.6))
FOCAL_PX = 257.0


def views(mount_error: Pose, rng: np.random.Generator, noise_px: float) -> list[MarkView]:
    """Sixteen views of a camera whose mount has an error."""
    seen = []
    for _ in range(16):
        turn = rng.uniform(-0.3, 0.3, 3).tolist()
        around = Pose(MARK, np.array((1.0, 0.0, 0.0, 0.0))) @ Pose.from_rpy((0, 0, 0), turn)
        beside = rng.uniform(-0.15, 0.15, 2).tolist()
        camera = around @ Pose.from_rpy((0, 0, -rng.uniform(0.25, 0.45)), (*beside, 0.0))
        x, y, z = (camera @ mount_error).inverse.apply(MARK).tolist()
        pixel = FOCAL_PX * np.array((x, y)) / z + rng.normal(0.0, noise_px, 2)
        seen.append(MarkView(camera, pixel, FOCAL_PX))
    return seen


@pytest.mark.parametrize("seed", range(5))
def test_the_correction_equals_the_mount_error(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mount_error = Pose.from_rpy(
        rng.uniform(-3e-3, 3e-3, 3).tolist(), rng.uniform(-0.02, 0.02, 3).tolist()
    )
    found = hand_eye(views(mount_error, rng, 0.03), MARK + rng.uniform(-0.02, 0.02, 3))
    assert found.correction.angle(mount_error) < 2e-3
    assert found.correction.distance(mount_error) < 2.5e-3
    assert found.residual_px < 0.15 < found.before_px


def test_a_correct_mount_is_not_corrected() -> None:
    found = hand_eye(views(Pose.identity(), np.random.default_rng(9), 0.0), MARK)
    assert found.correction.angle(Pose.identity()) < 1e-6
    assert found.residual_px < 1e-6
