"""Objects on or in a carried object stay there, or the skill reports that they did not."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import bt_dualarm as bt
from bt_dualarm.arm.passengers import steepest
from bt_dualarm.behaviors.report import LeafReport
from tests.families import some

Tree = dict[str, Any]

TOP = 0.4
TABLE = {"shape": "box", "size": [1.2, 0.9, 0.4], "mass": 50, "fixed": True}
HANDS = {"ur5": "robotiq_2f85", "xarm7": "robotiq_2f85", "panda": "panda_hand"}

CARRIERS: dict[str, tuple[Tree, float]] = {
    "bin": ({"shape": "bin", "size": [0.16, 0.12, 0.06], "mass": 0.08}, 0.003),
    "tray": ({"shape": "tray", "size": [0.2, 0.15, 0.03], "mass": 0.08}, 0.003),
    "cup": ({"shape": "cup", "size": [0.036, 0.09], "mass": 0.15}, 0.003),
    "plate": ({"shape": "box", "size": [0.16, 0.06, 0.02], "mass": 0.15}, 0.02),
    "block": ({"shape": "box", "size": [0.05, 0.05, 0.05], "mass": 0.15}, 0.05),
}
"""Carriers, each with the height in m of the surface on which objects stand."""

CONTENTS: dict[str, tuple[Tree, float]] = {
    "cube": ({"shape": "box", "size": [0.03, 0.03, 0.03], "mass": 0.05}, 0.015),
    "can": ({"shape": "cylinder", "size": [0.015, 0.05], "mass": 0.05}, 0.025),
    "ball": ({"shape": "sphere", "size": [0.012], "mass": 0.02}, 0.012),
}


def file_of(
    robot: str, carrier: str, content: str, *after: Tree, reality: str = "lab", **ports: Any
) -> Tree:
    """An arm carries a carrier with an object on it across the table."""
    shape, floor = CARRIERS[carrier]
    rider, middle = CONTENTS[content]
    height = shape["size"][-1]
    goal = {"xyz": [0.45, 0.2, TOP + 0.5 * height], "rpy": [0, 0, 30]}
    above = {"xyz": [0.45, 0.1, TOP + 0.2]}
    leaves = [
        {"grasp": {"object": "carrier"}},
        {"transport": {"object": "carrier", "to": above, **ports}},
        {"place": {"object": "carrier", "at": goal}},
    ]
    at = [0.45, -0.2]
    return {
        "bt_dualarm": 1,
        "name": "passengers",
        "world": {"scene": "empty", "reality": reality, "seed": 1, "time_limit": 60},
        "objects": {
            "table": TABLE | {"pose": {"xyz": [0.5, 0, 0.2]}},
            "carrier": shape | {"pose": {"xyz": [*at, TOP + 0.5 * height]}},
            "rider": rider | {"pose": {"xyz": [*at, TOP + floor + middle]}},
        },
        "arms": {
            "arm1": {
                "robot": robot,
                "gripper": HANDS[robot],
                "base": {"xyz": [0, 0, 0.4]},
                "tree": {"sequence": [*(after or leaves)]},
            }
        },
    }


def leaf(result: bt.RunResult, skill: str, arm: str = "arm1") -> LeafReport:
    """The last run of a skill."""
    return [run for run in result.arms[arm].runs if run.skill == skill][-1]


CASES = [
    ("ur5", "bin", "cube"),
    ("xarm7", "tray", "cube"),
    ("panda", "cup", "ball"),
    ("ur5", "plate", "can"),
    ("panda", "block", "cube"),
    ("xarm7", "bin", "ball"),
]


@pytest.mark.parametrize(("robot", "carrier", "content"), some(CASES, 3))
def test_passenger_is_carried_along(robot: str, carrier: str, content: str) -> None:
    with bt.open(file_of(robot, carrier, content)) as run:
        world = run.world

        def place() -> bt.Pose:
            return world.object_pose("carrier").inverse @ world.object_pose("rider")

        run.step(0.5)
        before = place()
        result = run.finish()
        after = place()
    assert result.outcome == "SUCCESS", [one.reason for one in result.arms["arm1"].runs]
    assert leaf(result, "place").metrics["placed_error_m"] < 2e-3
    # A ball may roll within its walls.
    assert abs(after.position[2] - before.position[2]) < 2e-3
    if content != "ball":
        assert after.distance(before) < 5e-3


def test_arm_tracks_the_pose_of_a_passenger() -> None:
    """The passenger's estimate moves with that of the carrier, and stays with it after release."""
    above = {"above": "rider", "by": 0.15}
    leaves = file_of("ur5", "plate", "can")["arms"]["arm1"]["tree"]["sequence"]
    with bt.open(file_of("ur5", "plate", "can", *leaves, {"reach_to_pose": {"to": above}})) as run:
        result = run.finish()
        assert result.outcome == "SUCCESS", leaf(result, "reach_to_pose").reason
        to_rider = run.world.object_pose("rider").inverse @ run.arms["arm1"].tool_pose
    assert to_rider.position[:2] == pytest.approx((0.0, 0.0), abs=5e-3)


