"""`look_at` moves the camera to the first of many poses to which a path exists."""

from __future__ import annotations

from collections.abc import Generator
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from bt_dualarm.arm.arm import Arm
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.skill import looking

FAR = Pose.from_rpy((9.0, 0.0, 0.0))


def arm_at_the_origin() -> Arm:
    """An arm whose tool is its camera, and which cannot reach `FAR`."""
    kinematics = SimpleNamespace(is_beyond=lambda pose: pose.distance(FAR) < 1.0)
    nominal = SimpleNamespace(camera_pose_at=lambda _: Pose.identity())
    world = SimpleNamespace(nominal={"arm1": nominal})
    return cast(
        "Arm",
        SimpleNamespace(
            name="arm1", q=None, tool_pose=Pose.identity(), world=world, kinematics=kinematics
        ),
    )


def refusing(code: str, requested: list[Pose]) -> Any:
    """A motion to a camera pose that fails with a code and records the pose."""

    def refusal(
        _: Arm, camera: Pose, speed: float, ignore: frozenset[str], *, at: Vector
    ) -> Generator[None, None, Failure]:
        requested.append(camera)
        yield None
        return Failure(code, f"at {speed}, {ignore}, {len(at)}")

    return refusal


def test_enclosed_arm_does_not_search_for_a_path_to_every_pose(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With a cube held in a hole, each of 156 searches took seconds: the run stalled."""
    requested: list[Pose] = []
    monkeypatch.setattr(looking, "_refusal", refusing("NO_PLAN", requested))
    with pytest.raises(Failure, match="NO_PLAN"):
        list(
            looking.look_at(arm_at_the_origin(), iter([Pose.identity()] * 156), 1.0, at=np.zeros(3))
        )
    assert len(requested) <= 10


def test_all_unreachable_poses_are_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    requested: list[Pose] = []
    monkeypatch.setattr(looking, "_refusal", refusing("UNREACHABLE", requested))
    list(looking.look_at(arm_at_the_origin(), iter([Pose.identity()] * 156), 1.0, at=np.zeros(3)))
    assert len(requested) == 156


def test_a_pose_beyond_reach_costs_no_search_and_no_tick(monkeypatch: pytest.MonkeyPatch) -> None:
    """A UR3e took 8 s of CPU, and 12 s of the run, to refuse a scan that was out of its reach."""
    requested: list[Pose] = []
    monkeypatch.setattr(looking, "_refusal", refusing("UNREACHABLE", requested))
    poses = [FAR] * 156 + [Pose.identity()]
    assert len(list(looking.look_at(arm_at_the_origin(), iter(poses), 1.0, at=np.zeros(3)))) == 1
    assert len(requested) == 1


@pytest.mark.parametrize("lean_deg", [0.0, 30.0, 90.0, 120.0])
def test_every_pose_of_the_camera_looks_at_the_point(lean_deg: float) -> None:
    """Leaned by 90°, the axes of some were the noise of rounding: they looked past the point."""
    point = np.array((0.4, 0.0, 0.4))
    for direction in np.random.default_rng(0).normal(size=(20, 3)):
        for camera in looking.gazes(point, 0.4, direction, np.radians(lean_deg), Pose.identity()):
            in_view = camera.rotation_matrix.T @ (point - camera.position)
            assert in_view == pytest.approx((0.0, 0.0, 0.4), abs=1e-6)
