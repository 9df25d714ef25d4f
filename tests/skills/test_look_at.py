"""Looking at a point from the first of many poses to which there is a path."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any, cast

import pytest

from bt_dualarm.arm.arm import Arm
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose
from bt_dualarm.skill import looking

NO_ARM = cast("Arm", None)


def refusing(code: str, tried: list[Pose]) -> Any:
    """A motion to a pose of the camera that fails with a code, and notes the pose."""

    def refusal(
        _: Arm, camera: Pose, speed: float, ignore: frozenset[str]
    ) -> Generator[None, None, Failure]:
        tried.append(camera)
        yield None
        return Failure(code, f"at {speed}, {ignore}")

    return refusal


def test_an_enclosed_arm_does_not_search_for_a_path_to_every_pose(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With a cube held in a hole, each of 156 poses took seconds: the run stood for minutes."""
    tried: list[Pose] = []
    monkeypatch.setattr(looking, "_refusal", refusing("NO_PLAN", tried))
    with pytest.raises(Failure, match="NO_PLAN"):
        list(looking.look_at(NO_ARM, iter([Pose.identity()] * 156), 1.0))
    assert len(tried) <= 10


def test_poses_out_of_reach_cost_little_and_are_all_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[Pose] = []
    monkeypatch.setattr(looking, "_refusal", refusing("UNREACHABLE", tried))
    list(looking.look_at(NO_ARM, iter([Pose.identity()] * 156), 1.0))
    assert len(tried) == 156