def carried_around_a_wall(run: bt.Run) -> float:
    """Finish the run; returns the largest tilt of the carrier, rad."""
    most = 0.0
    while not run.done:
        run.step(0.02)
        upward = float(run.world.object_pose("carrier").rotation_matrix[2, 2])
        most = max(most, math.acos(min(upward, 1.0)))
    assert run.result.outcome == "SUCCESS", leaf(run.result, "transport").reason
    return most


def test_planned_motion_limits_tilt_and_speed_of_a_loaded_carrier() -> None:
    """Without the limits, the path around a wall tilts the carrier."""
    carry = {"transport": {"object": "carrier", "to": {"xyz": [-0.15, -0.45, 0.6]}, "speed": 1.0}}
    file = file_of("ur5", "block", "can", {"grasp": {"object": "carrier"}}, carry)
    file["objects"]["table"]["pose"]["xyz"] = [0.0, -0.5, 0.2]
    file["objects"]["wall"] = TABLE | {"size": [0.02, 0.3, 0.35]}
    file["objects"]["wall"]["pose"] = {"xyz": [0.1, -0.5, 0.575]}
    for name in ("carrier", "rider"):
        file["objects"][name]["pose"]["xyz"][:2] = [0.3, -0.4]
    with bt.open(file) as run:
        loaded = carried_around_a_wall(run)
        [one] = run.world.passengers_of("carrier")
        slope = steepest(run.world, "carrier", one)
        loaded_s = run.result.sim_time_s
    # It tips at 15 mm / 25 mm, and slides at its friction: 0.6 of the smaller one.
    assert 0.25 < slope <= 0.36 + 1e-6
    assert loaded < math.atan(slope)
    del file["objects"]["rider"]
    with bt.open(file) as run:
        assert carried_around_a_wall(run) > 1.2 * math.atan(slope)
        assert run.result.sim_time_s < loaded_s


def test_branches_that_keep_the_carrier_upright_are_used_near_the_base() -> None:
    """Both skills preferred branches to which the wrist would have to turn the plate over.

    In the remaining one, the arm cannot retreat along the tilted hand: it would fold up.
    """
    plate = {"shape": "box", "size": [0.18, 0.05, 0.025], "mass": 0.2}
    can = {"shape": "cylinder", "size": [0.02, 0.05], "mass": 0.06}
    file = file_of(
        "ur5",
        "plate",
        "can",
        {"grasp": {"object": "carrier", "mass": 0.3}},
        {"transport": {"object": "carrier", "to": {"xyz": [0.45, 0.05, 0.62]}}},
        {"circle": {"radius": 0.05, "plane": "xy"}},
        {"place": {"object": "carrier", "at": {"xyz": [0.45, 0.25, 0.4125]}}},
    )
    file["objects"]["carrier"] = plate | {"pose": {"xyz": [0.42, -0.2, 0.4125], "rpy": [0, 0, 20]}}
    file["objects"]["rider"] = can | {"pose": {"xyz": [0.465, -0.1836, 0.4502]}}
    file["arms"]["arm1"]["robot"] = "ur10e"
    with bt.open(file) as run:
        result = run.finish()
        between = run.world.object_pose("carrier").inverse @ run.world.object_pose("rider")
    arm = result.arms["arm1"]
    assert arm.outcome == "SUCCESS", arm.runs
    assert between.position == pytest.approx((0.048, 0.0, 0.0377), abs=2e-3)
    length = float(leaf(result, "place").metrics["retreated_m"])  # along the hand, of 80 mm up
    assert length == pytest.approx(0.0566, abs=1e-3)


