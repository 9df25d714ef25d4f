"""`carry_together`: faults of a partner, obstacles, the order of the arms, goals."""

from __future__ import annotations

import copy
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

import bt_dualarm as bt
from bt_dualarm.behaviors.report import LeafReport
from bt_dualarm.collision.group import GroupChecker
from bt_dualarm.core.pose import Pose
from bt_dualarm.diagnosis.story import stories
from bt_dualarm.kinematics.multi_arm import MultiArmKinematics
from bt_dualarm.planning.carrying import CarryPlanner
from bt_dualarm.replay.record import Record
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.sim.grippers import GripperCommand
from bt_dualarm.skill import carrying
from bt_dualarm.skill.carrying import pose_held
from bt_dualarm.skill.retreat import RetreatTo, possible_retreats
from bt_dualarm.testing import after
from tests.families import some
from tests.skills.scenarios import PARTNER, SCENARIOS, Tree

AIR = {"xyz": [0.0, -0.45, 0.75], "rpy": [0, 0, 0]}
TOGETHER: Tree = {"object": "beam", "with": ["arm2"], "to": AIR, "set_down": False}

CLOSES_S = 3.9
"""Just before both hands touch the beam, s."""

AT_S = 8.5
"""Time of a fault, s: both arms carry the beam then."""


def file_of(ports: Tree, partner: Tree | None = None, **objects: Tree) -> dict[str, Any]:
    """Tree file in which two arms carry a beam."""
    scenario = SCENARIOS["carry_together"]
    file: dict[str, Any] = {
        "bt_dualarm": 1,
        "name": "carry",
        **scenario.file({"carry_together": ports}),
    }
    file["objects"] |= objects
    if partner is not None:
        file["arms"]["arm2"] = PARTNER | {"tree": partner}
    return copy.deepcopy(file)


def leaf(result: bt.RunResult, arm: str = "arm1") -> LeafReport:
    """The first run of the skill."""
    return next(run for run in result.arms[arm].runs if run.skill == "carry_together")


def follows(**ports: Any) -> Tree:
    """Leaf of the partner."""
    return {"carry_together": {"object": "beam", "with": ["arm1"], "set_down": False, **ports}}


@pytest.mark.parametrize("fault", ["halt", "removal", "loss"])
def test_partner_stops_and_reports_the_cause_when_one_arm_fails(fault: str) -> None:
    partner: Tree = follows()
    if fault == "halt":
        partner = {"sequence": [after(AT_S, partner), {"wait": {"seconds": 10}}]}
    file = file_of(TOGETHER | {"speed": 0.2}, partner)
    if fault == "removal":
        file["arms"]["arm2"]["removable"] = True
    with bt.open(file) as run:
        run.step(AT_S)
        assert set(run.world.attachments.holders("beam")) == {"arm1", "arm2"}
        height = float(run.world.object_pose("beam").position[2])
        assert height > 0.54
        if fault == "removal":
            run.world.remove_arm("arm2")
        if fault == "loss":
            gripper = run.world.grippers["arm2"]
            gripper.command(GripperCommand(0.08, 0.1, 20.0))
        while run.trees["arm1"].status == "RUNNING" and run.time < AT_S + 5.0:
            run.step(0.1)
        if fault == "halt":
            run.step(0.5)
            tools = [run.arms[arm].tool_pose for arm in ("arm1", "arm2")]
            run.step(0.5)
            later = [run.arms[arm].tool_pose for arm in ("arm1", "arm2")]
            assert all(one.distance(other) < 5e-4 for one, other in zip(tools, later, strict=True))
            assert float(run.world.object_pose("beam").position[2]) > height - 0.02
            assert set(run.world.attachments.holders("beam")) == {"arm1", "arm2"}
        result = run.finish()
    found = leaf(result)
    assert found.status == "FAILURE"
    if fault == "loss":  # the beam tips in the fingers of the arm that still holds it, or moves it
        assert found.code in ("SLIPPED", "TRACKING_ERROR", "PARTNER_GONE"), found.reason
        return
    assert found.code == "PARTNER_GONE", (found.code, found.reason)
    assert "arm2" in found.reason


def test_arms_carry_around_an_obstacle() -> None:
    ceiling = {"shape": "box", "size": [0.3, 0.12, 0.04], "mass": 5, "fixed": True}
    ceiling["pose"] = {"xyz": [0, -0.45, 0.74]}
    to = {"xyz": [0.0, -0.45, 0.85], "rpy": [0, 0, 0]}
    result = bt.run(file_of(TOGETHER | {"to": to}, follows(), ceiling=ceiling))
    assert result.outcome == "SUCCESS", leaf(result).reason
    assert leaf(result).metrics["placed_error_m"] < 2e-3
    assert "touched" not in leaf(result).metrics


