"""`scan`: areas that an image shows in part are viewed first, seen areas are skipped."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from bt_dualarm.core.pose import Pose
from bt_dualarm.sim.frame import Frame
from bt_dualarm.skill.looking import Coverage
from tests.families import some
from tests.plays import Stage

DOWN = Pose.from_rpy((0.0, 0.0, 0.5), (np.pi, 0.0, 0.0))
CENTERS = [np.array((x, 0.0, 0.0)) for x in (-0.3, 0.0, 0.3)]


def frame(camera: Pose) -> Frame:
    """A frame of 320 by 240 pixels that shows 0.53 by 0.4 m from 0.5 m away."""
    return cast("Frame", SimpleNamespace(width=320, height=240, focal_px=300.0, pose=camera))


def test_seen_area_is_not_viewed_again() -> None:
    left = Coverage(CENTERS, (0.3, 0.3))
    left.take(frame(DOWN), 0.02)
    found = [left.nearest(DOWN), left.nearest(DOWN), left.nearest(DOWN)]
    assert sorted(float(one[0]) for one in found if one is not None) == [-0.3, 0.3]


def test_area_behind_the_camera_is_not_seen() -> None:
    left = Coverage(CENTERS[1:2], (0.1, 0.1))
    left.take(frame(Pose.from_rpy((0.0, 0.0, 0.5))), 0.0)
    assert left.nearest(DOWN) is not None


def test_nearest_area_comes_first() -> None:
    left = Coverage(CENTERS, (0.3, 0.3))
    beside = Pose(np.array((0.4, 0.0, 0.5)), DOWN.quaternion)
    order = [left.nearest(beside) for _ in range(4)]
    assert [None if part is None else float(part[0]) for part in order] == [0.3, 0.0, -0.3, None]


HIDDEN = np.zeros((30, 40), bool)
"""The hand hides the lowest 40 pixels of the image: the parts toward -y, seen from above."""
HIDDEN[25:] = True


def test_area_hidden_by_the_hand_is_not_seen() -> None:
    left = Coverage([np.array((0.0, -0.14, 0.0)), np.array((0.0, 0.1, 0.0))], (0.1, 0.1))
    left.take(frame(DOWN), 0.01, HIDDEN)
    assert left.nearest(DOWN) == pytest.approx((0.0, -0.14, 0.0))
    assert left.nearest(DOWN) is None


def test_hidden_part_of_an_area_is_viewed_once_more() -> None:
    left = Coverage([np.zeros(3)], (0.1, 0.36))
    assert left.nearest(DOWN) == pytest.approx((0.0, 0.0, 0.0))
    left.take(frame(DOWN), 0.01, HIDDEN)
    again = left.nearest(DOWN)
    assert again is not None
    assert again[1] < -0.1
    left.take(frame(DOWN), 0.01, np.ones_like(HIDDEN))
    assert left.nearest(DOWN) is None


@pytest.mark.parametrize(
    ("x", "y"),
    some(
        [(0.25, -0.32), (0.25, -0.30), (0.36, -0.30), (0.36, -0.32), (0.47, -0.32), (0.47, -0.30)],
        2,
    ),
)
def test_object_partly_hidden_by_the_fingers_is_found(x: float, y: float, stage: Stage) -> None:
    """The first image shows a part of it; the area counted as seen, and was not viewed again."""
    cube = {"shape": "box", "size": [0.05] * 3, "mass": 0.1, "color": "red"}
    arm = {
        "robot": "xarm7",
        "gripper": "robotiq_2f85",
        "base": {"xyz": [0.35, 0.0, 0.4], "rpy": [0, 0, -90]},
        "camera": {"mount": "wrist", "resolution": [320, 240], "fov": 50, "fps": 30},
    }
    leaves: list[Any] = [
        {"look_at": {"at": {"xyz": [0.35, -0.45, 0.40]}, "distance": 0.45, "speed": 1.0}},
        {"scan": {"object": "cube", "center": [0.35, -0.5, 0.4], "speed": 1.0}},
    ]
    file: dict[str, Any] = {
        "world": {"scene": "table", "reality": "lab", "time_limit": 60},
        "objects": {"cube": cube | {"pose": {"xyz": [x, y, 0.425], "rpy": [0, 0, 20]}}},
        "arms": {"arm1": arm | {"tree": {"sequence": leaves}}},
    }
    play = stage.play(file)
    play.run()
    assert play.leaf("scan").status == "SUCCESS", play.leaf("scan")


BESIDE = [0.35, -0.28, 0.4]
"""Point at the center of an image whose border cuts the cube off."""


TABLE_TOP = {"size": [0.5, 0.4, 0.1], "pose": {"xyz": [0.35, -0.5, 0.44]}}
"""Region in which the cube is that the border cuts off."""


@pytest.mark.parametrize("robot", ["ur5", "panda"])
@pytest.mark.parametrize("area", [{"center": [0.35, -0.5, 0.4]}, {"region": TABLE_TOP}])
def test_object_at_the_image_border_is_viewed_next(
    robot: str, area: dict[str, Any], stage: Stage
) -> None:
    """The rows of viewpoints began elsewhere, and reached it third."""
    file: dict[str, Any] = {
        "world": {"scene": "table", "reality": "lab", "time_limit": 60},
        "objects": {"cube": {"shape": "box", "size": [0.05, 0.05, 0.05], "mass": 0.1}},
        "arms": {"arm1": {"robot": robot, "camera": {}}},
    }
    file["objects"]["cube"] |= {"color": "red", "pose": {"xyz": [0.35, -0.46, 0.425]}}
    arm = file["arms"]["arm1"] | {"base": {"xyz": [0.35, 0.0, 0.4], "rpy": [0, 0, -90]}}
    look = {"look_at": {"at": {"xyz": BESIDE}, "distance": 0.35, "speed": 1.0}}
    scan = {"scan": {"object": "cube", "speed": 1.0} | area}
    file["arms"]["arm1"] = arm | {"tree": {"sequence": [look, scan]}}
    leaf = stage.run(file, seed=1).leaf("scan")
    assert leaf.status == "SUCCESS", leaf.reason
    assert leaf.metrics["places"] == 1
    assert (leaf.ended_s or 0.0) - leaf.started_s < 1.2


@pytest.mark.parametrize("robot", ["ur5", "panda"])
def test_an_empty_area_that_is_in_view_is_not_out_of_reach(robot: str, stage: Stage) -> None:
    """It called every viewpoint unreachable where none was needed."""
    file: dict[str, Any] = {
        "world": {"scene": "table", "reality": "ideal", "time_limit": 60},
        "objects": {"cube": {"shape": "box", "size": [0.05, 0.05, 0.05], "mass": 0.1}},
        "arms": {"arm1": {"robot": robot, "camera": {}}},
    }
    file["objects"]["cube"] |= {"color": "red", "pose": {"xyz": [-0.35, -0.4, 0.425]}}
    arm = file["arms"]["arm1"] | {"base": {"xyz": [0.35, 0.0, 0.4], "rpy": [0, 0, -90]}}
    look = {"look_at": {"at": {"xyz": [0.35, -0.44, 0.4]}, "distance": 0.4, "speed": 1.0}}
    scan = {"scan": {"object": "cube", "center": [0.35, -0.44, 0.4], "width": 0.08, "depth": 0.05}}
    file["arms"]["arm1"] = arm | {"tree": {"sequence": [look, scan]}}
    leaf = stage.run(file, seed=1).leaf("scan")
    assert leaf.code == "NOT_SEEN", leaf.reason
    assert "from where the arm was" in leaf.reason


def test_the_arm_itself_is_not_in_the_way_of_its_view(stage: Stage) -> None:
    """The camera on the side of the hand looked at link 5, and the cube was `NOT_SEEN`."""
    x, y = 0.487, 0.182
    cube = {"shape": "box", "size": [0.044] * 3, "mass": 0.1, "color": "blue"}
    bench = {"shape": "box", "size": [0.5, 0.5, 0.176], "mass": 5, "fixed": True}
    scan = {"object": "cube", "center": [x, y, 0.1985], "width": 0.25, "depth": 0.15}
    file = {
        "world": {"scene": "empty"},
        "objects": {
            "bench": bench | {"pose": {"xyz": [x, y, 0.088]}},
            "cube": cube | {"pose": {"xyz": [x - 0.09, y - 0.06, 0.1985]}},
        },
        "arms": {"arm1": {"robot": "panda", "camera": {}, "tree": {"scan": scan}}},
    }
    leaf = stage.run(file).leaf("scan")
    assert leaf.status == "SUCCESS", leaf