def test_passenger_may_be_poured_out() -> None:
    grasp = {"grasp": {"object": "carrier"}}
    over = {"transport": {"object": "carrier", "to": {"xyz": [0.45, 0.0, TOP + 0.3]}}}
    pour = {"rotate_tool": {"axis": [0, 1, 0], "angle": 70}}
    with bt.open(file_of("ur5", "plate", "cube", grasp, over, pour, {"wait": 1.0})) as run:
        result = run.finish()
        cube = run.world.object_pose("rider").position
    assert result.outcome == "SUCCESS", [one.reason for one in result.arms["arm1"].runs]
    assert cube[2] < TOP + 0.1


def test_held_cup_is_tilted_about_its_lip() -> None:
    """The lip stays where it is, wherever the hand has grasped the cup."""
    lip = np.array((0.03, 0.0, 0.04))
    over = {"transport": {"object": "carrier", "to": {"xyz": [0.45, 0.0, TOP + 0.3]}}}
    pour = {"rotate_tool": {"axis": "y", "angle": 60, "frame": "object", "point": lip.tolist()}}
    poses = []
    for leaves in ([over], [over, pour]):
        with bt.open(
            file_of("ur5", "cup", "ball", {"grasp": {"object": "carrier"}}, *leaves)
        ) as run:
            result = run.finish()
            poses.append(run.world.object_pose("carrier"))
        assert result.outcome == "SUCCESS", [one.reason for one in result.arms["arm1"].runs]
    before, after = poses
    assert after.apply(lip) == pytest.approx(before.apply(lip), abs=1e-3)
    turned = (before.inverse @ after).rotation.as_rotvec(degrees=True)
    assert turned == pytest.approx((0.0, 60.0, 0.0), abs=0.5)


def test_balls_are_poured_out_one_after_the_other() -> None:
    """The first ones that fell were in the way of those that were still in the cup."""
    pour = {"rotate_tool": {"axis": [1, 0, 0], "frame": "world", "angle": -135, "speed": 0.2}}
    file = file_of(
        "ur5",
        "cup",
        "ball",
        {"grasp": {"object": "carrier", "approach": [0, 1, 0]}},
        {"transport": {"object": "carrier", "to": {"xyz": [0.45, 0.0, TOP + 0.2]}}},
        pour,
        {"wait": 1.0},
    )
    file["objects"]["rider"] = {"shape": "sphere", "size": [0.006], "mass": 0.002} | {
        "friction": 0.2,
        "pose": {"xyz": [0.45, -0.2, TOP + 0.01]},
        "many": {"pile": 12, "area": [0.03, 0.03]},
    }
    box = {"shape": "bin", "size": [0.3, 0.3, 0.05], "fixed": True}
    file["objects"]["box"] = box | {"pose": {"xyz": [0.45, 0.1, TOP + 0.025]}}
    with bt.open(file) as run:
        result = run.finish()
        balls = [run.world.object_pose(f"rider{number}").position for number in range(1, 13)]
    assert result.outcome == "SUCCESS", [one.reason for one in result.arms["arm1"].runs]
    assert max(ball[2] for ball in balls) < TOP + 0.05


def test_tall_passenger_in_a_bin_is_an_obstacle_to_the_open_hand() -> None:
    """A finger pushed a wall of the bin 47 mm before the goal: NOT_GRASPED."""
    file = file_of("ur5", "bin", "can", {"grasp": {"object": "carrier"}})
    file["objects"]["carrier"] |= {"mass": 0.1, "pose": {"xyz": [0.42, -0.2, 0.43]}}
    file["objects"]["carrier"]["pose"]["rpy"] = [0, 0, 17.24]
    file["objects"]["rider"] |= {"size": [0.02, 0.07], "mass": 0.148}
    file["objects"]["rider"]["pose"] = {"xyz": [0.42, -0.2, 0.438]}
    result = bt.run(file)
    assert result.outcome == "SUCCESS", leaf(result, "grasp").reason