def test_result_does_not_depend_on_the_order_of_the_arms() -> None:
    """Tool poses are identical bit for bit until both hands touch the beam.

    From then on MuJoCo solves the contacts in another order, to 1e-8, and the pads slip elsewhere:
    the tools differ by some 10 µm, and the end of a motion by some control periods.
    """
    results = []
    tools = []
    for names in (("arm1", "arm2"), ("arm2", "arm1")):
        # The arm with the goal decides whether the beam is set down.
        file = file_of(TOGETHER, follows(set_down=True))
        file["arms"] = {name: file["arms"][name] for name in names}
        with bt.open(file) as run:
            run.step(CLOSES_S)
            assert not run.world.attachments.holders("beam")
            tools.append([run.arms[arm].tool_pose.position.tolist() for arm in ("arm1", "arm2")])
            result = run.finish()
            assert result.outcome == "SUCCESS"
            results.append(leaf(result))
    assert tools[0] == tools[1]
    assert results[0].ended_s == pytest.approx(results[1].ended_s, abs=0.05)
    errors = [one.metrics["placed_error_m"] for one in results]
    assert errors[0] == pytest.approx(errors[1], abs=5e-5)


def test_different_goals_are_refused_and_either_arm_may_lead() -> None:
    other = {"xyz": [0.1, -0.45, 0.75]}
    result = bt.run(file_of(TOGETHER, follows(to=other)))
    for leader in ("arm1", "arm2"):
        assert leaf(result, leader).code == "INVALID_TARGET"
        assert np.isfinite(leaf(result, leader).ended_s or 0.0)


@pytest.mark.parametrize(
    ("ports", "partner", "message"),
    [
        ({}, {"wait": 1}, "no 'carry_together' in the tree of arm2 fits this one"),
        ({}, follows() | {"carry_together": follows()["carry_together"] | {"object": "cube"}},
         "carry_together: {with: [arm1], object: beam}; it has with: [arm1], object: cube"),
        ({"with": ["arm1"]}, follows(), "with: arm1 cannot be its own partner"),
        ({"to": None}, follows(), "no leaf of arm1 and arm2 has 'to' or 'path'"),
        ({"path": [AIR]}, follows(), "give at most one of: to, path; given: to and path"),
    ],
    ids=["no partner", "another object", "itself", "no goal", "two goals"],
)  # fmt: skip
def test_check_finds_a_leaf_without_a_partner(ports: Tree, partner: Tree, message: str) -> None:
    cube = {"shape": "box", "size": [0.04, 0.04, 0.04], "mass": 0.1, "pose": {"xyz": [1, 1, 1]}}
    with pytest.raises(bt.SpecError) as raised:
        bt.run(file_of(TOGETHER | ports, partner, cube=cube))
    assert message in str(raised.value)


@pytest.mark.parametrize(
    ("ports", "partner", "message"),
    [
        ({"with": "arm2"}, follows(), "with: expected a list, not text 'arm2'"),
        ({"object": "beem"}, follows(), "there is no object 'beem'"),
        ({}, {"carry_together": {"objekt": "beam", "with": ["arm1"]}}, "unknown port 'objekt'"),
        ({}, {"sequence": follows()}, "sequence: unknown port 'carry_together'"),
        ({}, {"sequence": ["wait 1", follows()]}, "there is no node or skill 'wait 1'"),
    ],
)
def test_one_mistake_is_one_error(ports: Tree, partner: Tree, message: str) -> None:
    """Leaves that fit a mistaken one were said to have no partner, too: up to four errors."""
    with pytest.raises(bt.SpecError) as raised:
        bt.run(file_of(TOGETHER | ports, partner))
    [problem] = raised.value.problems
    assert message in problem.message


BARS: dict[str, Tree] = {
    "prism": {"shape": "prism", "size": [0.025, 1.2], "sides": 8},
    "compound": {
        "shape": "compound",
        "parts": {
            "bar": {"shape": "box", "size": [1.2, 0.05, 0.05], "pose": {"xyz": [0.3, -0.2, 0.25]}}
        },
    },
}


ON_A_SIDE = Pose.from_rpy((0, 0, 0), (np.pi / 8, 0, 0)) @ Pose.from_rpy(
    (0, 0, 0), (0, np.pi / 2, 0)
)


@pytest.mark.parametrize(
    ("kind", "pose"),
    [
        ("prism", {"xyz": [0, -0.45, 0.5236], "quat": ON_A_SIDE.quaternion.tolist()}),
        ("compound", {"xyz": [-0.3, -0.25, 0.2755]}),
    ],
)
def test_bar_is_carried_by_its_ends_wherever_its_frame_is(kind: str, pose: Tree) -> None:
    """The arms bear it at its center of mass: otherwise they would twist it out of each hand."""
    x, y, z = pose["xyz"]
    file = file_of(TOGETHER | {"to": {"xyz": [x, y, z + 0.2]}}, follows())
    beam = file["objects"]["beam"]
    file["objects"]["beam"] = BARS[kind] | {"mass": beam["mass"], "color": "red", "pose": pose}
    result = bt.run(file)
    found = leaf(result)
    assert result.outcome == "SUCCESS", found.reason
    assert float(found.metrics["placed_error_m"]) < 0.002
    assert float(found.metrics["internal_moment_nm"]) < 2.0


