"""Expected fits: the accuracy of a fit is predicted before its images are taken."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.core.pose import Pose
from bt_dualarm.perception.expected_fit import ExpectedFit
from bt_dualarm.perception.shape_fit import OutlineScene, ShapeFitter, turn_by
from bt_dualarm.skill.looking import SIDES
from tests.perception.test_shape_fit import DOWN, PLACE, SHAPES, cameras, seen

LYING = OutlineScene.believed(PLACE, turn_by(np.array((0.0, 0.0, 0.4))))


@pytest.mark.parametrize("name", SHAPES)
def test_expected_accuracy_is_that_of_the_fit(name: str) -> None:
    """It is within 15 % of what the fit of pose and size to four images then states."""
    shape = SHAPES[name]
    fitter = ShapeFitter(shape)
    views = [seen(LYING, shape, camera) for camera in cameras(4)]
    expected = ExpectedFit(fitter, LYING, views[:2], np.zeros(3))
    more = expected.by(views[2].camera) + expected.by(views[3].camera)
    found = expected.accuracy(more[None])
    fit = fitter.again([fitter._solved(LYING, views)], views)[0]
    assert found.position[0] == pytest.approx(fit.sigma_m, rel=0.15)
    assert found.angle[0] == pytest.approx(fit.sigma_rad(shape), rel=0.15, abs=1e-9)
    assert found.size[0] == pytest.approx(fitter.size_of(fit, views).sigma, rel=0.15)


def test_more_images_never_increase_the_uncertainty() -> None:
    """Whatever the viewpoint, each standard deviation shrinks or stays."""
    shape = SHAPES["brick"]
    views = [seen(LYING, shape, cameras(1)[0])]
    expected = ExpectedFit(ShapeFitter(shape), LYING, views, np.zeros(3))
    more = np.array([expected.by(side.camera(PLACE, DOWN.quaternion, 0.3)) for side in SIDES])
    before = expected.accuracy(np.zeros_like(more))
    after = expected.accuracy(more)
    for one, other in zip(after, before, strict=True):
        assert np.all(one <= other * (1.0 + 1e-6))


def test_a_camera_that_faces_away_adds_no_information() -> None:
    shape = SHAPES["ball"]
    views = [seen(LYING, shape, cameras(1)[0])]
    expected = ExpectedFit(ShapeFitter(shape), LYING, views, np.zeros(3))
    up = views[0].camera @ Pose.from_rpy((0, 0, 0), (np.pi, 0, 0))
    assert not expected.by(up).any()


def test_the_middle_of_a_marked_block_is_less_certain_than_its_marker() -> None:
    """The block's rotation is uncertain, and its middle is away from what the images show."""
    shape = SHAPES["brick"]
    views = [seen(LYING, shape, cameras(1)[0])]
    no_information = np.zeros((1, 15, 15))
    near, far = (
        ExpectedFit(ShapeFitter(shape), LYING, views, np.array((0.0, middle, 0.0))).accuracy(
            no_information
        )
        for middle in (0.0, 1.0)
    )
    assert far.position[0] > near.position[0]