def test_load_that_no_feasible_grasp_bears_is_too_heavy() -> None:
    file = file_of("panda", "bin", "cube", {"grasp": {"object": "carrier"}})
    file["objects"]["rider"]["mass"] = 0.4
    found = leaf(bt.run(file), "grasp")
    assert found.code == "TOO_HEAVY"
    assert "0.48 kg of" in found.reason
    file["world"]["reality"] = "rough"
    found = leaf(bt.run(file), "grasp")
    assert found.code == "TOO_HEAVY"
    assert "1 kg (assumed, as `mass` is not given) of" in found.reason


def test_two_arms_carry_a_loaded_tray_without_moving_its_load() -> None:
    def arm(robot: str, x: float, other: str, **ports: Any) -> Tree:
        together = {"carry_together": {"object": "carrier", "with": [other], **ports}}
        base: Tree = {"xyz": [x, 0, 0.4]}
        if robot != "ur5":
            base["rpy"] = [0, 0, -90]
        return {"robot": robot, "gripper": HANDS[robot], "base": base, "tree": together}

    path = [
        {"xyz": [0.05, -0.48, 0.70], "rpy": [0, 0, 10]},
        {"xyz": [0.03, -0.40, 0.515], "rpy": [0, 0, 0]},
    ]
    file = {
        "bt_dualarm": 1,
        "name": "tray",
        "world": {"scene": "empty", "reality": "lab", "seed": 0, "time_limit": 60},
        "objects": {
            "stand": TABLE | {"size": [0.4, 0.4, 0.5], "pose": {"xyz": [0, -0.45, 0.25]}},
            "carrier": {"shape": "tray", "size": [0.6, 0.3, 0.03], "mass": 1.0}
            | {"pose": {"xyz": [0, -0.45, 0.515]}},
            "can": {"shape": "cylinder", "size": [0.033, 0.1], "mass": 0.3}
            | {"pose": {"xyz": [0.05, -0.45, 0.553]}},
            "cube": CONTENTS["cube"][0] | {"pose": {"xyz": [-0.08, -0.42, 0.518]}},
        },
        "arms": {
            "arm1": arm("ur5", -0.65, "arm2", path=path),
            "arm2": arm("panda", 0.65, "arm1"),
        },
    }
    with bt.open(file) as run:
        world = run.world
        start = {name: world.object_pose(name) for name in ("carrier", "can", "cube")}
        result = run.finish()
        end = {name: world.object_pose(name) for name in ("carrier", "can", "cube")}
    assert result.outcome == "SUCCESS", leaf(result, "carry_together").reason
    assert end["carrier"].distance(start["carrier"]) > 0.05
    for name in ("can", "cube"):
        before, after = (poses["carrier"].inverse @ poses[name] for poses in (start, end))
        assert after.distance(before) < 3e-3
        assert np.degrees(after.angle(before)) < 5.0


TAKERS = [("ur5", "panda"), ("xarm7", "ur5"), ("xarm7", "panda")]