def test_models_of_the_arms_bear_what_stands_on_the_beam_where_it_is() -> None:
    """Weighted by their shares, the loads of their models are at the common center of mass."""
    weight = {"shape": "box", "size": [0.04, 0.04, 0.04], "mass": 1.0, "friction": 1.0}
    weight["pose"] = {"xyz": [0.35, -0.45, 0.571]}
    file = file_of(TOGETHER, follows(), weight=weight)
    with bt.open(file) as run:
        run.step(AT_S - 2.0)
        world = run.world
        assert set(world.attachments.holders("beam")) == {"arm1", "arm2"}
        borne = np.zeros(3)
        for name in ("arm1", "arm2"):
            (load,) = world.nominal[name].loads
            link = run.arms[name].tool_pose @ world.robots[name].tool.inverse
            borne += load.share * (link @ load.pose).position
        beam, weight_at = (world.object_pose(name).position for name in ("beam", "weight"))
        mass = file["objects"]["beam"]["mass"]
        assert borne == pytest.approx((mass * beam + weight_at) / (mass + 1.0), abs=0.003)


def test_tray_is_carried_by_its_handles() -> None:
    """They are the parts farthest from each other; the plate between them is an obstacle."""
    beam = {"shape": "compound", "mass": 2.5, "pose": {"xyz": [0, -0.45, 0.535]}}
    beam["parts"] = {
        "plate": {"shape": "box", "size": [0.7, 0.3, 0.02], "pose": {"xyz": [0, 0, -0.025]}},
        "left": {"shape": "box", "size": [0.02, 0.1, 0.06], "pose": {"xyz": [-0.32, 0, 0.015]}},
        "right": {"shape": "box", "size": [0.02, 0.1, 0.06], "pose": {"xyz": [0.32, 0, 0.015]}},
    }
    to = {"xyz": [0.04, -0.45, 0.7], "rpy": [0, 0, 8]}
    with bt.open(file_of(TOGETHER | {"to": to}, follows(), beam=beam)) as run:
        result = run.finish()
        pose = run.world.object_pose("beam")
        held = [pose.inverse.apply(run.arms[arm].tool_pose.position) for arm in ("arm1", "arm2")]
    assert result.outcome == "SUCCESS", leaf(result).reason
    assert leaf(result).metrics["placed_error_m"] < 2e-3
    for tool, side in zip(held, (-0.32, 0.32), strict=True):
        assert tool[0] == pytest.approx(side, abs=5e-3)


def test_dry_friction_of_an_arm_at_rest_is_no_internal_force() -> None:
    """After its approach, the joints of the UR10e hide 78 N; the hands press with 5 N."""
    handle: Tree = {"shape": "box", "size": [0.06, 0.03, 0.03]}
    parts: Tree = {
        "pan": {"shape": "tray", "size": [0.4, 0.3, 0.04], "wall": 0.006},
        "left": handle | {"pose": {"xyz": [-0.23, 0, 0]}},
        "right": handle | {"pose": {"xyz": [0.23, 0, 0]}},
    }
    stand: Tree = {"shape": "box", "size": [0.2, 0.2, 0.35], "mass": 1, "fixed": True}
    arm: Tree = {"gripper": "robotiq_2f85"}
    ports: Tree = {"object": "tray", "set_down": False}
    to = {"xyz": [-0.044, 0.061, 0.53], "rpy": [0, 0, 10]}
    file: dict[str, Any] = {
        "bt_dualarm": 1,
        "world": {"scene": "empty", "reality": "lab", "seed": 1},
        "objects": {
            "tray": {
                "shape": "compound",
                "mass": 1.2,
                "parts": parts,
                "pose": {"xyz": [0, -0.05, 0.3705]},
            },
            "stand": stand | {"pose": {"xyz": [0, -0.05, 0.175]}},
        },
        "arms": {
            "arm1": arm
            | {
                "robot": "panda",
                "base": {"xyz": [-0.677, 0, 0.15]},
                "tree": {"carry_together": ports | {"with": ["arm2"], "to": to}},
            },
            "arm2": arm
            | {
                "robot": "ur10e",
                "base": {"xyz": [0.867, 0, 0.15], "rpy": [0, 0, 180]},
                "tree": {"carry_together": ports | {"with": ["arm1"]}},
            },
        },
    }
    found = leaf(bt.run(file))
    assert found.status == "SUCCESS", (found.code, found.reason)
    assert found.metrics["internal_force_n"] < 10.0


