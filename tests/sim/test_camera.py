from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_dualarm.core.errors import WorldError
from bt_dualarm.sim.camera import Camera
from bt_dualarm.sim.frame import Exposure, Frame, Image, Region, Window
from bt_dualarm.spec.document import CameraSpec

SCENE = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <body name="cart" pos="0 0 1">
      <joint name="slide" type="slide" axis="1 0 0"/>
      <geom size=".01" mass="1"/>
      <camera name="arm/camera" pos="0 -1 0" xyaxes="1 0 0 0 0 1" fovy="60"/>
    </body>
  </worldbody>
</mujoco>
"""


class Recorder:
    """A renderer that records its requests."""

    name = "recorder"

    def __init__(self) -> None:
        self.regions: list[Region | None] = []
        self.strides: list[int] = []

    def render(self, model: Any, data: Any, exposure: Exposure) -> Image:
        self.regions.append(exposure.region)
        self.strides.append(exposure.stride)
        return np.zeros((exposure.height, exposure.width, 3), np.uint8)

    def close(self) -> None:
        pass


def world() -> Any:
    model = mujoco.MjModel.from_xml_string(SCENE)
    return SimpleNamespace(model=model, data=mujoco.MjData(model))


def camera(**fields: Any) -> tuple[Camera, Recorder]:
    recorder = Recorder()
    return Camera("arm/camera", CameraSpec(**fields), recorder), recorder


def stamps(fps: float, steps: int, timestep: float) -> list[float]:
    """Times of the exposures in a number of physics steps."""
    stage = world()
    (cam, _) = camera(fps=fps, resolution=(16, 16))
    cam.subscribe(lambda _: None)
    taken = []
    for step in range(steps):
        stage.data.time = step * timestep
        if cam.due(stage.data.time):
            taken.append(cam.capture(stage).stamp)
    return taken


def test_60_hz_exposures_with_steps_of_2_ms() -> None:
    """Exposures fall on the first step at or after k / 60: 0, 16.7, 33.3, 50 ms."""
    assert stamps(60.0, 26, 0.002) == pytest.approx([0.0, 0.018, 0.034, 0.05])


@given(fps=st.floats(1.0, 500.0), timestep=st.sampled_from([0.0005, 0.001, 0.002, 0.005]))
@settings(max_examples=30, deadline=None)
def test_one_exposure_per_period(fps: float, timestep: float) -> None:
    """At most one per step, each within one step after k / fps, none omitted or repeated."""
    taken = np.array(stamps(fps, 200, timestep))
    index = np.floor(taken * fps + 1e-6)
    assert (np.diff(index) >= 1).all()
    assert (taken - index / fps < timestep + 1e-9).all()
    if timestep * fps < 1.0:
        assert (np.diff(index) == 1).all()


def test_no_exposure_is_due_without_subscribers() -> None:
    cam, _ = camera()
    assert not cam.due(1.0)
    unsubscribe = cam.subscribe(lambda _: None)
    assert cam.due(1.0)
    unsubscribe()
    unsubscribe()
    assert not cam.due(1.0)


def test_late_subscriber_gets_one_frame_without_a_backlog() -> None:
    stage = world()
    (cam, _) = camera(fps=10.0)
    cam.subscribe(lambda _: None)
    stage.data.time = 5.03
    assert cam.due(5.03)
    cam.capture(stage)
    assert not cam.due(5.09)
    assert cam.due(5.1)


def test_frames_arrive_after_their_latency_in_order() -> None:
    stage = world()
    (cam, _) = camera(fps=100.0, latency=0.025)
    got: list[Frame] = []
    cam.subscribe(got.append)
    for time in (0.0, 0.01, 0.02, 0.03):
        stage.data.time = time
        cam.capture(stage)
    assert cam.deliver(0.02) == []
    assert cam.latest is None
    delivered = cam.deliver(0.045)
    assert [frame.stamp for frame in delivered] == [0.0, 0.01, 0.02]
    assert got == delivered
    assert cam.latest is delivered[-1]
    assert [frame.stamp for frame in cam.deliver(0.055)] == [0.03]


def test_subscriber_may_unsubscribe_while_it_is_called() -> None:
    stage = world()
    (cam, _) = camera()
    seen: list[Frame] = []

    def once(frame: Frame) -> None:
        seen.append(frame)
        unsubscribe()

    unsubscribe = cam.subscribe(once)
    other: list[Frame] = []
    cam.subscribe(other.append)
    cam.capture(stage)
    cam.capture(stage)
    cam.deliver(0.0)
    assert len(seen) == 1
    assert len(other) == 2


def test_no_subscriber_can_draw_into_the_image_of_the_others() -> None:
    """The record has the same image, and a replay would find another one."""
    stage = world()
    (cam, _) = camera(resolution=(16, 16))
    got: list[Frame] = []
    cam.subscribe(got.append)
    cam.capture(stage)
    cam.deliver(1.0)
    with pytest.raises(ValueError, match="read-only"):
        got[0].image[:] = 255
    own = got[0].image.copy()
    own[:] = 255
    assert got[0].image.max() == 0


def test_pose_of_a_frame_is_that_of_its_stamp() -> None:
    """mj_step leaves the body poses of before the step; a camera must not lag by a step."""
    stage = world()
    (cam, _) = camera()
    stage.data.qvel[0] = 1.0
    for _ in range(50):
        mujoco.mj_step(stage.model, stage.data)
    frame = cam.capture(stage)
    assert frame.stamp == pytest.approx(0.1)
    assert frame.pose.position == pytest.approx([stage.data.qpos[0], -1.0, 1.0], abs=1e-12)


def test_camera_frame_has_z_forward_and_y_down() -> None:
    stage = world()
    (cam, _) = camera()
    pose = cam.capture(stage).pose
    assert pose.rotation.apply((1, 0, 0)) == pytest.approx([1, 0, 0], abs=1e-12)
    assert pose.rotation.apply((0, 1, 0)) == pytest.approx([0, 0, -1], abs=1e-12)
    assert pose.rotation.apply((0, 0, 1)) == pytest.approx([0, 1, 0], abs=1e-12)


def test_aim_is_called_with_the_pose_of_the_exposure() -> None:
    stage = world()
    (cam, recorder) = camera(resolution=(80, 60))
    calls = []

    def aim(stamp: float, pose: Any, width: int, height: int) -> Window:
        calls.append((stamp, pose.position[0], width, height))
        return Window((-5, 10, 30, 99), 3)

    cam.aim = aim
    stage.data.qpos[0] = 0.25
    stage.data.time = 0.5
    frame = cam.capture(stage)
    assert calls == [(0.5, 0.25, 80, 60)]
    assert recorder.regions == [(0, 9, 30, 60)]
    assert recorder.strides == [3]
    assert frame.region == (0, 9, 30, 60)
    assert frame.stride == 3


def test_error_names_a_missing_camera() -> None:
    cam = Camera("arm9/camera", CameraSpec(), Recorder())
    with pytest.raises(WorldError, match="arm9/camera"):
        cam.capture(world())


def test_frames_are_dropped_at_the_declared_rate() -> None:
    """A third of 300, within three standard deviations, and identically for the same seed."""

    def delivered(seed: int) -> list[float]:
        spec = CameraSpec(fps=100.0, resolution=(16, 16), drop=1.0 / 3.0)
        cam = Camera("arm/camera", spec, Recorder(), np.random.default_rng(seed))
        stage = world()
        for step in range(300):
            stage.data.time = 0.01 * step
            cam.capture(stage)
        return [frame.stamp for frame in cam.deliver(10.0)]

    assert len(delivered(1)) == pytest.approx(200, abs=3 * (300 * 2 / 9) ** 0.5)
    assert delivered(1) == delivered(1)
    assert delivered(1) != delivered(2)


def test_shake_moves_the_image_but_not_the_pose() -> None:
    """A point on the axis deviates by ``noise`` pixels in x and y; the reported pose does not."""
    stage = world()
    focal = 120.0 / np.tan(np.radians(30.0))
    seen = []

    class Axis(Recorder):
        def render(self, model: Any, data: Any, exposure: Exposure) -> Image:
            forward = -data.cam_xmat[exposure.camera_id].reshape(3, 3)[:, 2]
            seen.append((focal * forward[0] / forward[1], focal * forward[2] / forward[1]))
            return np.zeros((240, 320, 3), np.uint8)

    cam = Camera("arm/camera", CameraSpec(noise=2.0), Axis(), np.random.default_rng(0))
    poses = [cam.capture(stage).pose for _ in range(400)]
    assert np.std(seen, axis=0) == pytest.approx([2.0, 2.0], rel=0.1)
    assert np.mean(seen, axis=0) == pytest.approx([0.0, 0.0], abs=0.4)
    assert {tuple(pose.position) for pose in poses} == {tuple(poses[0].position)}
    assert np.allclose(poses[-1].rotation_matrix, poses[0].rotation_matrix, atol=0.0)
