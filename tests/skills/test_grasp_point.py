"""Grasp point on the object, opening of the fingers, and the weight that the gripper measures."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.core.pose import Vector
from bt_dualarm.grasping.candidates import jaw_grasps
from bt_dualarm.grasping.grasp import Box, Capsule, Cylinder, JawMeasures, Load, Solid
from tests.plays import Stage
from tests.skills.scenarios import Tree

JAW = JawMeasures(
    least_opening=0.0, widest_opening=0.085, pad_length=0.022, pad_width=0.022, palm=0.05,
    tip=0.012, thickness=0.02, least_force=1.0, most_force=200.0, friction=0.8, pad_center=0.0,
)  # fmt: skip
LOAD = Load(0.3, np.array((0.0, 0.0, -9.81)), 4.0, np.zeros(3))


@pytest.mark.parametrize(
    ("solid", "point"),
    [
        (Box(np.array((0.02, 0.1, 0.03))), np.array((0.0, 0.05, 0.01))),
        (Cylinder(0.02, 0.1), np.array((0.01, 0.0, -0.06))),
        (Capsule(0.02, 0.1), np.array((0.0, 0.0, 0.07))),
    ],
    ids=["box", "cylinder", "capsule"],
)
def test_pads_close_at_the_given_point(solid: Solid, point: Vector) -> None:
    """Deviations along the closing direction do not count."""
    found = jaw_grasps(solid, JAW, LOAD, JAW.friction, point=point)
    assert found
    deviations = []
    for grasp in found:
        across = grasp.tool.rotation_matrix[:, 1]
        offset = point - grasp.tool.position
        deviations.append(float(np.linalg.norm(offset - (offset @ across) * across)))
    # A round object is grasped at its axis.
    assert min(deviations) < (0.005 if isinstance(solid, Box) else 0.0151)


BAR = {"shape": "box", "size": [0.04, 0.16, 0.04], "mass": 0.3}


def picking(
    stage: Stage, gripper: str, robot: str, ports: Tree, reality: str | Tree = "lab"
) -> Tree:
    play = stage.play(
        {
            "world": {"scene": "table", "reality": reality, "time_limit": 30},
            "objects": {"bar": {**BAR, "pose": {"xyz": [0.35, -0.42, 0.42]}}},
            "arms": {
                "arm1": {
                    "robot": robot,
                    "gripper": gripper,
                    "base": {"xyz": [0, 0, 0.4]},
                    "tree": {"grasp": {"object": "bar", **ports}},
                }
            },
        }
    )
    widths: list[float] = []

    def record_width(world) -> None:  # type: ignore[no-untyped-def]
        widths.append(world.grippers["arm1"].width)

    play.watchers.append(record_width)
    play.run()
    leaf = play.leaf("grasp")
    held = play.world.attachments.find("arm1", "bar")
    tool = None
    if held is not None:
        arm = play.world.robots["arm1"].tool
        tool = held.relative.inverse @ arm
    return {"play": play, "leaf": leaf, "widest": max(widths[len(widths) // 10 :]), "tool": tool}


@pytest.mark.parametrize(
    ("robot", "gripper"),
    [("ur5", "robotiq_2f85"), ("panda", "panda_hand"), ("xarm7", "suction_cup")],
)
def test_object_is_held_at_the_given_point(robot: str, gripper: str, stage: Stage) -> None:
    found = picking(stage, gripper, robot, {"point": [0, 0.05, 0]})
    leaf = found["leaf"]
    assert leaf.status == "SUCCESS", leaf.reason
    assert found["tool"].position[1] == pytest.approx(0.05, abs=0.008)
    assert float(leaf.metrics["point_off_m"]) < 0.02
    assert ("width_error_m" in leaf.metrics) == (gripper != "suction_cup")


def test_fingers_open_no_wider_than_requested(stage: Stage) -> None:
    found = picking(stage, "robotiq_2f85", "ur5", {"open_to": 0.055})
    assert found["leaf"].status == "SUCCESS", found["leaf"].reason
    assert found["widest"] < 0.058


@pytest.mark.parametrize(
    ("gripper", "ports", "code", "reason"),
    [
        ("robotiq_2f85", {"open_to": 0.03}, "TOO_WIDE", "the fingers open to 30 mm"),
        ("robotiq_2f85", {"point": [0, 0.3, 0]}, "NO_FACE", "mm"),
        ("suction_cup", {"open_to": 0.03}, "INVALID_TARGET", "has no fingers"),
        ("suction_cup", {"point": [0.015, 0.07, 0.02]}, "NO_FACE", "cup seals at `point`"),
        ("suction_cup", {"point": [0, 0.05, 0], "mass": 1.9}, "TOO_HEAVY", "at `point` bears"),
    ],
)
def test_impossible_grasp_is_refused_with_its_reason(
    gripper: str, ports: Tree, code: str, reason: str, stage: Stage
) -> None:
    leaf = picking(stage, gripper, "ur5", ports)["leaf"]
    assert (leaf.status, leaf.code) == ("FAILURE", code)
    assert reason in leaf.reason


@pytest.mark.parametrize("gripper", ["robotiq_2f85", "suction_cup"])
def test_deviation_from_the_declared_weight_is_measured(gripper: str, stage: Stage) -> None:
    """The true mass deviates from the declared one, joints have no friction."""
    found = picking(stage, gripper, "ur5", {}, {"payload": {"mass": 0.4}})
    leaf = found["leaf"]
    assert leaf.status == "SUCCESS", leaf.reason
    world = found["play"].world
    true_n = 9.81 * float(world.model.body_mass[world.object_body("bar")])
    assert abs(true_n - 0.3 * 9.81) > 0.2
    assert float(leaf.metrics["weight_error_n"]) == pytest.approx(true_n - 0.3 * 9.81, abs=0.15)


def test_grasp_is_refused_if_the_lift_leaves_the_workspace(stage: Stage) -> None:
    """The gripper closed first, and only then did the lift fail."""
    objects = {"bar": {**BAR, "pose": {"xyz": [0.35, -0.72, 0.42]}}}
    arm = {"robot": "ur5", "gripper": "robotiq_2f85", "base": {"xyz": [0, 0, 0.4]}}
    tree = {"grasp": {"object": "bar", "approach": [0, 0, -1], "lift": 0.5}}
    world = {"scene": "table", "reality": "ideal", "time_limit": 30}
    file = {"world": world, "objects": objects, "arms": {"arm1": {**arm, "tree": tree}}}
    leaf = stage.run(file).leaf("grasp")
    assert leaf.code == "OUT_OF_REACH", leaf.reason
    assert "width_m" not in leaf.metrics  # the fingers have not closed


@pytest.mark.parametrize("y", [-0.1, 0.1])
def test_articulated_part_can_be_grasped_off_center(y: float, stage: Stage) -> None:
    """The drawer's rails bear the load that would otherwise twist the handle in the hand."""
    rail = {"shape": "box", "size": [0.02, 0.02, 0.02]}
    slide = {"type": "slide", "parts": ["handle"], "axis": [0, 1, 0], "range": [0, 0.1]}
    drawer = {
        "shape": "compound",
        "mass": 2,
        "fixed": True,
        "pose": {"xyz": [0.3, -0.5, 0.5]},
        "parts": {
            "rail": rail | {"pose": {"xyz": [0, -0.1, 0]}},
            "handle": {"shape": "box", "size": [0.24, 0.014, 0.014], "pose": {"xyz": [0, 0, 0]}},
        },
        "joints": {"slide": slide},
    }
    tree = {"grasp": {"object": "drawer", "part": "handle", "point": [y, 0, 0]}}
    arm = {"robot": "ur5", "gripper": "panda_hand", "base": {"xyz": [0, 0, 0.4]}, "tree": tree}
    play = stage.run(
        {"world": {"scene": "empty", "time_limit": 30}, "objects": {"drawer": drawer}}
        | {"arms": {"arm1": arm}}
    )
    leaf = play.leaf("grasp")
    assert leaf.status == "SUCCESS", leaf.reason
    assert float(leaf.metrics["point_off_m"]) < 0.005