def test_opening_hands_do_not_turn() -> None:
    """What compensated the moment between compliant hands turned one of them by 2.3°."""
    stand: Tree = {"shape": "box", "size": [0.2, 0.2, 0.35], "mass": 1, "fixed": True}
    beam: Tree = {"shape": "box", "size": [0.6, 0.06, 0.04], "mass": 1.5}
    to = {"xyz": [0, -0.05, 0.3705], "rpy": [0, 0, 0]}
    bases: dict[str, Any] = {
        "arm1": {"xyz": [-0.677, 0, 0.15]},
        "arm2": {"xyz": [0.686, 0, 0.15], "rpy": [0, 0, 180]},
    }
    robots = {"arm1": ("fr3", "panda_hand"), "arm2": ("ur5e", "robotiq_2f85")}
    file: dict[str, Any] = {
        "bt_dualarm": 1,
        "world": {"scene": "empty"},
        "objects": {
            "beam": beam | {"pose": {"xyz": [0, -0.05, 0.3705]}},
            "stand": stand | {"pose": {"xyz": [0, -0.05, 0.175]}},
        },
        "arms": {
            arm: {
                "robot": robot,
                "gripper": gripper,
                "base": bases[arm],
                "tree": {
                    "carry_together": {"object": "beam", "with": [other], "speed": 0.7}
                    | ({"to": to} if arm == "arm1" else {})
                },
            }
            for (arm, (robot, gripper)), other in zip(robots.items(), ("arm2", "arm1"), strict=True)
        },
    }
    turned = dict.fromkeys(robots, 0.0)
    closed: dict[str, Pose] = {}
    with bt.open(file) as run:
        while not run.done:
            run.step(0.02)
            for arm in robots:
                tool = run.arms[arm].tool_pose
                if run.arms[arm].holds:
                    closed[arm] = tool
                elif arm in closed and tool.distance(closed[arm]) < 0.01:  # not yet on its retreat
                    turned[arm] = max(turned[arm], tool.angle(closed[arm]))
        assert run.finish().outcome == "SUCCESS"
    assert closed.keys() == robots.keys()
    assert max(turned.values()) < np.radians(0.5)


def test_arm_that_cannot_reach_is_named(tmp_path: Path) -> None:
    """Solving for all arms at once spreads the error: the first arm would be blamed."""
    partner = copy.deepcopy(PARTNER) | {"tree": follows()}
    partner["base"] = {"xyz": [1.6, 0, 0.4]}
    file = file_of(TOGETHER)
    file["arms"]["arm1"]["base"] = {"xyz": [-1.0, 0, 0.4]}  # its middle is out of reach of both
    file["arms"]["arm2"] = partner
    found = leaf(bt.run(file, record=tmp_path / "record"))
    assert found.code == "OUT_OF_REACH"
    assert "the tool of arm2" in found.reason
    cause = stories(Record.read(tmp_path / "record"))[0].causes[0]
    assert cause.kind == "OUT_OF_REACH"
    assert cause.sentence.startswith("arm1 and arm2 found no grasps")


def _three(load: Tree, stand: list[float], to: list[float], arms: list[Tree]) -> dict[str, Any]:
    """Tree file in which three arms carry a load from a stand of this width, 0.5 m high."""
    names = [f"arm{i}" for i in (1, 2, 3)]
    for name, arm in zip(names, arms, strict=True):
        ports: Tree = {"object": "load", "with": [one for one in names if one != name]}
        if name == "arm1":
            ports |= {"to": {"xyz": to}, "set_down": False}
        arm["tree"] = {"carry_together": ports}
    pose = {"xyz": [0, 0, 0.5 + 0.5 * load["size"][-1]]}
    box = {"shape": "box", "size": [*stand, 0.5], "fixed": True, "pose": {"xyz": [0, 0, 0.25]}}
    return {
        "bt_dualarm": 1,
        "name": "three",
        "world": {"scene": "empty"},
        "objects": {"stand": box, "load": load | {"mass": 2, "pose": pose}},
        "arms": dict(zip(names, arms, strict=True)),
    }


def _at(robot: str, gripper: str, x: float, y: float, yaw: float) -> Tree:
    base = {"xyz": [x, y, 0.35], "rpy": [0, 0, yaw]}
    return {"robot": robot, "gripper": gripper, "base": base}


def test_place_at_which_no_hand_has_room_is_named() -> None:
    """The stand is in the way of all hands in the middle; the reach of an arm was blamed."""
    bases = ((-1.0, 0.0, 0.0), (1.0, 0.0, 180.0), (0.0, -0.65, 90.0))
    arms = [_at("ur5", "robotiq_2f85", *base) for base in bases]
    board = {"shape": "box", "size": [0.9, 0.12, 0.025]}
    found = leaf(bt.run(_three(board, [0.4, 0.1], [0, 0, 0.6], arms)))
    assert found.code == "OUT_OF_REACH"
    assert "no arm can hold 'load' at (0, 0, 0) m in its frame" in found.reason


def test_the_reason_is_that_of_the_grasps_that_came_farthest(tmp_path: Path) -> None:
    """It was that of the first grasp, with which a partner would collide with itself."""
    arms = [
        _at("panda", "panda_hand", -0.744, 0.429, -30),
        _at("ur5e", "robotiq_2f85", 0.755, 0.436, 210),
        _at("ur5e", "robotiq_2f85", 0, -0.871, 90),
    ]
    disk = {"shape": "cylinder", "size": [0.28, 0.02]}
    file = _three(disk, [0.2, 0.2], [0, -0.08, 0.72], arms)
    found = leaf(bt.run(file, record=tmp_path / "record"))
    assert found.code == "OUT_OF_REACH"
    assert found.reason.endswith("the arms can follow only 44 % of the path together")
    cause = stories(Record.read(tmp_path / "record"))[0].causes[0]
    assert cause.kind == "OUT_OF_REACH"