@pytest.mark.parametrize(("holder", "taker"), some(TAKERS, 2))
def test_arm_takes_an_object_from_a_tray_held_by_another_arm(holder: str, taker: str) -> None:
    """The guard keeps objects of two arms apart, so the taker could not lift it (DEADLOCK)."""
    y = -0.45
    back = [-0.1, y, TOP + 0.015]
    waiter = [
        {"grasp": {"object": "carrier", "point": [-0.12, 0, 0]}},
        {"transport": {"object": "carrier", "to": {"xyz": [-0.05, y, TOP + 0.2]}}},
        {"meet": "held"},
        {"meet": "taken"},
        {"place": {"object": "carrier", "at": {"xyz": back}}},
    ]
    guest: list[Any] = [
        {"meet": "held"},
        {"grasp": {"object": "cube", "approach": [0, 0, -1]}},
        "go_home",
        {"meet": "taken"},
        {"place": {"object": "cube", "at": {"xyz": [0.35, y, TOP + 0.02]}}},
    ]
    arms = {}
    for arm, robot, x, leaves in (("waiter", holder, -0.6, waiter), ("guest", taker, 0.6, guest)):
        turn = 0 if robot == "ur5" else -90
        arms[arm] = {
            "robot": robot,
            "gripper": HANDS[robot],
            "base": {"xyz": [x, 0, 0.4], "rpy": [0, 0, turn]},
            "tree": {"sequence": leaves},
        }
    cube = {"shape": "box", "size": [0.04, 0.04, 0.04], "mass": 0.03}
    file = {
        "bt_dualarm": 1,
        "name": "tray",
        "world": {"scene": "empty", "reality": "lab", "seed": 0, "time_limit": 60},
        "cell": {"rendezvous": {"held": list(arms), "taken": list(arms)}},
        "objects": {
            "table": TABLE | {"size": [1.6, 0.6, 0.4], "pose": {"xyz": [0, y, 0.2]}},
            "carrier": {"shape": "tray", "size": [0.24, 0.12, 0.03], "mass": 0.08}
            | {"pose": {"xyz": back}},
            "cube": cube | {"pose": {"xyz": [-0.02, y, TOP + 0.0232]}},
            "stays": CONTENTS["cube"][0] | {"mass": 0.02, "pose": {"xyz": [-0.1, y, TOP + 0.0182]}},
        },
        "arms": arms,
    }
    with bt.open(file) as run:
        world = run.world
        result = run.finish()
        rider = world.object_pose("carrier").inverse @ world.object_pose("stays")
    assert result.outcome == "SUCCESS", [
        leaf.reason for arm in arms for leaf in result.arms[arm].runs
    ]
    assert np.linalg.norm(rider.position[:2]) < 5e-3


PLACED = [("ur5", "panda", "tray"), ("ur10e", "xarm7", "bin"), ("xarm7", "fr3", "board")]


@pytest.mark.parametrize(("holder", "placer", "kind"), some(PLACED, 2))
def test_arm_places_an_object_on_a_carrier_held_by_another_arm(
    holder: str, placer: str, kind: str
) -> None:
    """It waited for the other arm to leave (DEADLOCK), or pressed the carrier down (NO_CONTACT)."""
    y = -0.45
    kinds: dict[str, tuple[Tree, float, float]] = {
        "tray": ({"shape": "tray", "size": [0.30, 0.16, 0.03], "mass": 0.06}, 0.015, -0.012),
        "board": ({"shape": "box", "size": [0.34, 0.06, 0.03], "mass": 0.2}, 0.015, 0.015),
        "bin": ({"shape": "bin", "size": [0.26, 0.14, 0.05], "mass": 0.06}, 0.025, -0.022),
    }
    shape, half, floor = kinds[kind]
    end = -0.5 * shape["size"][0]
    rests = {"xyz": [-0.12, y, TOP + half]}
    mass, inward = (0.3, 0.03) if kind == "board" else (0.12, 0.0)
    grasp = {"object": "carrier", "mass": mass, "point": [end + inward, 0, 0]}
    waiter = [
        {"grasp": grasp},
        {"transport": {"object": "carrier", "to": {"xyz": [-0.05, y, TOP + 0.2]}}},
        {"meet": "held"},
        {"meet": "put"},
        {"transport": {"object": "carrier", "to": {"xyz": [-0.15, y, TOP + 0.2]}}},
        {"place": {"object": "carrier", "at": rests}},
    ]
    goal = {"xyz": [0.02, y, TOP + 0.2 + floor + 0.0175]}
    guest: list[Any] = [
        {"grasp": {"object": "cube"}},
        {"meet": "held"},
        {"place": {"object": "cube", "at": goal}},
        {"move_linear": {"offset": {"xyz": [0.08, 0, 0.06]}}},
        {"meet": "put"},
        "go_home",
    ]
    cube = {"shape": "box", "size": [0.035, 0.035, 0.035], "mass": 0.04}
    table = TABLE | {"size": [1.6, 0.6, 0.4], "pose": {"xyz": [0, y, 0.2]}}
    hands = HANDS | {"fr3": "panda_hand", "ur10e": "robotiq_2f85"}

    def arm(robot: str, base: Tree, leaves: list[Any]) -> Tree:
        return {"robot": robot, "gripper": hands[robot], "base": base, "tree": {"sequence": leaves}}

    file = {
        "bt_dualarm": 1,
        "name": "served",
        "world": {"scene": "empty", "reality": "lab", "seed": 0, "time_limit": 60},
        "objects": {
            "table": table,
            "carrier": shape | {"pose": rests},
            "cube": cube | {"pose": {"xyz": [0.33, y, TOP + 0.0175]}},
        },
        "cell": {"rendezvous": {"held": ["arm1", "arm2"], "put": ["arm1", "arm2"]}},
        "arms": {
            "arm1": arm(holder, {"xyz": [-0.42, 0, 0.4]}, waiter),
            "arm2": arm(placer, {"xyz": [0.45, 0, 0.4], "rpy": [0, 0, -135]}, guest),
        },
    }
    with bt.open(file) as run:
        result = run.finish()
        world = run.world
        between = world.object_pose("carrier").inverse @ world.object_pose("cube")
    assert result.outcome == "SUCCESS", [run for arm in result.arms.values() for run in arm.runs]
    assert between.position[2] == pytest.approx(floor + 0.0175, abs=2e-3)
    placed = leaf(result, "place", "arm2").metrics
    assert float(placed["placed_error_m"]) < 3e-3
    assert float(placed["height_off_m"]) > -3e-3, "it must not be pressed down"


