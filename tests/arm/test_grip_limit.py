"""An object held by friction is carried no faster than friction allows."""

from __future__ import annotations

from typing import Any

import pytest

from tests.plays import Stage
from tests.skills.scenarios import GRIPPING, ON_TABLE, Scenario, Tree


def carried(mass: float, force: float, stage: Stage) -> dict[str, Any]:
    """Metrics of carrying a cube of a mass in kg as fast as the arm can, held with a force in N."""
    cube = {"cube": ON_TABLE["cube"] | {"mass": mass}}
    grasp: Tree = {"grasp": {"object": "cube", "force": force}}
    carry: Tree = {"transport": {"object": "cube", "to": {"xyz": [0.35, 0.2, 0.7]}, "speed": 1.0}}
    file = Scenario(cube, arm=GRIPPING, scene="table").file(grasp, carry)
    leaf = stage.run(file).leaf("transport")
    assert leaf.status == "SUCCESS", leaf.reason
    return dict(leaf.metrics)


def test_loosely_gripped_object_is_carried_slower_and_the_scale_is_a_metric(stage: Stage) -> None:
    """1 kg needs 6.1 N at rest and 11.1 N at 8 m/s²; no object slips."""
    firm = carried(1.0, 60.0, stage)
    loose = carried(1.0, 20.0, stage)
    assert "grip_speed_scale" not in firm
    light = carried(0.1, 20.0, stage)
    assert "grip_speed_scale" not in light
    heavy = carried(2.2, 20.0, stage)
    assert 0.1 < heavy["grip_speed_scale"] < 0.9
    for metrics in (firm, loose, light, heavy):
        assert metrics["slid_m"] == pytest.approx(0.0, abs=1e-3)


def test_weak_grip_on_an_object_of_unknown_mass_is_not_slowed_to_a_crawl(stage: Stage) -> None:
    """A tilted grip may not bear the assumed kilogram: turning 50 g took 19 s instead of 2 s."""
    upright = {"xyz": [0.35, -0.4, 0.48]}
    bar = ON_TABLE["cube"] | {"size": [0.03, 0.03, 0.16], "mass": 0.05, "pose": upright}
    grasp: Tree = {"grasp": {"object": "bar", "point": [0, 0, 0.05], "approach": [0, 0, -1]}}
    lift: Tree = {"move_linear": {"offset": {"xyz": [0, 0, 0.2]}}}
    tilt: Tree = {"rotate_tool": {"axis": "y", "angle": 75}}
    file = Scenario({"bar": bar}, arm=GRIPPING, scene="table").file(grasp, lift, tilt)
    file["world"]["reality"] = "rough"
    leaf = stage.run(file).leaf("rotate_tool")
    assert leaf.status == "SUCCESS", leaf.reason
    assert (leaf.ended_s or 1e9) - leaf.started_s < 3.0


@pytest.mark.parametrize(
    ("robot", "gripper", "shape", "size"),
    [
        ("fr3", "panda_hand", "box", [0.05, 1.0, 0.05]),
        ("xarm7", "robotiq_2f85", "box", [0.05, 1.0, 0.05]),
        ("fr3", "panda_hand", "cylinder", [0.015, 1.0]),
    ],
)
def test_rod_is_turned_as_slowly_as_its_inertia_requires(
    robot: str, gripper: str, shape: str, size: list[float], stage: Stage
) -> None:
    """1 kg of 1 m resists a turn at 10 rad/s² with 0.8 N m: it twisted out of the fingers."""
    high, rpy = (size[2], [0, 0, 0]) if shape == "box" else (2 * size[0], [90, 0, 0])
    rod = {"shape": shape, "size": size, "mass": 1.0} | {
        "pose": {"xyz": [0.45, 0, 0.3001 + 0.5 * high], "rpy": rpy}
    }
    stand = {"shape": "box", "size": [0.1, 1.0, 0.3], "fixed": True} | {
        "pose": {"xyz": [0.45, 0, 0.15]}
    }
    arm: Tree = {"robot": robot, "gripper": gripper}
    grasp: Tree = {"grasp": {"object": "rod", "approach": [0, 0, -1]}}
    lift: Tree = {"move_linear": {"offset": {"xyz": [0, 0, 0.15]}}}
    turn: Tree = {"rotate_tool": {"axis": "z", "angle": 90, "speed": 1.0}}
    file = Scenario({"stand": stand, "rod": rod}, arm=arm, scene="empty").file(grasp, lift, turn)
    leaf = stage.run(file).leaf("rotate_tool")
    assert leaf.status == "SUCCESS", leaf.reason
    assert 0.1 < float(leaf.metrics["grip_speed_scale"]) < 0.9
    assert float(leaf.metrics["slid_m"]) < 1e-3
