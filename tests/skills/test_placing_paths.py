"""`place` follows one branch of the inverse kinematics, from above the goal through the retreat."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bt_dualarm as bt
from bt_dualarm.behaviors.report import LeafReport
from bt_dualarm.collision.checker import contact_of_links
from tests.families import some


def placed(robot: str, gripper: str, objects: dict[str, Any], *leaves: Any) -> LeafReport:
    """Report of the last leaf of a run with an arm beside the table."""
    arm = {"robot": robot, "gripper": gripper, "base": {"xyz": [0, 0, 0.4]}}
    result = bt.run(
        {
            "bt_dualarm": 1,
            "name": "placing",
            "world": {"scene": "table", "reality": "lab", "seed": 0, "time_limit": 60},
            "objects": objects,
            "arms": {"arm1": arm | {"tree": {"sequence": list(leaves)}}},
        }
    )
    return result.arms["arm1"].runs[-1]


def board(x: float, y: float, z: float) -> dict[str, Any]:
    """A fixed board with its center at (x, y, z)."""
    pose = {"xyz": [x, y, z]}
    return {"shape": "box", "size": [0.25, 0.25, 0.02], "mass": 5, "fixed": True, "pose": pose}


def in_shelf(yaw: float, obj: dict[str, Any]) -> LeafReport:
    """A Panda's `place` into a shelf, at a yaw in °, of an object grasped from the side."""
    return placed(
        "panda",
        "panda_hand",
        {
            "thing": obj | {"pose": {"xyz": [0.40, -0.40, 0.45]}},
            "low": board(0.55, 0.1, 0.55),
            "high": board(0.55, 0.1, 0.83),
        },
        {"grasp": {"object": "thing", "approach": [0, -1, 0]}},
        {"transport": {"object": "thing", "to": {"xyz": [0.40, -0.2, 0.70]}}},
        {"place": {"object": "thing", "at": {"xyz": [0.55, 0.1, 0.61], "rpy": [0, 0, yaw]}}},
    )


@pytest.mark.parametrize("yaw", some([45, 105, 90], 2))
def test_panda_places_sideways_into_a_shelf_after_transport(yaw: float) -> None:
    """It failed: the line down began 13.7° from the current joint angles, in another posture.

    At 90° the goal is in reach, but not the point 50 mm above it.
    """
    leaf = in_shelf(yaw, {"shape": "cylinder", "size": [0.025, 0.10], "mass": 0.3})
    assert (leaf.skill, leaf.status) == ("place", "SUCCESS"), leaf.reason
    assert float(leaf.metrics["placed_error_m"]) < 2e-3
    assert "spun_rad" not in leaf.metrics
    assert ("lowered_from_m" in leaf.metrics) == (yaw == 90)


def test_round_object_is_rotated_to_make_its_goal_reachable() -> None:
    """The requested orientation is out of reach from any height; the rotation is invisible.

    The retreat is as long as was checked before, including the first 3 mm of coming off: here
    3 mm more are singular.
    """
    leaf = in_shelf(-135, {"shape": "cylinder", "size": [0.025, 0.10], "mass": 0.3})
    assert (leaf.skill, leaf.status) == ("place", "SUCCESS"), leaf.reason
    assert abs(float(leaf.metrics["spun_rad"])) == pytest.approx(np.radians(15))
    assert float(leaf.metrics["placed_error_m"]) < 2e-3


def test_box_is_rotated_by_its_symmetry_only() -> None:
    """A quarter turn of a square base is invisible; 15° would not be."""
    leaf = in_shelf(-45, {"shape": "box", "size": [0.05, 0.05, 0.10], "mass": 0.3})
    assert (leaf.skill, leaf.status) == ("place", "SUCCESS"), leaf.reason
    turned = abs(float(leaf.metrics["spun_rad"]))
    assert min(abs(turned - np.pi / 2), abs(turned - np.pi)) < 1e-9
    assert float(leaf.metrics["placed_turned_rad"]) < np.radians(1.0)


