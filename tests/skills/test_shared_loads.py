"""An arm does not move an object alone that another arm holds, too."""

from __future__ import annotations

import numpy as np

import bt_dualarm as bt
from tests.skills.scenarios import Tree
from tests.skills.test_carrying import TOGETHER, file_of, follows

ALONE: list[Tree] = [
    {"go_home": {}},
    {"move_linear": {"offset": {"xyz": [0, 0, 0.05]}}},
    {"move_joints": {"by": [0, 0, 0, 0, 0, 20]}},
    {"move_through": {"poses": [{"xyz": [0, -0.3, 0.8]}]}},
    {"reach_to_pose": {"offset": {"xyz": [0, 0, 0.05]}}},
    {"rotate_tool": {"axis": "z", "angle": 20}},
    {"circle": {"radius": 0.04}},
    {"lissajous": {}},
    {"move_until_contact": {}},
    {"transport": {"to": {"xyz": [0, -0.45, 0.8]}}},
    {"place": {"at": {"xyz": [0, -0.45, 0.5255]}}},
    {"regrasp": {}},
]
"""Leaves that move an arm with its held object."""

BACK: Tree = {"xyz": [0.0, -0.45, 0.5255], "rpy": [0, 0, 0]}


def test_motions_of_one_arm_with_a_shared_load_are_refused() -> None:
    """The reason names the alternative; afterwards both arms continue to carry together."""
    file = file_of(TOGETHER)
    refused_leaves: list[Tree] = [{"force_success": {"child": leaf}} for leaf in ALONE]
    sets_down = {"carry_together": {**TOGETHER, "to": BACK, "set_down": True}}
    first = [{"carry_together": TOGETHER}, *refused_leaves, sets_down, {"go_home": {}}]
    second = [follows(), ALONE[1], follows(set_down=True), {"go_home": {}}]
    second[1] = {"force_success": {"child": ALONE[1]}}
    file["arms"]["arm1"]["tree"] = {"sequence": first}
    file["arms"]["arm2"]["tree"] = {"sequence": second}
    result = bt.run(file)
    assert result.outcome == "SUCCESS", result
    for arm, partner, leaves in (("arm1", "arm2", ALONE), ("arm2", "arm1", ALONE[1:2])):
        runs = result.arms[arm].runs
        refused = [run for run in runs if run.status == "FAILURE"]
        assert [run.skill for run in refused] == [next(iter(leaf)) for leaf in leaves]
        for run in refused:
            assert run.code == "INVALID_TARGET", run.reason
            assert f"{arm} holds 'beam' together with {partner}: `carry_together`" in run.reason
    assert result.arms["arm1"].runs[-2].metrics["placed_error_m"] < 3e-3


def test_two_arms_that_grasped_one_object_do_not_move_it() -> None:
    """The second arm does not lift it out of the first hand, and the first does not move either."""
    handle = {"shape": "box", "size": [0.02, 0.1, 0.06]}
    tray = {"shape": "compound", "mass": 0.3, "pose": {"xyz": [0, -0.45, 0.535]}}
    tray["parts"] = {
        "plate": {"shape": "box", "size": [0.7, 0.3, 0.02], "pose": {"xyz": [0, 0, -0.025]}},
        "left": handle | {"pose": {"xyz": [-0.32, 0, 0.015]}},
        "right": handle | {"pose": {"xyz": [0.32, 0, 0.015]}},
    }
    lifts: Tree = {"move_linear": {"offset": {"xyz": [0, 0, 0.1]}}}
    takes = [{"object": "beam", "part": part} for part in ("left", "right")]
    file = file_of(TOGETHER, beam=tray)
    leaves: dict[str, list[Tree]] = {
        "arm1": [{"grasp": takes[0]}, {"wait": {"seconds": 12.0}}, lifts],
        "arm2": [
            {"wait": {"seconds": 4.6}},
            {"grasp": takes[1]},
            {"grasp": {**takes[1], "at": {"xyz": [0, -0.45, 0.585], "rpy": [0, 0, 0]}}},
            {"grasp": {**takes[1], "lift": 0.0}},
            {"wait": {"seconds": 4.0}},
            lifts,
        ],
    }
    for arm, own in leaves.items():
        children: list[Tree] = [{"force_success": {"child": leaf}} for leaf in own]
        file["arms"][arm]["tree"] = {"sequence": children}
    with bt.open(file) as run:
        run.step(4.5)
        assert run.world.attachments.holders("beam") == ("arm1",)
        height = run.world.object_pose("beam").position[2]
        result = run.finish()
        final_height = run.world.object_pose("beam").position[2]
    assert np.isclose(final_height, height, atol=2e-3)
    first, second = ([run.code for run in result.arms[arm].runs] for arm in leaves)
    assert first == ["", "", "INVALID_TARGET"]
    assert second == ["", "INVALID_TARGET", "INVALID_TARGET", "", "", "INVALID_TARGET"]
    for refused in result.arms["arm2"].runs[1:3]:  # before the arm moves, seen or not
        assert refused.ended_s == refused.started_s
        assert "`take_over` or `carry_together`" in refused.reason