def handed_over(giver: str, taker: str, *after: Any) -> Tree:
    """A loaded bar is handed over; ``after`` are the leaves of the taker after that."""
    hands = HANDS | {"fr3": "panda_hand", "ur10e": "robotiq_2f85"}
    top = 0.2

    def arm(robot: str, base: Tree, leaves: list[Any]) -> Tree:
        return {"robot": robot, "gripper": hands[robot], "base": base, "tree": {"sequence": leaves}}

    return {
        "bt_dualarm": 1,
        "name": "loaded",
        "world": {"scene": "empty", "reality": "lab", "seed": 0, "time_limit": 60},
        "objects": {
            "shelf": TABLE | {"size": [0.2, 0.2, top], "pose": {"xyz": [0.35, -0.4, 0.5 * top]}},
            "carrier": {"shape": "box", "size": [0.24, 0.05, 0.03], "mass": 0.25}
            | {"pose": {"xyz": [0.35, -0.4, top + 0.015]}},
            "can": {"shape": "cylinder", "size": [0.018, 0.04], "mass": 0.05}
            | {"pose": {"xyz": [0.35, -0.4, top + 0.05]}},
        },
        "arms": {
            "arm1": arm(
                giver,
                {"xyz": [0, 0, 0]},
                [
                    {"grasp": {"object": "carrier"}},
                    {"hand_over": {"object": "carrier", "to": "arm2"}},
                ],
            ),
            "arm2": arm(
                taker,
                {"xyz": [1.05, 0, 0], "rpy": [0, 0, 180]},
                [{"take_over": {"object": "carrier", "from": "arm1"}}, *after],
            ),
        },
    }


@pytest.mark.parametrize(
    ("giver", "taker"), some([("ur10e", "xarm7"), ("ur5", "panda"), ("xarm7", "ur5")], 3)
)
def test_loaded_object_is_handed_over_upright(giver: str, taker: str) -> None:
    """The pose was chosen by reach alone: the can fell, and both arms reported SUCCESS.

    The xArm7 refuses to go home, where the can would fall off the tilted carrier.
    """
    steepest_rad = 0.0
    with bt.open(handed_over(giver, taker, {"force_success": {"child": "go_home"}})) as run:
        world = run.world
        run.step(0.2)
        start = world.object_pose("carrier").inverse @ world.object_pose("can")
        while not run.done:
            run.step(0.2)
            up = float(world.object_pose("carrier").rotation_matrix[2, 2])
            steepest_rad = max(steepest_rad, math.acos(min(up, 1.0)))
        result = run.finish()
        end = world.object_pose("carrier").inverse @ world.object_pose("can")
        assert world.attachments.holders("carrier") == ("arm2",)
    assert result.outcome == "SUCCESS", [run for arm in result.arms.values() for run in arm.runs]
    assert end.distance(start) < 3e-3
    assert steepest_rad < math.radians(15.0)
    home = leaf(result, "go_home", "arm2")
    if taker == "xarm7":
        assert home.code == "SPILLED"
        assert home.reason == "can would fall off 'carrier' there: set it down first"
        assert home.ended_s == home.started_s, "before anything moves"
