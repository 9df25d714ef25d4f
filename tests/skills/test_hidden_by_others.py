"""Another arm before the camera: what it hides is looked at from another side."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bt_dualarm as bt

ROBOTS = ("panda", "ur5e", "ur10", "fr3", "xarm7")
WATCHED = np.array((0.5, 0.0, 0.03))


def behind_another(seed: int) -> dict[str, Any]:
    """An object, a camera that looks at it, and another arm whose tool goes between them."""
    random = np.random.default_rng([77, seed])
    eye, other = str(random.choice(ROBOTS)), str(random.choice(ROBOTS))
    shape = str(random.choice(("box", "cylinder", "box")))
    edges = [0.05, 0.05, 0.05] if random.random() < 0.5 else [0.04, 0.06, 0.05]
    size = [0.03, 0.05] if shape == "cylinder" else edges
    sight = np.array((random.uniform(-0.3, 0.3), random.uniform(-0.3, 0.3), -1.0))
    sight /= np.linalg.norm(sight)
    side = np.cross(sight, random.normal(size=3))
    side /= np.linalg.norm(side)
    tool = WATCHED - random.uniform(0.1, 0.2) * sight + side * random.uniform(0.0, 0.05)
    thing = {"shape": shape, "size": size, "color": "yellow", "mass": 0.1}
    turned = [0, 0, float(random.uniform(-40, 40))]
    looks = {"at": {"xyz": WATCHED.tolist()}, "distance": 0.45, "direction": sight.tolist()}
    base = {"xyz": [1.1, float(random.choice((-0.2, 0.2))), 0], "rpy": [0, 0, 180]}
    return {
        "bt_dualarm": 1,
        "name": "hidden",
        "world": {"scene": "empty", "reality": str(random.choice(("ideal", "lab"))), "seed": seed},
        "objects": {"thing": {**thing, "pose": {"xyz": [0.5, 0, 0.0255], "rpy": turned}}},
        "arms": {
            "eye": {
                "robot": eye,
                "camera": {},
                "gripper": "robotiq_2f85",
                "tree": {
                    "sequence": [
                        {"look_at": looks},
                        {"wait": {"seconds": 6}},
                        {"locate": {"object": "thing", "accuracy": 0.002, "score": "thing"}},
                    ]
                },
            },
            "other": {
                "robot": other,
                "base": base,
                "tree": {
                    "sequence": [
                        {"wait": {"seconds": 3}},
                        {"reach_to_pose": {"to": {"xyz": tool.tolist()}}},
                        {"wait": {"seconds": 4}},
                    ]
                },
            },
        },
    }


@pytest.mark.parametrize("seed", [9, 12, 15, 18, 20, 26, 28, 29])
def test_locate_looks_past_another_arm(seed: int) -> None:
    result = bt.run(behind_another(seed))
    leaf = next(one for one in result.arms["eye"].runs if "locate" in one.path)
    assert leaf.status == "SUCCESS", f"{leaf.code}: {leaf.reason}"
    assert float(leaf.metrics["located_error_m"]) < 0.003
    assert int(leaf.metrics["views"]) > 1


def test_an_object_that_is_nowhere_is_not_seen_and_the_arm_before_it_is_named() -> None:
    file = behind_another(0)
    file["objects"]["thing"]["color"] = "red"
    locate = file["arms"]["eye"]["tree"]["sequence"][2]["locate"]
    locate["color"] = "green"
    leaf = bt.run(file).arms["eye"].runs[-1]
    assert leaf.code == "NOT_SEEN"
    assert "other is in" in leaf.reason


def test_place_looks_again_where_another_arm_hides_a_part() -> None:
    """The arm that handed the post over stands before the camera that then verifies its pose."""
    stand = {"shape": "box", "mass": 5, "color": "gray", "fixed": True}
    file = {
        "bt_dualarm": 1,
        "name": "verified",
        "world": {"scene": "empty", "reality": "ideal", "time_limit": 240},
        "objects": {
            "from": stand | {"size": [0.14, 0.14, 0.225], "pose": {"xyz": [0.301, 0.368, 0.1125]}},
            "onto": stand | {"size": [0.16, 0.16, 0.225], "pose": {"xyz": [0.735, 0.45, 0.1125]}},
            "part": {
                "shape": "box",
                "size": [0.035, 0.035, 0.165],
                "mass": 0.209,
                "color": "red",
                "pose": {"xyz": [0.301, 0.368, 0.308], "rpy": [0, 0, -9.0]},
            },
        },
        "arms": {
            "arm1": {
                "robot": "panda",
                "gripper": "panda_hand",
                "tree": {
                    "sequence": [
                        {"grasp": {"object": "part"}},
                        {"hand_over": {"object": "part", "to": "arm2"}},
                        "go_home",
                    ]
                },
            },
            "arm2": {
                "robot": "ur10e",
                "gripper": "robotiq_2f85",
                "base": {"xyz": [1.445, 0, 0], "rpy": [0, 0, 180]},
                "camera": {},
                "tree": {
                    "sequence": [
                        {"take_over": {"object": "part", "from": "arm1"}},
                        {
                            "place": {
                                "object": "part",
                                "at": {"xyz": [0.735, 0.45, 0.308], "rpy": [0, 0, 0]},
                                "look": True,
                            }
                        },
                    ]
                },
            },
        },
    }
    result = bt.run(file)
    place = result.arms["arm2"].runs[-1]
    assert place.status == "SUCCESS", f"{place.code}: {place.reason}"
    assert float(place.metrics["seen_error_m"]) < 0.005