@pytest.mark.parametrize(
    ("robot", "gripper", "yaw", "heading"),
    some(
        [
            ("panda", "panda_hand", 0, 20),
            ("fr3", "panda_hand", 80, -33),
            ("ur5e", "robotiq_2f85", 80, -33),
            ("xarm7", "panda_hand", -60, -15),
        ],
        2,
    ),
)
def test_object_is_rotated_to_fit_between_the_walls_of_a_bin(
    robot: str, gripper: str, yaw: float, heading: float
) -> None:
    """It failed with `IN_COLLISION`: the block kept the angle at which it had been grasped."""
    bin_ = {"shape": "bin", "size": [0.12, 0.07, 0.04]}
    leaf = placed(
        robot,
        gripper,
        {
            "block": {"shape": "box", "size": [0.06, 0.03, 0.05], "mass": 0.1}
            | {"pose": {"xyz": [0.45, -0.35, 0.4255], "rpy": [0, 0, yaw]}},
            "crate": bin_
            | {"wall": 0.004, "mass": 0.3, "fixed": True}
            | {"pose": {"xyz": [0.45, 0.2, 0.4205], "rpy": [0, 0, heading]}},
        },
        {"grasp": {"object": "block"}},
        {"place": {"at": {"on": "crate"}}},
    )
    assert (leaf.skill, leaf.status) == ("place", "SUCCESS"), leaf.reason
    turned = np.degrees(leaf.metrics["heading_rad"])
    off = [(yaw + way * turned - heading + 45.0) % 90.0 - 45.0 for way in (1.0, -1.0)]
    assert min(map(abs, off)) < 3.0


def test_given_orientation_is_kept() -> None:
    """Only `at` without an orientation leaves the heading to `place`.

    The block meets the bin in every branch of the inverse kinematics: one is enough to tell. It
    took 0.7 s of simulated time to try sixteen.
    """
    at = {"xyz": [0.45, 0.2, 0.448], "rpy": [0, 0, 45]}
    leaf = placed(
        "panda",
        "panda_hand",
        {
            "block": {"shape": "box", "size": [0.06, 0.03, 0.05], "mass": 0.1}
            | {"pose": {"xyz": [0.45, -0.35, 0.4255]}},
            "crate": {"shape": "bin", "size": [0.12, 0.07, 0.04], "wall": 0.004, "mass": 0.3}
            | {"fixed": True, "pose": {"xyz": [0.45, 0.2, 0.4205]}},
        },
        {"grasp": {"object": "block"}},
        {"place": {"at": at}},
    )
    assert (leaf.status, leaf.code) == ("FAILURE", "IN_COLLISION"), leaf.reason
    assert leaf.ended_s is not None
    assert leaf.ended_s - leaf.started_s < 0.1


def stand(x: float, y: float) -> dict[str, Any]:
    """A fixed stand of 0.2 m with its center at (x, y)."""
    pose = {"xyz": [x, y, 0.1]}
    return {"shape": "box", "size": [0.12, 0.12, 0.2], "mass": 1, "fixed": True, "pose": pose}


