"""Handovers between all types of hands, by sensors alone, with faults of either arm."""

from __future__ import annotations

import copy
import re
from collections.abc import Callable
from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import bt_dualarm as bt
from bt_dualarm.arm.known_objects import KnownObjects
from bt_dualarm.control.payload_estimation import PayloadEstimator
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.sim.world import World
from bt_dualarm.skill.handover import HandoverSearch, retreat_directions
from tests.families import some
from tests.plays import Play, Stage
from tests.skills.scenarios import GIVER, GRASP, ON_SHELF, PICK, TAKER, TAKES, Tree

GIVE: Tree = {"hand_over": {"object": "cube", "to": "arm2"}}
NAMES = ("arm1", "arm2")
HANDED_S = (4.5, 6.1, 6.6, 7.4, 7.8, 7.92, 8.7)
"""Moments of the handover of the scenario, s: transport, approach, closing, both hold, promised,
opening, retreat."""


def file_with(giver: Tree, taker: Tree, **arms: Any) -> Tree:
    """Two arms and the bar."""
    world = {"scene": "empty", "time_limit": 40.0, "reality": arms.pop("reality", "ideal")}
    objects = copy.deepcopy(ON_SHELF) | arms.pop("objects", {})
    one = GIVER | {"tree": giver} | arms.pop("arm1", {})
    two = TAKER | {"tree": taker} | arms.pop("arm2", {})
    return {
        "name": "handed",
        "world": world,
        "objects": objects,
        "arms": {"arm1": one, "arm2": two},
    }


def watched(stage: Stage, file: Tree, *watchers: Callable[[World], None], **more: Any) -> Play:
    """Play a file to its end; call the watchers after each step."""
    play = stage.play(file, **more)
    play.watchers += watchers
    play.run()
    return play


class Watch:
    """True contacts: for how long no hand touches the bar, and how far it falls meanwhile."""

    def __init__(self) -> None:
        self.unheld_s = 0.0
        self.fell_m = 0.0
        self._since: tuple[float, float] | None = None
        self._was_held = False

    def __call__(self, world: World) -> None:
        if "cube" not in world.objects:
            return
        held = any(
            world.attachments.find(arm, "cube") is not None and world.touches(arm, "cube")
            for arm in world.arms
        )
        self._was_held = self._was_held or (held and world.object_pose("cube").position[2] > 0.24)
        if held or not self._was_held:
            self._since = None
            return
        height = float(world.object_pose("cube").position[2])
        self._since = self._since or (world.time, height)
        self.unheld_s = max(self.unheld_s, world.time - self._since[0])
        self.fell_m = max(self.fell_m, self._since[1] - height)


@pytest.mark.parametrize(
    ("giving", "taking"),
    some(
        [
            ("robotiq_2f85", "suction_cup"),
            ("suction_cup", "panda_hand"),
            (None, "panda_hand"),
            ("robotiq_2f85", None),
        ],
        2,
    ),
)
def test_every_type_of_hand_gives_and_takes(
    giving: str | None, taking: str | None, stage: Stage
) -> None:
    take = PICK if giving is None else GRASP
    size = {"size": [0.16, 0.06, 0.05], "pose": {"xyz": [0.35, -0.4, 0.225]}}
    wide = {"cube": ON_SHELF["cube"] | size}
    one: Tree = {"gripper": giving} if giving else {}
    two: Tree = {"gripper": taking} if taking else {}
    file = file_with({"sequence": [take, GIVE]}, TAKES, objects=wide)
    for name, hand in (("arm1", one), ("arm2", two)):
        file["arms"][name].pop("gripper")
        file["arms"][name] |= hand
    play = stage.run(file)
    assert [play.arm(name).outcome for name in ("arm1", "arm2")] == ["SUCCESS", "SUCCESS"]
    assert play.world.attachments.holders("cube") == ("arm2",)


@pytest.mark.parametrize("reality", some(["rough", "lab"], 2))
def test_bar_is_held_at_any_time(reality: str, stage: Stage) -> None:
    file = file_with({"sequence": [GRASP, GIVE]}, TAKES, reality=reality)
    watch = Watch()
    play = watched(stage, file, watch)
    assert play.leaf("take_over", "arm2").status == "SUCCESS", play.leaf("take_over", "arm2").reason
    assert watch.unheld_s == 0.0
    (held,) = play.world.attachments
    assert (held.arm, held.share) == ("arm2", 1.0)
    assert play.world.attachments.shared_grasps("arm2") == ()