@pytest.mark.parametrize("which", some(["arm1", "arm2"], 2))
def test_hands_reopen_if_one_arm_is_halted_while_they_close(which: str) -> None:
    """They did not count as holding the beam, so a retry failed with GRIPPER_FULL."""
    trees = {"arm1": {"carry_together": {**TOGETHER, "speed": 1.0}}, "arm2": follows()}
    touched = {"until": {"touching": {"by": "fingers"}}}
    for arm, tree in trees.items():
        once = {"carry_together": tree["carry_together"] | touched} if arm == which else tree
        trees[arm] = {"sequence": [{"force_success": {"child": once}}, tree]}
    file = file_of(TOGETHER, trees["arm2"])
    file["arms"]["arm1"]["tree"] = trees["arm1"]
    result = bt.run(file)
    for arm in trees:
        first, second = (run for run in result.arms[arm].runs if run.skill == "carry_together")
        assert first.code == ("HALTED" if arm == which else "PARTNER_GONE")
        assert second.status == "SUCCESS", second.reason


def test_different_grasps_are_tried_where_the_best_ones_are_similar() -> None:
    """The four best grasps of each hand differ by millimeters; none of them allows the path."""

    def arm(robot: str, x: float, y: float, yaw: float, leaf: Tree) -> Tree:
        base = {"xyz": [x, y, 0.4], "rpy": [0, 0, yaw]}
        return {"robot": robot, "gripper": "panda_hand", "base": base, "tree": leaf}

    path = [
        {"xyz": [-0.007, -0.051, 0.654], "rpy": [8.9, -2.4, -23.8]},
        {"xyz": [-0.090, 0.011, 0.4255], "rpy": [0, 0, 3.2]},
    ]
    leads = {"carry_together": {"object": "beam", "with": ["arm2"], "path": path}}
    follows = {"carry_together": {"object": "beam", "with": ["arm1"]}}
    beam = {"shape": "box", "size": [0.72, 0.05, 0.05], "mass": 2.0}
    stand = {"shape": "box", "size": [0.3, 0.3, 0.4], "fixed": True}
    file = {
        "bt_dualarm": 1,
        "name": "alike",
        "world": {"scene": "empty", "time_limit": 10},
        "objects": {
            "beam": beam | {"pose": {"xyz": [0, 0, 0.4255], "rpy": [0, 0, -13.5]}},
            "stand": stand | {"pose": {"xyz": [0, 0, 0.2]}},
        },
        "arms": {
            "arm1": arm("fr3", -0.385, 0.513, -93, leads),
            "arm2": arm("panda", 0.745, 0.563, -63, follows),
        },
    }
    with bt.open(file) as run:
        start = run.arms["arm1"].q
        tree = run.trees["arm1"]
        while tree.status != "FAILURE" and np.abs(run.arms["arm1"].q - start).max() < 0.1:
            run.step(0.1)
        assert tree.status == "RUNNING", "it has a plan and begins to execute it"


def test_tilt_of_one_hand_does_not_shift_the_estimated_object_pose() -> None:
    """One hand turns by 2 degrees at the end of a tray: an 8 mm error if its rotation counted."""
    grasps = [Pose.from_rpy((side * 0.22, 0.0, 0.015), (np.pi, 0.0, 0.3)) for side in (-1, 1)]
    pose = Pose.from_rpy((0.1, -0.4, 0.6), (0.02, -0.05, 0.4))
    tools = [pose @ grasp for grasp in grasps]
    found = pose_held(tools, grasps)
    assert found.distance(pose) < 1e-9
    assert found.angle(pose) < 1e-6
    tools[1] = tools[1] @ Pose.from_rpy((0.0, 0.0, 0.0), (0.0, np.radians(2.0), 0.0))
    found = pose_held(tools, grasps)
    assert found.distance(pose) < 1e-4
    for end in (-0.22, 0.22):
        assert (
            np.linalg.norm(found.apply(np.array((end, 0, 0))) - pose.apply(np.array((end, 0, 0))))
            < 3e-4
        )