def test_arm_waits_for_another_one_where_a_rotated_box_is_to_stand() -> None:
    """As requested, the hand would be out of reach; turned by 180°, it is where the other is."""
    result = bt.run(
        {
            "bt_dualarm": 1,
            "world": {"scene": "empty"},
            "objects": {
                "bar": {"shape": "box", "size": [0.24, 0.04, 0.04], "mass": 0.2}
                | {"pose": {"xyz": [0.45, -0.4, 0.2203]}},
                "from": stand(0.45, -0.4),
                "to": stand(0.88, 0.0),
            },
            "cell": {"signals": {"there": {"type": "boolean", "written_by": ["other"]}}},
            "arms": {
                "arm1": {
                    "robot": "ur5",
                    "gripper": "robotiq_2f85",
                    "tree": {
                        "sequence": [
                            {"await": "there"},
                            {"grasp": {"object": "bar", "point": [0.09, 0, 0]}},
                            {"place": {"at": {"xyz": [0.88, 0, 0.2203], "rpy": [0, 0, 0]}}},
                        ]
                    },
                },
                "other": {
                    "robot": "ur5",
                    "base": {"xyz": [0.8, 0.7, 0], "rpy": [0, 0, -90]},
                    "tree": {
                        "sequence": [
                            {
                                "reach_to_pose": {
                                    "to": {"xyz": [0.78, 0.02, 0.42], "rpy": [180, 0, 0]}
                                }
                            },
                            {"signal": "there"},
                            {"wait": 8},
                            "go_home",
                        ]
                    },
                },
            },
        }
    )
    leaf = result.arms["arm1"].runs[-1]
    assert (leaf.skill, leaf.status) == ("place", "SUCCESS"), leaf.reason
    assert abs(float(leaf.metrics["spun_rad"])) == pytest.approx(np.pi)


def test_marked_box_is_not_rotated() -> None:
    """Its marker would not be where it was requested."""
    marked = {"shape": "box", "size": [0.05, 0.05, 0.10], "mass": 0.3}
    leaf = in_shelf(-45, marked | {"marker": {"id": 1, "size": 0.03}})
    assert (leaf.skill, leaf.code) == ("place", "SINGULAR"), leaf.reason
    assert "impact_n" not in leaf.metrics, "refused before any motion"


@pytest.mark.parametrize(
    ("robot", "gripper", "room", "x"),
    some([("ur10", "robotiq_2f85", 0.03, 0.60), ("xarm7", "panda_hand", 0.02, 0.48)], 2),
)
def test_lowering_starts_lower_under_a_board(
    robot: str, gripper: str, room: float, x: float
) -> None:
    """`room` is the free height above the object, less than the usual 50 mm of lowering."""
    leaf = placed(
        robot,
        gripper,
        {
            "brick": {"shape": "box", "size": [0.04, 0.04, 0.10], "mass": 0.2}
            | {"pose": {"xyz": [0.40, -0.40, 0.4505]}},
            "low": board(x + 0.07, 0.1, 0.55),
            "high": board(x + 0.07, 0.1, 0.66 + room + 0.01),
        },
        {"grasp": {"object": "brick", "approach": [1, 0, 0]}},
        {"place": {"object": "brick", "at": {"xyz": [x, 0.1, 0.61], "rpy": [0, 0, 0]}}},
    )
    assert (leaf.skill, leaf.status) == ("place", "SUCCESS"), leaf.reason
    assert 0.008 <= float(leaf.metrics["lowered_from_m"]) < room
    assert float(leaf.metrics["placed_error_m"]) < 2e-3


def test_stretched_arm_lowers_as_slowly_as_required() -> None:
    """Far out, 2 mm/s is less than a thousandth of the UR10's limits: it raised an exception."""
    leaf = placed(
        "ur10",
        "robotiq_2f85",
        {
            "cube": {"shape": "box", "size": [0.05, 0.05, 0.05], "mass": 0.2}
            | {"pose": {"xyz": [0.60, -0.40, 0.425]}},
            "shelf": board(0.95, -0.3, 0.39),
        },
        {"grasp": {"object": "cube"}},
        {"place": {"object": "cube", "at": {"xyz": [0.90, -0.3, 0.425]}}},
    )
    assert (leaf.skill, leaf.status) == ("place", "SUCCESS"), leaf.reason
    assert float(leaf.metrics["impact_n"]) < 15.0