def test_taker_makes_room_where_the_giver_weighs_the_object(stage: Stage) -> None:
    """Its hand is 90 mm above the end of a bar that the giver raises by 50 mm to learn its mass."""
    grasp = {"grasp": {"object": "cube", "point": [-0.1, 0, 0]}}
    held = {"transport": {"to": {"xyz": [0.5, -0.3, 0.35], "rpy": [0, 0, 0]}}}
    above = {"reach_to_pose": {"to": {"xyz": [0.66, -0.3, 0.44], "rpy": [180, 0, 90]}}}
    giver = {"sequence": [grasp, held, {"meet": "held"}, {"meet": "near"}, GIVE]}
    taker = {"sequence": [{"meet": "held"}, above, {"meet": "near"}, TAKES]}
    bar = {"cube": ON_SHELF["cube"] | {"size": [0.4, 0.035, 0.035]}}
    file = file_with(giver, taker, reality="rough", objects=bar)
    file["cell"] = {"rendezvous": {"held": list(NAMES), "near": list(NAMES)}}
    play = stage.run(file)
    assert [play.arm(name).outcome for name in NAMES] == ["SUCCESS", "SUCCESS"]


def test_object_is_presented_in_the_requested_orientation(stage: Stage) -> None:
    given = {"hand_over": {"object": "cube", "to": "arm2", "orientation": [0, 0, -90]}}
    taken: dict[str, float] = {}

    def record_orientation(world: World) -> None:
        if world.attachments.holders("cube") == ("arm1", "arm2") and not taken:
            taken["along_y"] = abs(float(world.object_pose("cube").rotation_matrix[1, 0]))

    play = watched(stage, file_with({"sequence": [GRASP, given]}, TAKES), record_orientation)
    assert play.arm("arm2").outcome == "SUCCESS"
    assert taken["along_y"] > 0.999


@pytest.mark.parametrize(("who", "at"), some(product(("arm1", "arm2"), HANDED_S), 7))
def test_bar_stays_held_when_one_arm_is_halted(who: str, at: float, stage: Stage) -> None:
    file = file_with({"sequence": [GRASP, GIVE]}, TAKES)
    arm = file["arms"][who]
    arm["tree"] = {"timeout": {"seconds": at, "child": arm["tree"]}}
    watch = Watch()
    play = watched(stage, file, watch)
    other, skill = ("arm2", "take_over") if who == "arm1" else ("arm1", "hand_over")
    leaf = play.leaf(skill, other)
    assert leaf.status == "SUCCESS" or (leaf.code == "PARTNER_GONE" and who in leaf.reason)
    assert watch.fell_m < 0.002
    assert len(play.world.attachments) == 1
    assert play.world.attachments.shared_grasps("arm1") == ()


@pytest.mark.parametrize(("who", "at"), some(product(("arm1", "arm2"), (7.0, 7.6, 7.7)), 4))
def test_failure_names_the_removed_arm(who: str, at: float, stage: Stage) -> None:
    file = file_with({"sequence": [GRASP, GIVE]}, TAKES)
    play = stage.run(file, interventions=((at, lambda world: world.remove_arm(who)),))
    other, skill = ("arm2", "take_over") if who == "arm1" else ("arm1", "hand_over")
    leaf = play.leaf(skill, other)
    assert leaf.code == "PARTNER_GONE"
    assert f"{who} was removed" in leaf.reason or f"{who} has ended" in leaf.reason
    assert all(one.arm == other and one.share == 1.0 for one in play.world.attachments)


@pytest.mark.parametrize(("who", "at"), some(product(NAMES, HANDED_S), 5))
def test_another_attempt_completes_a_handover_that_was_cut_off(
    who: str, at: float, stage: Stage
) -> None:
    """Whichever arm has the object then, and wherever the hands are."""
    cut: Tree = {"parallel": {"policy": "any", "children": [{"wait": at}]}}
    trees = {}
    for name, before, leaf in (("arm1", [GRASP], GIVE), ("arm2", [], TAKES)):
        attempts: Tree = {"retry": {"times": 3, "child": leaf}}
        if name == who:
            halted = copy.deepcopy(cut)
            halted["parallel"]["children"].append({"sequence": [*before, leaf]})
            attempts = {"sequence": [halted, attempts]}
        else:
            attempts = {"sequence": [*before, attempts]}
        trees[name] = {"sequence": [attempts, "go_home"]}
    watch = Watch()
    play = watched(stage, file_with(trees["arm1"], trees["arm2"]), watch)
    outcomes = {name: str(play.arm(name).outcome) for name in NAMES}
    assert outcomes == dict.fromkeys(NAMES, "SUCCESS")
    assert play.world.attachments.holders("cube") == ("arm2",)
    assert watch.unheld_s < 0.02