def test_arms_retreat_differently_where_a_straight_retreat_is_impossible(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As after `place`: the object is placed, but the skill would end with a failure."""

    def beyond_reach(*arguments: Any) -> list[RetreatTo]:
        found = possible_retreats(*arguments)
        return [
            replace(found[0], end=found[0].end @ Pose.from_rpy((0.0, 0.0, -2.0)), length=2.0),
            *found,
        ]

    monkeypatch.setattr(carrying, "possible_retreats", beyond_reach)
    to = {"xyz": [0.0, -0.45, 0.525], "rpy": [0, 0, 0]}
    ports = {"to": to, "set_down": True, "speed": 1.0}
    result = bt.run(file_of(TOGETHER | ports, follows(set_down=True)))
    assert result.outcome == "SUCCESS", leaf(result).reason
    assert leaf(result).metrics["retreated_m"] < 0.1
    assert leaf(result).metrics["placed_error_m"] < 2e-3


def with_four_handles(x: float, y: float, yaw: float) -> dict[str, Any]:
    """Two arms side by side, as on a torso, lift a small board by two of its four handles."""
    board: Tree = {
        "shape": "compound",
        "mass": 0.4,
        "pose": {"xyz": [x, y, 0.822], "rpy": [0, 0, yaw]},
    }
    parts: Tree = {
        f"handle{i}": {"shape": "box", "size": [*size, 0.034], "pose": {"xyz": [*place, 0.02]}}
        for i, (place, size) in enumerate(
            (
                ((0.13, 0), (0.04, 0.02)),
                ((-0.13, 0), (0.04, 0.02)),
                ((0, 0.13), (0.02, 0.04)),
                ((0, -0.13), (0.02, 0.04)),
            )
        )
    }
    parts["floor"] = {"shape": "box", "size": [0.232, 0.232, 0.006], "pose": {"xyz": [0, 0, 0.003]}}
    table: Tree = {"shape": "box", "size": [0.78, 1.392, 0.04], "pose": {"xyz": [0.495, 0, 0.802]}}
    up: Tree = {"to": {"xyz": [0.45, 0, 1.072], "rpy": [0, 0, yaw]}}
    arms = {
        name: {
            "robot": "fr3",
            "gripper": "robotiq_2f85",
            "base": {"xyz": [0, 0.0502 * side, 1.1515], "rpy": [-51.2 * side, -10, -26.6 * side]},
            "tree": {
                "carry_together": {"object": "board", "with": [other], "set_down": False, **goal}
            },
        }
        for name, other, side, goal in (("left", "right", 1, up), ("right", "left", -1, {}))
    }
    return {
        "bt_dualarm": 1,
        "world": {"scene": "empty", "time_limit": 60},
        "objects": {"table": table | {"fixed": True}, "board": board | {"parts": parts}},
        "arms": arms,
    }


@pytest.mark.parametrize(("x", "y", "yaw"), [(0.55, 0.01, 150), (0.58, 0.07, 150)])
def test_arms_can_approach_grasps_that_are_close_together(x: float, y: float, yaw: float) -> None:
    """Grasps were chosen whose approaches the guard stops: a `DEADLOCK` next to the object."""
    result = bt.run(with_four_handles(x, y, yaw))
    assert result.outcome == "SUCCESS", [leaf(result, arm).reason for arm in result.arms]


def test_support_below_the_goal_is_reported_as_that() -> None:
    """The failure said that it was -12.5 mm above."""
    to = {"xyz": [0.0, -0.45, 0.538], "rpy": [0, 0, 0]}
    result = bt.run(file_of(TOGETHER | {"to": to, "set_down": True, "search": 0.03}))
    assert leaf(result).code == "NOT_REACHED"
    assert leaf(result).reason.startswith("what it touched is 1")
    assert leaf(result).reason.endswith("mm below its goal")


def test_object_that_is_attached_to_a_tool_is_not_carried_together() -> None:
    """Open fingers would not release it; if all tools had it, it was said to have been dropped."""
    file = file_of(TOGETHER)
    tree = file["arms"]["arm1"]["tree"]
    file["arms"]["arm1"]["tree"] = {"sequence": [{"approach_and_attach": {"object": "beam"}}, tree]}
    result = bt.run(file)
    assert leaf(result).code == "GRIPPER_FULL"
    assert "'beam' is attached to the tool: `detach` it first" in leaf(result).reason


LIGHT_BAR = """
bt_dualarm: 1
world: {{scene: empty, reality: lab, seed: 1, time_limit: 60}}
objects:
  bar:
    shape: box
    size: [0.37, 0.036, 0.036]
    mass: {mass}
    pose: {{xyz: [0.5, 0.05, 0.0183], rpy: [0, 0, 60]}}
arms:
  arm1:
    robot: {first}
    gripper: panda_hand
    tree:
      carry_together:
        object: bar
        with: [arm2]
        to: {{xyz: [0.5, -0.05, 0.0183], rpy: [0, 0, 90]}}
  arm2:
    robot: {second}
    gripper: robotiq_2f85
    base: {{xyz: [1, 0, 0], rpy: [0, 0, 180]}}
    tree: {{carry_together: {{object: bar, with: [arm1]}}}}
"""


@pytest.mark.parametrize(
    ("first", "second", "mass"),
    some([(*pair, m) for pair in (("fr3", "xarm7"), ("panda", "ur5e")) for m in (0.05, 0.15)], 2),
)
def test_hands_that_hold_a_light_object_softly_feel_its_support(
    first: str, second: str, mass: float
) -> None:
    """With 5 N of grip force, fingers slid along the bar by 15 mm, and felt nothing: NO_CONTACT."""
    result = bt.run(LIGHT_BAR.format(first=first, second=second, mass=mass))
    assert result.outcome == "SUCCESS", str(result)
    for arm in ("arm1", "arm2"):
        assert abs(leaf(result, arm).metrics["height_off_m"]) < 0.004


LIGHT_BAR_ON_A_STAND = """
bt_dualarm: 1
world: {{scene: empty, reality: {reality}, seed: {seed}, time_limit: 60}}
objects:
  stand:
    {{shape: box, size: [0.2, 0.2, 0.15], fixed: true, mass: 10, pose: {{xyz: [{x}, {y}, 0.075]}}}}
  bar:
    shape: box
    size: [0.5, 0.035, 0.035]
    mass: {mass}
    pose: {{xyz: [{x}, {y}, 0.168], rpy: [0, 0, {yaw}]}}
arms:
  arm1:
    robot: {first}
    gripper: {hand}
    base: {{xyz: [0, 0, 0.15], rpy: [0, 0, {yaw}]}}
    tree: {{carry_together: {{object: bar, with: [arm2], to: {{xyz: [{to}, {y}, 0.1675]}}}}}}
  arm2:
    robot: {second}
    gripper: robotiq_2f85
    base: {{xyz: [{away}, 0, 0.15], rpy: [0, 0, 180]}}
    tree: {{carry_together: {{object: bar, with: [arm1]}}}}
"""


@pytest.mark.parametrize(
    "file",
    [
        # A fraction of the limits of this arm's joints is a slow descent, which counted as none.
        {"first": "ur3e", "hand": "robotiq_2f85", "second": "fr3", "away": 1.113, "mass": 0.2}
        | {"x": 0.497, "to": 0.517, "y": -0.104, "yaw": -12, "reality": "lab", "seed": 171},
        # The bar slides along the fingers of one hand, which goes on, while both press it down.
        {"first": "fr3", "hand": "panda_hand", "second": "panda", "away": 1.199, "mass": 0.15}
        | {"x": 0.6, "to": 0.62, "y": -0.145, "yaw": 9, "reality": "rough", "seed": 0},
    ],
)
def test_hands_stop_where_a_light_object_touches(file: dict[str, Any]) -> None:
    """They went on by 4 to 11 mm: NOT_REACHED, or the object was pressed out of the fingers."""
    result = bt.run(LIGHT_BAR_ON_A_STAND.format(**file))
    assert result.outcome == "SUCCESS", str(result)
    for arm in ("arm1", "arm2"):
        assert abs(leaf(result, arm).metrics["height_off_m"]) < 0.003


def _set_down(gripper: str, halted: str = "", seconds: float = 1.0) -> dict[str, Any]:
    """Two arms carry a bar to where they set it down; one may be halted once."""
    goal = {"xyz": [0.05, -0.5, 0.5155]}
    leaves: dict[str, Tree] = {
        "arm1": {"carry_together": {"object": "bar", "with": ["arm2"], "to": goal}},
        "arm2": {"carry_together": {"object": "bar", "with": ["arm1"]}},
    }
    trees: dict[str, Tree] = {
        name: {"retry": {"times": 6, "child": leaf}} for name, leaf in leaves.items()
    }
    if halted:
        first = {"timeout": {"seconds": round(seconds, 2), "child": leaves[halted]}}
        trees[halted] = {"selector": [first, trees[halted]]}
    stand = {"shape": "box", "size": [0.34, 0.3, 0.5], "fixed": True}
    bar = {"shape": "box", "size": [0.62, 0.05, 0.03], "mass": 0.8}
    bases = {
        "arm1": {"robot": "panda", "base": {"xyz": [-0.6, 0, 0.4], "rpy": [0, 0, -90]}},
        "arm2": {"robot": "ur5e", "base": {"xyz": [0.6, 0, 0.4]}},
    }
    return {
        "bt_dualarm": 1,
        "world": {"scene": "empty", "reality": "lab", "time_limit": 90},
        "objects": {
            "stand": stand | {"pose": {"xyz": [0, -0.45, 0.25]}},
            "bar": bar | {"pose": {"xyz": [0, -0.45, 0.5155]}},
        },
        "arms": {
            name: arm | {"gripper": gripper, "tree": trees[name]} for name, arm in bases.items()
        },
    }


@cache
def _held_s(gripper: str) -> tuple[float, float]:
    """Simulated times at which the first arm grasps the bar, and at which all have released it."""
    with bt.open(_set_down(gripper)) as run:
        while not run.world.attachments.holders("bar"):
            run.step(0.02)
        grasped = run.time
        while run.world.attachments.holders("bar"):
            run.step(0.02)
        return grasped, run.time


@pytest.mark.parametrize("halted", ["arm1", "arm2"])
@pytest.mark.parametrize(
    ("gripper", "event"),
    some(
        [
            ("suction_cup", "grasped"),
            ("robotiq_2f85", "grasped"),
            ("robotiq_2f85", "released"),
            ("panda_hand", "released"),
            ("panda_hand", "grasped"),
        ],
        2,
    ),
)
def test_all_arms_hold_the_object_or_none_does(gripper: str, event: str, halted: str) -> None:
    """Halted in the tick in which the others close or open: it held the bar, and they did not."""
    when = _held_s(gripper)[event == "released"]
    for ticks in (-1, 0):
        with bt.open(_set_down(gripper, halted, when + 0.02 * ticks)) as run:
            result = run.finish()
            place = run.world.object_pose("bar").position
        assert result.outcome == "SUCCESS", (ticks, result)
        assert np.linalg.norm(place - (0.05, -0.5, 0.515)) < 0.006


@pytest.mark.parametrize("halted", ["arm1", "arm2"])
@pytest.mark.parametrize("gripper", some(["suction_cup", "robotiq_2f85", "panda_hand"], 2))
def test_object_that_was_set_down_is_not_picked_up_again(gripper: str, halted: str) -> None:
    """Halted as the hands open, or on the retreat: another attempt only retreats."""
    _, released = _held_s(gripper)
    for later in (0.05, 0.4):
        with bt.open(_set_down(gripper, halted, released + later)) as run:
            while run.time < released + later or run.world.attachments.holders("bar"):
                run.step(0.02)
            while not run.done:
                run.step(0.02)
                assert not run.world.attachments.holders("bar")
            assert run.result is not None
            assert run.result.outcome == "SUCCESS", str(run.result)
            place = run.world.object_pose("bar").position
        assert np.linalg.norm(place - (0.05, -0.5, 0.515)) < 0.006


PRESSING = """
bt_dualarm: 1
world: {{scene: empty, reality: rough, seed: 3005, time_limit: 60}}
objects:
  stand:
    shape: box
    size: [0.2, 0.2, 0.24]
    fixed: true
    pose: {{xyz: [0.481, -0.112, 0.12]}}
  bar:
    shape: box
    size: [0.556, 0.034, 0.043]
    mass: 0.347
    pose: {{xyz: [0.481, -0.112, 0.262], rpy: [0, 0, 6]}}
arms:
  arm1:
    robot: ur3e
    gripper: robotiq_2f85
    base: {{xyz: [0, 0, 0.24]}}
    tree:
      retry:
        times: 3
        child:
          {{carry_together: {{object: bar, with: [arm2], to: {{xyz: [0.481, -0.112, 0.2615]}}}}}}
  arm2:
    robot: z1
    gripper: robotiq_2f85
    base: {{xyz: [0.985, 0, 0.24], rpy: [0, 0, 199]}}
    tree:
      selector:
        - timeout:
            {{seconds: {halted_at}, child: {{carry_together: {{object: bar, with: [arm1]}}}}}}
        - retry: {{times: 3, child: {{carry_together: {{object: bar, with: [arm1]}}}}}}
"""


@pytest.mark.parametrize(
    "halted_at",
    [
        9.0,  # both press the bar onto the stand, with set-points that are in there: NO_PLAN
        9.2,  # it waits for the other one, which opened its hand nevertheless: INVALID_TARGET
        11.0,  # its part is complete, and the other one completes its own: PARTNER_GONE
    ],
)
def test_arm_that_is_halted_while_it_sets_down_goes_on(halted_at: float) -> None:
    result = bt.run(PRESSING.format(halted_at=halted_at))
    assert leaf(result, "arm2").code == "HALTED"
    assert result.outcome == "SUCCESS", str(result)


def test_arm_that_is_done_lets_another_one_retreat_past_it() -> None:
    """The third arm waited for the others, in the path of one of them: DEADLOCK."""
    load: Tree = {"shape": "box", "size": [0.424, 0.044, 0.036], "mass": 2.808}
    load["pose"] = {"xyz": [0.734, -0.15, 0.0185], "rpy": [0, 0, -7]}
    arms = [
        ("a", "ur5", (0.0, 0.0), 23),
        ("b", "xarm7", (1.221, 0.0), 182),
        ("c", "xarm7", (0.734, -0.695), 90),
    ]
    leaves: dict[str, Tree] = {
        name: {"object": "it", "with": [one for one, *_ in arms if one != name], "speed": 0.4}
        for name, *_ in arms
    }
    leaves["a"]["to"] = {"xyz": [0.741, -0.15, 0.018]}
    trees: dict[str, Tree] = {
        name: {"retry": {"times": 4, "child": {"carry_together": ports}}}
        for name, ports in leaves.items()
    }
    halted = {"timeout": {"seconds": 6.8, "child": {"carry_together": leaves["a"]}}}
    trees["a"] = {
        "selector": [halted, {"retry": {"times": 3, "child": {"carry_together": leaves["a"]}}}]
    }
    world = {"scene": "empty", "reality": "rough", "seed": 4010, "time_limit": 60}
    file: dict[str, Any] = {"bt_dualarm": 1, "world": world, "objects": {"it": load}}
    file["arms"] = {
        name: {
            "robot": robot,
            "gripper": "robotiq_2f85",
            "base": {"xyz": [*base, 0], "rpy": [0, 0, yaw]},
            "tree": {"sequence": [trees[name]]},
        }
        for name, robot, base, yaw in arms
    }
    result = bt.run(file)
    assert result.outcome == "SUCCESS", str(result)


def test_search_for_a_support_ends_where_the_arms_reach_no_farther() -> None:
    """It was PATH_BROKEN, although the support is where the goal is."""
    robot = load_robot("ur5")
    kinematics = MultiArmKinematics({"arm1": (robot, Pose.from_rpy((0, 0, 0)))})
    q = {"arm1": np.array(robot.postures["home"])}
    start = kinematics.forward("arm1", q)
    far = start.shifted(np.array((0.0, 0.0, -2.0)))
    free = cast("GroupChecker", None)  # nothing is checked
    planner = CarryPlanner(kinematics, {"arm1": Pose.from_rpy((0, 0, 0))}, free, seed=0)
    path = planner.down(start, start.shifted(np.array((0.0, 0.0, -0.05))), far, q["arm1"])
    assert 0.05 <= path.poses[-1].distance(start) < 1.9
    assert len(path.rows) == len(path.poses)
    with pytest.raises(bt.Failure, match="only"):
        planner.down(start, far, far, q["arm1"])
