"""Measurements in a world: gaps, contacts and surface points."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from bt_dualarm.core.pose import Pose
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.values import PoseSpec
from tests.sim.worlds import arm, box, file_of


def test_tool_touches_an_adjacent_object() -> None:
    world = World(file_of({"arm1": arm("ur5")}, {"cube": box((0.5, 0.4, 0.025))}))
    tool = world.arms["arm1"].tool_pose
    world.remove_object("cube")
    world.spawn_object("cube", tool @ Pose.from_rpy((0.0, 0.0, 0.035)))
    assert world.tool_gap("arm1", "cube") == pytest.approx(0.01, abs=1e-4)
    assert not world.touches("arm1", "cube")
    world.remove_object("cube")
    world.spawn_object("cube", tool @ Pose.from_rpy((0.0, 0.0, 0.0245)))
    assert world.tool_gap("arm1", "cube") == pytest.approx(-0.0005, abs=1e-4)
    assert world.touches("arm1", "cube")


def test_wide_gaps_are_measured() -> None:
    """The gap increases with the distance beyond a meter."""
    world = World(file_of({"arm1": arm("ur5")}, {"cube": box((0.5, 0.4, 0.025))}))
    tool = world.arms["arm1"].tool_pose
    gaps = []
    for distance in (0.7, 2.7, 12.7, 80.7):
        world.remove_object("cube")
        world.spawn_object("cube", Pose.from_rpy((distance, 0.0, 0.0), (0, 0, 0)) @ tool)
        gaps.append(world.tool_gap("arm1", "cube"))
    assert np.diff(gaps) == pytest.approx([2.0, 10.0, 68.0], rel=1e-3)


@pytest.mark.parametrize(
    ("shape", "size", "reach"),
    [
        ("box", (0.2, 0.4, 0.6), 0.1),
        ("cylinder", (0.15, 0.6), 0.15),
        ("capsule", (0.15, 0.6), 0.15),
        ("sphere", (0.12,), 0.12),
    ],
)
def test_surface_point_is_on_the_surface(shape: Any, size: tuple[float, ...], reach: float) -> None:
    obj = ObjectSpec(shape=shape, size=size, mass=1.0, pose=PoseSpec(xyz=(0.5, 0.4, 1.0)))
    world = World(file_of({"arm1": arm("ur5")}, {"thing": obj}))
    point = world.surface_point("thing", np.array([1.0, 0.0, 0.0]))
    assert point == pytest.approx([0.5 + reach, 0.4, 1.0])


@pytest.mark.parametrize("degrees", [0, 10, 30, 45, 60, 89, 90])
def test_rays_leave_a_capsule_as_in_mujoco(degrees: float) -> None:
    """Through its side and through its ends."""
    obj = ObjectSpec(
        shape="capsule", size=(0.04, 0.1), mass=1.0, pose=PoseSpec(xyz=(0.5, 0.4, 1.0))
    )
    world = World(file_of({"arm1": arm("ur5")}, {"thing": obj}))
    angle = np.radians(degrees)
    direction = np.array([np.sin(angle), 0.0, np.cos(angle)])
    point = world.surface_point("thing", direction)
    geom = world.object_geom("thing")
    start = point + 0.2 * direction
    hit = np.full(1, -1, dtype=np.int32)
    far = mujoco.mj_ray(world.model, world.data, start, -direction, None, 1, -1, hit)
    assert int(hit[0]) == geom
    assert far == pytest.approx(0.2, abs=1e-9)
