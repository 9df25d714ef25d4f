"""`look_at` moves the camera to the first of many poses to which a path exists."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any, cast

import pytest

from bt_dualarm.arm.arm import Arm
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose
from bt_dualarm.skill import looking

NO_ARM = cast("Arm", None)


def refusing(code: str, requested: list[Pose]) -> Any:
    """A motion to a camera pose that fails with a code and records the pose."""

    def refusal(
        _: Arm, camera: Pose, speed: float, ignore: frozenset[str]
    ) -> Generator[None, None, Failure]:
        requested.append(camera)
        yield None
        return Failure(code, f"at {speed}, {ignore}")

    return refusal


def test_enclosed_arm_does_not_search_for_a_path_to_every_pose(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With a cube held in a hole, each of 156 searches took seconds: the run stalled."""
    requested: list[Pose] = []
    monkeypatch.setattr(looking, "_refusal", refusing("NO_PLAN", requested))
    with pytest.raises(Failure, match="NO_PLAN"):
        list(looking.look_at(NO_ARM, iter([Pose.identity()] * 156), 1.0))
    assert len(requested) <= 10


def test_all_unreachable_poses_are_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    requested: list[Pose] = []
    monkeypatch.setattr(looking, "_refusal", refusing("UNREACHABLE", requested))
    list(looking.look_at(NO_ARM, iter([Pose.identity()] * 156), 1.0))
    assert len(requested) == 156
