"""Metadata of images come from calibration, encoders and a clock; pixels from the true state."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bt_dualarm.core.pose import Pose
from bt_dualarm.sim.camera import Calibration, Camera, calibration_of
from bt_dualarm.sim.frame import Frame, Image
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import CameraSpec
from bt_dualarm.spec.values import Uncertainty
from tests.sim.test_camera import Recorder
from tests.sim.worlds import arm, file_of

GRAY = 100


def moving(reality: object) -> World:
    """A UR5 with a wrist camera that falls, because no controller holds it."""
    return World(file_of({"arm1": arm("ur5", camera={}, reality=reality)}), seed=1)


def delivered(world: World, camera: Camera, steps: int) -> list[Frame]:
    """All frames of a number of physics steps."""
    seen: list[Frame] = []
    camera.subscribe(seen.append)
    for _ in range(steps):
        if camera.due(world.time):
            camera.capture(world)
        camera.deliver(world.time)
        world.step()
    return seen


@pytest.mark.parametrize("offset", [-0.02, -0.003, 0.0, 0.003, 0.02])
def test_clock_offset_shifts_stamps_and_their_poses(offset: float) -> None:
    """The pose is that at the time of the stamp, not of the exposure."""
    world = moving("ideal")
    hardware = world.hardware["arm1"]
    nominal = world.nominal["arm1"]
    known = Calibration(lambda time: nominal.camera_pose_at(hardware.q_at(time)), 1.0, offset)
    camera = Camera("arm1/camera", CameraSpec(fps=50.0), Recorder(), calibration=known)
    poses = {}
    seen: list[Frame] = []
    camera.subscribe(seen.append)
    for _ in range(100):
        poses[round(world.time, 9)] = nominal.camera_pose_at(hardware.q)
        if camera.due(world.time):
            camera.capture(world)
        camera.deliver(world.time)
        world.step()
    assert len(seen) > 5
    late = [frame for frame in seen if frame.stamp > 0.03]
    for frame in late:
        assert (frame.stamp - offset) / 0.02 == pytest.approx(round((frame.stamp - offset) / 0.02))
        near = min(poses, key=lambda time: abs(time - frame.stamp))
        expected = poses[near]
        assert frame.pose.distance(expected) < 0.012, "a step of physics at the speed of the fall"
        if abs(near - frame.stamp) < 1e-9:
            assert frame.pose.distance(expected) < 1e-12


def test_image_with_a_future_stamp_is_delivered_at_its_stamp() -> None:
    world = moving("ideal")
    known = Calibration(lambda _: Pose.identity(), 1.0, 0.01)
    camera = Camera("arm1/camera", CameraSpec(fps=50.0), Recorder(), calibration=known)
    camera.subscribe(lambda _: None)
    camera.capture(world)
    assert camera.deliver(0.009) == []
    assert len(camera.deliver(0.01)) == 1


def test_reported_field_of_view_is_the_nominal_one() -> None:
    world = moving({"camera": {"focal": 0.1}})
    camera = Camera(
        "arm1/camera", CameraSpec(), Recorder(), calibration=calibration_of(world, "arm1", 0)
    )
    (frame, *_) = delivered(world, camera, 40)
    true = math.radians(float(world.model.cam_fovy[world.arms["arm1"].camera_id]))
    assert frame.fov_rad == pytest.approx(math.radians(50.0))
    assert abs(true - frame.fov_rad) > 1e-3


def degraded(noise: float, light: float, count: int = 1) -> Image:
    """Gray images of shape (40, 50, 3), with noise and varying brightness."""
    known = Calibration(
        lambda _: Pose.identity(), 1.0, noise=noise, light=Uncertainty(uniform=light)
    )
    gray = np.full((40, 50, 3), GRAY, np.uint8)
    return np.array([known.degradation((20, 10, 70, 50))(gray) for _ in range(count)])


def test_pixel_noise_has_the_given_deviation() -> None:
    (image,) = degraded(4.0, 0.0).astype(float)
    assert image.std() == pytest.approx(4.0, rel=0.05)
    assert image.mean() == pytest.approx(GRAY, abs=0.3)


def test_brightness_varies_between_images() -> None:
    levels = degraded(0.0, 0.2, 300)[:, 20, 20, 0].astype(float)
    assert 0.78 * GRAY <= levels.min() < 0.83 * GRAY
    assert 1.17 * GRAY < levels.max() <= 1.22 * GRAY


def test_image_without_degradation_is_not_copied() -> None:
    known = Calibration(lambda _: Pose.identity(), 1.0)
    image = np.zeros((4, 4, 3), np.uint8)
    assert known.degradation((0, 0, 4, 4))(image) is image


@pytest.mark.parametrize("noise", [1.5, 200.0])
def test_noise_is_rounded_to_levels_and_clipped(noise: float) -> None:
    """It is added to a black image and subtracted from a white one, within the range of levels."""
    count = 600
    shape = (10, 20, 3)
    found = Calibration(lambda _: Pose.identity(), 1.0, noise=noise, rng=np.random.default_rng(5))
    rng = np.random.default_rng(5)
    Uncertainty().draw(rng, 1)  # of the brightness, which does not vary here
    noise_levels = np.rint(noise * rng.standard_normal(count + 2**18, dtype=np.float32))
    begin = int(rng.integers(2**18))
    expected = noise_levels[begin : begin + count].reshape(shape)
    degrade = found.degradation((0, 0, 20, 10))
    black, white = (degrade(np.full(shape, level, np.uint8)).astype(float) for level in (0, 255))
    assert (black == expected.clip(0, 255)).all()
    assert (white == 255 - (-expected).clip(0, 255)).all()
    assert (noise < 100.0) == (abs(expected).max() < 255.0)