def test_tilted_object_is_refused_with_its_tilt_as_the_reason() -> None:
    """Without an orientation, the goal has that of the hand, which has rotated since the grasp.

    Halfway between two axes, neither is meant.
    """
    box = {"shape": "box", "size": [0.06, 0.06, 0.06], "mass": 0.2}
    leaf = placed(
        "ur5",
        "robotiq_2f85",
        {"thing": box | {"pose": {"xyz": [0.40, -0.45, 0.43]}}},
        {"grasp": {"object": "thing"}},
        {"rotate_tool": {"axis": "x", "angle": 45}},
        {"place": {"at": {"xyz": [0.35, -0.45, 0.43]}}},
    )
    assert leaf.code == "IN_COLLISION", leaf
    assert "no orientation" in leaf.reason
    assert "45° from upright" in leaf.reason


def test_no_link_touches_the_object_on_the_retreat() -> None:
    """The upper arm tipped the post over: the check of the retreat left out the object."""
    stand: dict[str, Any] = {"shape": "box", "fixed": True, "color": "gray"}
    at = {"xyz": [0.836, 0.281, 0.382], "rpy": [0, 0, -50]}
    givers = [{"grasp": {"object": "post"}}, {"hand_over": {"object": "post", "to": "b"}}]
    takers = [
        {"take_over": {"object": "post", "from": "a", "then_at": at}},
        {"place": {"object": "post", "at": at}},
    ]
    result = bt.run(
        {
            "bt_dualarm": 1,
            "world": {"scene": "empty", "reality": "rough", "seed": 2, "time_limit": 160},
            "objects": {
                "from": stand
                | {"size": [0.16, 0.16, 0.201], "pose": {"xyz": [0.244, 0.374, 0.1005]}},
                "onto": stand
                | {"size": [0.16, 0.16, 0.307], "pose": {"xyz": [0.836, 0.281, 0.1535]}},
                "post": {"shape": "box", "size": [0.022, 0.035, 0.149], "mass": 0.237}
                | {"pose": {"xyz": [0.244, 0.374, 0.276], "rpy": [0, 0, -17]}},
            },
            "arms": {
                "a": {
                    "robot": "ur5",
                    "gripper": "robotiq_2f85",
                    "tree": {"sequence": [*givers, "go_home"]},
                },
                "b": {
                    "robot": "ur5e",
                    "gripper": "robotiq_2f85",
                    "base": {"xyz": [1.128, 0, 0], "rpy": [0, 0, 180]},
                    "tree": {"sequence": takers},
                },
            },
        }
    )
    leaf = result.arms["b"].runs[-1]
    assert leaf.status == "SUCCESS", f"{leaf.code}: {leaf.reason}"


def test_links_beside_an_object_are_found_on_a_path() -> None:
    post: dict[str, Any] = {"shape": "box", "size": [0.05, 0.05, 1.0], "mass": 1}
    post["pose"] = {"xyz": [0.3, 0.3, 0.501]}
    file = {
        "bt_dualarm": 1,
        "world": {"scene": "empty"},
        "objects": {"post": post},
        "arms": {"arm": {"robot": "ur5e", "tree": "go_home"}},
    }
    with bt.open(file) as run:
        world = run.world
        pose = world.object_pose("post")
        q = world.hardware["arm"].q
        turned = q + np.linspace(0.0, 1.0, 60)[:, None] * np.eye(6)[0] * np.pi
        found = [
            contact_of_links(world, "arm", "post", pose, rows, 0.003)
            for rows in (q[None], turned, turned[::-1])
        ]
        assert found[0] is None
        for contact in found[1:]:
            assert contact is not None
            assert contact.first.startswith("arm/")
            assert contact.second == "post"
        # Beside the object at its beginning, a path may go on as near to it.
        assert found[1] is not None
        near = np.array(found[1].at)
        before = near - 0.04 * np.eye(6)[0]
        assert (
            contact_of_links(world, "arm", "post", pose, np.array((before, before)), 0.05) is None
        )
        assert (
            contact_of_links(world, "arm", "post", pose, np.array((before, turned[-1])), 0.05)
            is None
        )