@pytest.mark.parametrize("at", [8.5, 8.7, 9.0])
def test_giver_that_was_halted_in_its_retreat_completes_it(at: float, stage: Stage) -> None:
    """In the first further attempt, although the arm still brakes when that begins."""
    first = {"sequence": [GRASP, GIVE]}
    cut_off = {"parallel": {"policy": "any", "children": [{"wait": at}, first]}}
    play = stage.run(
        file_with({"sequence": [cut_off, GIVE]}, {"retry": {"times": 3, "child": TAKES}})
    )
    halted, again = (run for run in play.arm("arm1").runs if run.skill == "hand_over")
    assert halted.code == "HALTED"
    assert again.status == "SUCCESS", again.reason
    assert play.world.attachments.holders("cube") == ("arm2",)


@pytest.mark.parametrize(
    ("reality", "weighs", "weight"),
    [
        ("ideal", True, r"0\.3 kg;"),
        ("rough", True, r"0\.3\d\d kg;"),
        ("rough", False, r"1 kg \(assumed, as `mass` is not given\);"),
    ],
)
def test_refusal_states_the_mass_that_no_grasp_can_hold(
    reality: str, weighs: bool, weight: str, stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Large arms cannot weigh a light bar: the mass is assumed then, and not the hand too near."""
    monkeypatch.setattr(PayloadEstimator, "update", lambda *_: False)
    if not weighs:
        monkeypatch.setattr(KnownObjects, "weighed", lambda *_: None)
    takes = {"take_over": TAKES["take_over"] | {"most_force": 2.0}}
    play = stage.run(file_with({"sequence": [GRASP, GIVE]}, takes, reality=reality))
    refusal = play.leaf("take_over", "arm2")
    assert refusal.code == "OUT_OF_REACH"
    assert re.search(f"leaves the hand of arm1 room and holds {weight}", refusal.reason)


def test_refusal_states_that_the_fingers_of_the_taker_do_not_open_that_far(stage: Stage) -> None:
    """Another grasp of the giver would not help, which the refusal advised."""
    wide = ON_SHELF["cube"] | {"size": [0.16, 0.079, 0.079]}
    wide["pose"] = {"xyz": [0.35, -0.4, 0.24]}
    play = stage.run(file_with({"sequence": [GRASP, GIVE]}, TAKES, objects={"cube": wide}))
    refusal = play.leaf("take_over", "arm2")
    assert refusal.code == "OUT_OF_REACH"
    assert refusal.reason == "'cube' is 79 mm wide; the fingers of arm2 open to 80 mm"


def test_result_does_not_depend_on_the_order_of_the_arms(stage: Stage) -> None:
    file = file_with({"sequence": [GRASP, GIVE]}, TAKES)
    reverse = {**file, "arms": dict(reversed(file["arms"].items()))}
    ends = [
        [(leaf.skill, leaf.code, leaf.ended_s) for arm in NAMES for leaf in play.arm(arm).runs]
        for play in (stage.run(file), stage.run(reverse))
    ]
    assert ends[0] == ends[1]


def test_giver_that_stays_near_does_not_fail_the_handover(stage: Stage) -> None:
    """Its open fingers end within the 30 mm that arms keep from each other."""
    give: Tree = {"object": "box", "to": "taker", "at": {"xyz": [0.45, -0.05, 0.45]}}
    give["retreat"] = 0.03
    giver: Tree = {"robot": "ur3e", "gripper": "panda_hand"}
    slowly: Tree = {"go_home": {"speed": 0.1}}
    giver["tree"] = {"sequence": [{"grasp": {"object": "box"}}, {"hand_over": give}, slowly]}
    taker: Tree = {"robot": "ur10e", "gripper": "suction_cup"}
    taker |= {"base": {"xyz": [1.1, 0, 0], "rpy": [0, 0, 180]}}
    taker["tree"] = {"take_over": {"object": "box", "from": "giver"}}
    box: Tree = {"shape": "box", "size": [0.16, 0.06, 0.05], "mass": 0.4, "color": "orange"}
    box["pose"] = {"xyz": [0.35, -0.4, 0.2255]}
    play = stage.run(
        {
            "name": "near",
            "world": {"scene": "empty", "reality": "lab", "time_limit": 40.0},
            "objects": {"shelf": ON_SHELF["shelf"], "box": box},
            "arms": {"giver": giver, "taker": taker},
        },
        seed=11,
    )
    taken = play.leaf("take_over", "taker")
    assert taken.status == "SUCCESS", taken.reason
    assert "lifted_m" not in taken.metrics, "it must not have room to yield and to lift"
    assert play.world.attachments.holders("box") == ("taker",)


MARKED: Tree = {
    "shelf": ON_SHELF["shelf"] | {"size": [0.1, 0.06, 0.2]},
    "cube": ON_SHELF["cube"]
    | {"size": [0.24, 0.05, 0.04], "color": "white", "pose": {"xyz": [0.35, -0.4, 0.22]}}
    | {"marker": {"dictionary": "apriltag_36h11", "id": 5, "size": 0.035}},
}
"""A bar with a marker on top, which may be grasped from the side."""

SLID_M = 0.012
"""Slip of the bar in the giver's hand, undetected by the giver, m."""

SLIDES_S = 8.0


@pytest.mark.parametrize(
    ("robot", "gripper", "x"), [("ur10e", "suction_cup", 1.15), ("panda", "none", 1.0)]
)
def test_taker_does_not_turn_the_object_in_the_fingers_of_the_giver(
    robot: str, gripper: str, x: float
) -> None:
    """A cup pressed on where it had sealed, until the bar was tilted by 3.5° and it leaked.

    The fingertips of a Panda, a bare tool here, met the bar at 135 mm/s, 10 mm before the end of
    the approach: its tool frame is between them.
    """
    web = {"shape": "box", "size": [0.24, 0.05, 0.03]}
    top = {"shape": "box", "size": [0.08, 0.05, 0.03], "pose": {"xyz": [0, 0, 0.03]}}
    shelf = {"shape": "box", "size": [0.2, 0.2, 0.2], "mass": 1, "fixed": True}
    bar = {"shape": "compound", "mass": 0.3, "parts": {"web": web, "top": top}}
    file: Tree = {
        "bt_dualarm": 1,
        "world": {"scene": "empty", "time_limit": 40.0},
        "objects": {
            "shelf": shelf | {"pose": {"xyz": [0.35, -0.4, 0.1]}},
            "bar": bar | {"pose": {"xyz": [0.35, -0.4, 0.2158], "rpy": [0, 0, 30]}},
        },
        "arms": {
            "arm1": {
                "robot": "ur5",
                "gripper": "robotiq_2f85",
                "tree": {
                    "sequence": [
                        {"grasp": {"object": "bar"}},
                        {"hand_over": {"object": "bar", "to": "arm2"}},
                    ]
                },
            },
            "arm2": {
                "robot": robot,
                "gripper": gripper,
                "base": {"xyz": [x, 0.1, 0], "rpy": [0, 0, 180]},
                "tree": {"take_over": {"object": "bar", "from": "arm1"}},
            },
        },
    }
    held: list[Pose] = []
    with bt.open(file) as run:
        while not run.done:
            run.step(0.02)
            if run.world.attachments.holders("bar") == ("arm1",):
                hand = run.arms["arm1"].tool_pose
                held.append(hand.inverse @ run.world.object_pose("bar"))
        taken = run.finish().arms["arm2"].runs[-1]
    assert taken.status == "SUCCESS", taken.reason
    assert max(held[0].angle(later) for later in held) < np.radians(0.5)


def slide(world: World) -> None:
    """Slide the bar along its longest axis."""
    start = world.pose_address("cube")
    world.data.qpos[start : start + 3] += SLID_M * world.object_pose("cube").rotation_matrix[:, 0]


def test_taker_with_a_bare_tool_keeps_what_it_has_taken_elsewhere() -> None:
    """The giver is wrong about the plate by 40 mm; the failure named the gripper that is not there.

    The plate did not fall: the tool is attached to it.
    """
    plate = {"shape": "box", "size": [0.24, 0.02, 0.16], "mass": 0.2}
    wrong = {"xyz": [0.44, -0.3, 0.48], "rpy": [0, 0, 0]}
    grasp = {"grasp": {"object": "plate", "at": wrong, "point": [-0.04, 0, 0.06]}}
    base = {"xyz": [1.1, 0, 0.4], "rpy": [0, 0, 180]}
    file: Tree = {
        "bt_dualarm": 1,
        "world": {"scene": "table", "time_limit": 40.0},
        "objects": {"plate": plate | {"pose": {"xyz": [0.4, -0.3, 0.48]}}},
        "arms": {
            "arm1": {
                "robot": "ur5",
                "gripper": "robotiq_2f85",
                "base": {"xyz": [0, 0, 0.4]},
                "tree": {
                    "sequence": [grasp, {"hand_over": {"object": "plate", "to": "arm2"}}],
                },
            },
            "arm2": {
                "robot": "ur5",
                "base": base,
                "tree": {"take_over": {"object": "plate", "from": "arm1"}},
            },
        },
    }
    with bt.open(file) as run:
        taken = run.finish().arms["arm2"].runs[-1]
        assert run.world.attachments.holders("plate") == ("arm2",)
    assert taken.code == "DROPPED", taken.reason
    assert "40 mm from where arm2 should hold it" in taken.reason


@pytest.mark.parametrize("looks", [True, False])
def test_taker_uses_the_pose_that_it_has_located(looks: bool, stage: Stage) -> None:
    """Without its camera, it uses the giver's estimate, although the bar has slipped there."""
    shows: Tree = {
        "sequence": [
            {"grasp": {"object": "cube", "approach": [0, -1, 0], "point": [0.09, 0, 0]}},
            {"reach_to_pose": {"to": {"xyz": [0.42, -0.2, 0.3]}}},
            {"wait": {"seconds": 1}},
            {"signal": "shown"},
            {"await": "seen"},
            GIVE,
        ]
    }
    sight: list[Any] = [
        {"look_at": {"at": {"xyz": [0.33, -0.2, 0.3]}, "distance": 0.35}},
        {"locate": {"object": "cube", "by": "marker", "accuracy": 0.003}},
    ]
    takes: Tree = {
        "sequence": [{"await": "shown"}, *(sight if looks else []), {"signal": "seen"}, TAKES]
    }
    file = file_with(shows, takes, reality="lab", objects=MARKED, arm2={"camera": {}})
    file["cell"] = {
        "signals": {
            "shown": {"type": "boolean", "written_by": ["arm1"]},
            "seen": {"type": "boolean", "written_by": ["arm2"]},
        }
    }
    play = stage.play(file, interventions=((SLIDES_S, slide),))
    play.run()
    waits = play.leaf("wait")
    assert waits.ended_s is not None
    assert waits.started_s < SLIDES_S < waits.ended_s
    taken = play.leaf("take_over", "arm2")
    assert taken.status == "SUCCESS", taken.reason
    error = taken.metrics["held_error_m"]
    assert error < 0.004 if looks else error > 0.008


def test_arms_that_block_each_other_resolve_the_deadlock(stage: Stage) -> None:
    """Fast arms moving to the handover pose each waited for the other, up to a minute."""
    grasp = {"object": "cube", "approach": [0, -1, 0], "point": [0.09, 0, 0]}
    gives: Tree = {
        "sequence": [
            {"grasp": grasp | {"speed": 1.0, "approach_speed": 1.0}},
            {"reach_to_pose": {"to": {"xyz": [0.42, -0.2, 0.3]}, "speed": 1.0}},
            {"wait": {"seconds": 1}},
            {"signal": "shown"},
            {"hand_over": {"object": "cube", "to": "arm2", "speed": 1.0, "retreat_speed": 1.0}},
        ]
    }
    takes: Tree = {
        "sequence": [
            {"await": "shown"},
            {"take_over": {"object": "cube", "from": "arm1", "speed": 1.0}},
        ]
    }
    file = file_with(gives, takes, reality="lab", objects=MARKED)
    file["cell"] = {"signals": {"shown": {"type": "boolean", "written_by": ["arm1"]}}}
    play = stage.play(file)
    play.run()
    taken = play.leaf("take_over", "arm2")
    assert taken.status == "SUCCESS", taken.reason
    assert taken.ended_s is not None
    assert taken.ended_s < 25.0


def test_pose_of_an_object_taken_off_center_is_known(stage: Stage) -> None:
    """The fingers were assumed to close at its center: 45 mm away, it counted as dropped."""
    obj: Tree = {
        "shape": "compound",
        "mass": 0.3,
        "pose": {"xyz": [0.2, -0.42, 0.4605], "rpy": [0, 0, -31]},
        "parts": {
            "post": {"shape": "box", "size": [0.04, 0.04, 0.12]},
            "foot": {
                "shape": "box",
                "size": [0.12, 0.03, 0.03],
                "pose": {"xyz": [0.08, 0, -0.045]},
            },
        },
    }
    gives = {"sequence": [{"grasp": {"object": "cube", "part": "post"}}, GIVE]}
    file = file_with(gives, TAKES, objects={"cube": obj})
    for arm, robot, x, yaw in (("arm1", "xarm7", -0.1, 0), ("arm2", "ur10e", 0.75, 180)):
        base = {"xyz": [x, -0.1, 0.4], "rpy": [0, 0, yaw]}
        file["arms"][arm] |= {"robot": robot, "gripper": "robotiq_2f85", "base": base}
    file["world"]["scene"] = "table"
    play = stage.run(file)
    leaf = play.leaf("take_over", arm="arm2")
    assert leaf.status == "SUCCESS", leaf.reason
    assert float(leaf.metrics["held_error_m"]) < 2e-3


BASES: dict[str, list[dict[str, Any]]] = {
    "panda": [{"xyz": [0, 0.3, 0]}, {"xyz": [0, -0.3, 0]}],
    "fr3": [
        {"xyz": [0, 0.05, 0.33], "rpy": [-51.2, -10, -26.6]},
        {"xyz": [0, -0.05, 0.33], "rpy": [51.2, -10, 26.6]},
    ],
}


@pytest.mark.parametrize(
    ("robot", "yaw"),
    [
        ("panda", 200.0),  # the giver has room to retreat only if the object is turned
        ("fr3", 0.0),  # the giver reaches the pose, but the taker reaches few of its grasps
    ],
)
def test_object_is_presented_at_the_requested_pose(robot: str, yaw: float) -> None:
    """It failed with OUT_OF_REACH if a single grasp or side of the object was out of reach."""
    up = {"xyz": [0.5, -0.3, 0.048], "rpy": [0, 0, yaw]}
    box = {
        "shape": "box",
        "size": [0.032, 0.032, 0.096],
        "mass": 0.005,
        "friction": 1.5,
        "pose": up,
    }
    at = {"xyz": [0.4, 0, 0.375], "rpy": [90, 0, 0]}
    grasp = {"grasp": {"object": "box", "approach": [0, 0, -1]}}
    trees = [
        {"take_over": {"object": "box", "from": "arm2"}},
        {"sequence": [grasp, {"hand_over": {"object": "box", "to": "arm1", "at": at}}]},
    ]
    arms = {
        f"arm{i + 1}": {"robot": robot, "gripper": "panda_hand", "base": base, "tree": tree}
        for i, (base, tree) in enumerate(zip(BASES[robot], trees, strict=True))
    }
    world = {"scene": "empty", "time_limit": 60}
    file = {"bt_dualarm": 1, "name": "as_asked", "world": world, "objects": {"box": box}}
    with bt.open(file | {"arms": arms}) as run:
        pose = run.world.object_pose("box")
        held = set[str]()
        while held != {"arm1", "arm2"} and run.trees["arm1"].status != "FAILURE":
            run.step(0.1)
            held = set(run.world.attachments.holders("box"))
            pose = run.world.object_pose("box")
        result = run.finish()
    assert result.outcome == "SUCCESS"
    assert pose.position == pytest.approx(at["xyz"], abs=0.01)
    assert pose.turn(np.array((0.0, 0.0, 1.0))) == pytest.approx([0.0, -1.0, 0.0], abs=0.05)


def test_place_does_not_depend_on_the_frame_of_the_object(stage: Stage) -> None:
    """The arms bring the center of a compound to where both reach it, not its frame."""
    places = []
    for at in ((0.0, 0.0, 0.0), (0.3, -0.2, 0.25)):
        file = file_with({"sequence": [GRASP, GIVE]}, TAKES)
        bar = file["objects"]["cube"]
        frame = (np.array(bar["pose"]["xyz"]) - at).tolist()
        part = {"shape": bar.pop("shape"), "size": bar.pop("size"), "pose": {"xyz": at}}
        bar |= {"shape": "compound", "parts": {"bar": part}, "pose": {"xyz": frame}}
        play = watched(stage, file)
        assert play.leaf("take_over", "arm2").status == "SUCCESS"
        places.append(play.world.object_middle("cube"))
    assert places[0] == pytest.approx(places[1], abs=0.002)


PRESSED_AGAIN = """
bt_dualarm: 1
world: {scene: empty, reality: rough, seed: 120, time_limit: 60}
objects:
  it:
    shape: box
    size: [0.169, 0.034, 0.031]
    mass: 0.31
    pose: {xyz: [0.482, 0.147, 0.016], rpy: [0, 0, -168]}
arms:
  a:
    robot: z1
    gripper: panda_hand
    base: {xyz: [0, 0, 0], rpy: [0, 0, -22]}
    tree: {sequence: [{grasp: {object: it}}, {hand_over: {object: it, to: b, speed: 0.6}}]}
  b:
    robot: ur5
    gripper: robotiq_2f85
    base: {xyz: [1.148, 0, 0], rpy: [0, 0, 160]}
    tree:
      take_over:
        object: it
        from: a
        speed: 0.7
        then_at: {xyz: [0.699, -0.339, 0.0155], rpy: [0, 0, 22]}
"""


def test_taker_raises_what_it_lets_weigh_on_the_giver_again() -> None:
    """After the taker had felt the weight, both arms went on to press each other: NOT_TAKEN."""
    result = bt.run(PRESSED_AGAIN)
    assert result.outcome == "SUCCESS", str(result)


PLACED_AFTERWARDS = """
bt_dualarm: 1
world: {scene: empty, reality: rough, seed: 1033, time_limit: 60}
objects:
  from: {shape: box, size: [0.12, 0.12, 0.23], fixed: true, pose: {xyz: [0.347, -0.243, 0.115]}}
  onto: {shape: box, size: [0.2, 0.2, 0.23], fixed: true, pose: {xyz: [0.908, -0.194, 0.115]}}
  it:
    shape: box
    size: [0.192, 0.036, 0.029]
    mass: 0.366
    pose: {xyz: [0.347, -0.243, 0.245], rpy: [0, 0, 15]}
arms:
  a:
    robot: z1
    gripper: robotiq_2f85
    base: {xyz: [0, 0, 0.23], rpy: [0, 0, -24]}
    tree: {sequence: [{grasp: {object: it}}, {hand_over: {object: it, to: b}}, go_home]}
  b:
    robot: ur10
    gripper: robotiq_2f85
    base: {xyz: [1.633, 0, 0.23], rpy: [0, 0, 167]}
    tree:
      sequence:
        - take_over: {object: it, from: a}
        - place: {at: {xyz: [0.908, -0.194, 0.2445], rpy: [0, 0, -165]}}
"""


def test_taker_without_a_goal_leaves_free_the_side_on_which_the_object_stood() -> None:
    """Its hand faced that of the giver, below the object, and could not place it."""
    result = bt.run(PLACED_AFTERWARDS)
    assert result.outcome == "SUCCESS", str(result)


def test_open_fingers_retreat_along_the_object_not_across_it() -> None:
    """Aside, toward a finger, one pushed a bar by 12° out of the hand that had just taken it."""
    here = Pose.from_rpy((0.4, 0.1, 0.3), (180.0, 0.0, 30.0))
    arm: Any = SimpleNamespace(
        name="arm1",
        commanded_tool_pose=here,
        tool_pose_of=lambda _: here.shifted(np.array((-0.05, 0.06, 0.02))),
        world=SimpleNamespace(arms=("arm1", "arm2"), grippers=("arm1", "arm2")),
        gripper=SimpleNamespace(description=SimpleNamespace(fingers=True)),
    )
    across = here.rotation_matrix[:, 1]
    directions = retreat_directions(arm, "arm2")
    np.testing.assert_allclose([one @ across for one in directions], 0.0, atol=1e-9)
    arm.gripper.description.fingers = False
    assert max(abs(one @ across) for one in retreat_directions(arm, "arm2")) > 0.3


HALTED_TAKER = """
bt_dualarm: 1
world: {scene: empty, reality: lab, seed: 1012, time_limit: 60}
objects:
  from: {shape: box, size: [0.12, 0.12, 0.27], fixed: true, pose: {xyz: [0.648, 0.288, 0.135]}}
  onto: {shape: box, size: [0.2, 0.2, 0.27], fixed: true, pose: {xyz: [0.77, 0.115, 0.135]}}
  it:
    shape: box
    size: [0.043, 0.042, 0.108]
    mass: 0.164
    pose: {xyz: [0.648, 0.288, 0.3245], rpy: [0, 0, 84]}
subtrees:
  taking:
    tree:
      take_over:
        object: it
        from: a
        then_at: {xyz: [0.77, 0.115, 0.324], rpy: [0, 0, 142]}
arms:
  a:
    robot: ur5e
    gripper: robotiq_2f85
    base: {xyz: [0, 0, 0.27], rpy: [0, 0, 11]}
    tree: {sequence: [{grasp: {object: it}}, {hand_over: {object: it, to: b, speed: 0.6}}]}
  b:
    robot: ur3e
    gripper: robotiq_2f85
    base: {xyz: [1.148, 0, 0.27], rpy: [0, 0, 186]}
    tree:
      sequence:
        - force_success: {child: {timeout: {seconds: 12, child: {subtree: {use: taking}}}}}
        - subtree: {use: taking}
        - wait: 1
"""


def test_taker_that_was_halted_stays_until_the_hand_of_the_giver_has_left() -> None:
    """Hands that are 11 mm apart may only be so during a handover: the giver stayed for ever."""
    result = bt.run(HALTED_TAKER)
    assert result.outcome == "SUCCESS", str(result)
    assert [leaf.code for leaf in result.arms["b"].runs] == ["HALTED", "", ""]


@pytest.mark.slow
def test_giver_has_room_to_retreat_beside_the_arm_that_has_taken() -> None:
    """All retreats of the last giver led to the taker's forearm: the search had left that out."""

    def arm(robot: str, hand: str, x: float, y: float, *leaves: Any) -> dict[str, Any]:
        base = {"xyz": [x, y, 0], "rpy": [0, 0, 90]}
        return {"robot": robot, "gripper": hand, "base": base, "tree": {"sequence": [*leaves]}}

    def take(giver: str) -> dict[str, Any]:
        return {"take_over": {"object": "can1", "from": giver}}

    def give(taker: str) -> dict[str, Any]:
        return {"hand_over": {"object": "can1", "to": taker}}

    fingers = "robotiq_2f85"
    end = {"xyz": [3.096, 0, 0.192], "rpy": [0, 0, 0]}
    last = {"take_over": {"object": "can1", "from": "arm3", "then_at": end}}
    can = {"shape": "cylinder", "size": [0.019, 0.189], "mass": 0.246, "color": "red"}
    stand = {"shape": "box", "fixed": True, "size": [0.14, 0.26, 0.097]}
    result = bt.run(
        {
            "bt_dualarm": 1,
            "name": "generated",
            "world": {"scene": "empty", "reality": "lab", "time_limit": 90},
            "objects": {
                "can1": can | {"pose": {"xyz": [0, 0, 0.192]}},
                "stand0": stand | {"pose": {"xyz": [0, 0, 0.0485]}},
                "stand4": stand | {"pose": {"xyz": [3.096, 0, 0.0485]}},
            },
            "arms": {
                "arm1": arm(
                    "ur5",
                    fingers,
                    0.306,
                    -0.357,
                    {"grasp": {"object": "can1"}},
                    give("arm2"),
                    "go_home",
                ),
                "arm2": arm("ur10e", fingers, 1.08, -0.546, take("arm1"), give("arm3"), "go_home"),
                "arm3": arm(
                    "ur10", "panda_hand", 2.016, -0.546, take("arm2"), give("arm4"), "go_home"
                ),
                "arm4": arm("ur5e", fingers, 2.79, -0.357, last, {"place": {"at": end}}, "go_home"),
            },
        }
    )
    assert result.outcome == "SUCCESS", str(result)


@pytest.mark.parametrize(("free", "can"), [("none", False), ("aside", True), ("back", True)])
def test_retreat_past_the_taker_may_lead_aside(free: str, can: bool) -> None:
    """The taker is left out nowhere, and a retreat that is not straight back will do."""
    kinematics = Kinematics(load_robot("ur5"), Pose.from_rpy((0.0, 0.0, 0.0)))
    q = np.radians((0.0, -90.0, 90.0, -90.0, -90.0, 0.0))
    here = kinematics.forward(q)

    def contact(row: Vector) -> str | None:
        moved = kinematics.forward(row).position - here.position
        straight = float(moved @ -here.rotation_matrix[:, 2]) > 0.95 * float(np.linalg.norm(moved))
        return None if free == ("back" if straight else "aside") else "the forearm of the taker"

    search: Any = SimpleNamespace(
        _kinematics={"giver": kinematics}, _giver="giver", _world=SimpleNamespace(grippers={})
    )
    checker: Any = SimpleNamespace(contact=contact, first_contact=lambda rows: contact(rows[-1]))
    taker = here.shifted(np.array((0.1, 0.0, 0.0)))
    assert HandoverSearch._can_leave(search, q, taker, checker) is can
