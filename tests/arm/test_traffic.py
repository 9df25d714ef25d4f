"""Right of way among arms that block each other, also in cells that do not declare it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bt_dualarm as bt
from benchmarks.handover import generate as handover
from benchmarks.traffic import generate as traffic_cell
from bt_dualarm.arm.traffic import Traffic
from bt_dualarm.diagnosis.story import stories
from bt_dualarm.replay.record import Record
from tests.families import some


class Clock:
    """A clock that the test advances."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def traffic(clock: Clock) -> Traffic:
    return Traffic(clock)


def test_arm_that_has_waited_longer_has_the_right_of_way(traffic: Traffic, clock: Clock) -> None:
    traffic.block("b", "leaf", {"a"})
    clock.now = 1.0
    traffic.block("a", "leaf", {"b"})
    clock.now = 2.0
    assert traffic.must_yield("a")
    assert not traffic.must_yield("b")


def test_names_decide_between_arms_that_begin_to_wait_together(
    traffic: Traffic, clock: Clock
) -> None:
    for arm, other in (("b", "a"), ("a", "b")):
        traffic.block(arm, "leaf", {other})
    clock.now = 1.0
    assert [traffic.must_yield(arm) for arm in "ab"] == [False, True]


def test_arm_that_cannot_move_aside_goes_first(traffic: Traffic, clock: Clock) -> None:
    traffic.block("a", "leaf", {"b"})
    clock.now = 1.0
    traffic.block("b", "leaf", {"a"}, may_yield=False)
    clock.now = 2.0
    assert traffic.must_yield("a")
    assert not traffic.must_yield("b")


def test_changes_take_effect_in_the_next_step(traffic: Traffic, clock: Clock) -> None:
    traffic.block("b", "leaf", {"c"})
    clock.now = 1.0
    traffic.block("a", "leaf", {"b"}, may_yield=False)
    assert not traffic.must_yield("b"), "a's tree may have been ticked before b's, or after"
    clock.now = 1.1
    assert traffic.must_yield("b")
    traffic.arrive("a", "leaf")
    assert traffic.must_yield("b")
    clock.now = 1.2
    assert not traffic.must_yield("b")


def test_an_arm_keeps_its_rank_until_it_arrives(traffic: Traffic, clock: Clock) -> None:
    """No arm starves: the arm that has moved aside most often has waited longest."""
    traffic.block("late", "leaf", {"early"})
    clock.now = 1.0
    traffic.advance("late")
    clock.now = 2.0
    traffic.block("early", "leaf", {"late"})
    traffic.block("late", "leaf", {"early"})
    clock.now = 3.0
    assert traffic.must_yield("early")
    assert not traffic.must_yield("late")
    traffic.arrive("late", "leaf")
    clock.now = 4.0
    traffic.block("late", "leaf", {"early"})
    clock.now = 5.0
    assert traffic.must_yield("late")
    assert not traffic.must_yield("early")


def test_leaf_that_ends_does_not_end_the_wait_of_another_one(traffic: Traffic) -> None:
    """They may run in a `parallel`."""
    traffic.block("a", "parallel/reach_to_pose", {"b"})
    traffic.arrive("a", "parallel/wait")
    assert [one.arm for one in traffic.blocked] == ["a"]
    traffic.arrive("a", "parallel/reach_to_pose")
    assert not traffic.blocked


def test_an_arm_that_does_not_wait_need_not_move(traffic: Traffic, clock: Clock) -> None:
    traffic.block("a", "leaf", {"b"})
    clock.now = 1.0
    assert not traffic.must_yield("b")


def _swap(order: tuple[str, ...], seed: int) -> dict[str, Any]:
    """Three arms around one point, each of which reaches across it twice."""
    bases = {
        "north": ("ur5", [0.72, 0.0, 0.0], 180.0),
        "west": ("panda", [-0.3, 0.45, 0.0], -60.0),
        "east": ("xarm7", [-0.28, -0.45, 0.0], 60.0),
    }
    places = {
        "north": [[-0.02, 0.1, 0.4], [0.05, -0.1, 0.45]],
        "west": [[-0.02, 0.06, 0.4], [-0.1, 0.12, 0.45]],
        "east": [[0.05, 0.1, 0.45], [-0.1, -0.1, 0.4]],
    }
    arms: dict[str, Any] = {}
    for name in order:
        robot, xyz, yaw = bases[name]
        reaches = [
            {"reach_to_pose": {"to": {"xyz": place, "rpy": [180, 0, 0]}, "speed": 0.8}}
            for place in places[name]
        ]
        base = {"xyz": xyz, "rpy": [0, 0, yaw]}
        arms[name] = {
            "robot": robot,
            "base": base,
            "tree": {"sequence": [*reaches, {"go_home": {"speed": 0.8}}]},
        }
    world = {"scene": "empty", "reality": "lab", "seed": seed, "time_limit": 120}
    return {"bt_dualarm": 1, "name": "swap", "world": world, "arms": arms}


@pytest.mark.parametrize("seed", some([0, 1], 2))
def test_three_arms_that_cross_get_through_in_any_order_of_the_file(seed: int) -> None:
    names = ("north", "west", "east")
    results = [bt.run(_swap(order, seed)) for order in (names, names[::-1])]
    assert [result.outcome for result in results] == ["SUCCESS", "SUCCESS"]
    one, other = (
        {name: [leaf.code for leaf in arm.runs] for name, arm in result.arms.items()}
        for result in results
    )
    assert one == other
    leaves = [leaf for arm in results[0].arms.values() for leaf in arm.runs]
    busy = [leaf.ended_s - leaf.started_s for leaf in leaves if leaf.ended_s is not None]
    assert max(busy) > 4.0, "no arm had to wait: these arms do not cross"


def _covered(
    after: list[dict[str, Any]], then: list[dict[str, Any]] | None = None
) -> dict[str, Any]:
    """Arm `late` reaches for the point at which `there` stays and runs the nodes of `after`."""
    reach = {"reach_to_pose": {"to": {"xyz": [0.0, 0.0, 0.4], "rpy": [180, 0, 0]}, "speed": 0.8}}
    ends = [{"meet": "both"}] if after and after[-1] == {"meet": "both"} else []
    arms = {
        "late": {
            "robot": "ur5",
            "base": {"xyz": [0.5, 0.0, 0.0]},
            "tree": {"sequence": [{"wait": 4}, reach, *(then or []), *ends]},
        },
        "there": {
            "robot": "panda",
            "base": {"xyz": [-0.45, 0.0, 0.0]},
            "tree": {"sequence": [reach, *after]},
        },
    }
    cell = {
        "rendezvous": {"both": ["late", "there"]} if ends else {},
        "signals": {"done": {"type": "boolean", "written_by": ["late"]}},
    }
    world = {"scene": "empty", "time_limit": 40}
    return {"bt_dualarm": 1, "name": "covered", "world": world, "cell": cell, "arms": arms}


def test_arm_that_waits_for_an_arm_waiting_for_it_is_a_deadlock(tmp_path: Path) -> None:
    result = bt.run(_covered([{"meet": "both"}]), record=tmp_path / "record")
    failed = [run for arm in result.arms.values() for run in arm.runs if run.code]
    assert sorted(run.code for run in failed) == ["DEADLOCK", "PARTNER_GONE"]
    [deadlock] = [run for run in failed if run.code == "DEADLOCK"]
    assert "waits for there to leave its path" in deadlock.reason
    assert "waits at 'both' for late" in deadlock.reason
    assert "Let there wait elsewhere" in deadlock.reason
    assert result.sim_time_s < 25.0
    [remedy] = [
        story.causes[0].remedy
        for story in stories(Record.read(tmp_path / "record"))
        if story.code == "DEADLOCK"
    ]
    assert "elsewhere" in remedy, "not in which order they claim or meet"


@pytest.mark.parametrize("pause_s", [0.01, 3.0])
def test_arm_without_a_plan_even_if_it_were_alone_blames_no_other_arm(pause_s: float) -> None:
    """One of the arms, the last to wait, failed with `DEADLOCK`, although none was in the way."""
    tree: dict[str, Any] = {
        "bt_dualarm": 1,
        "world": {"scene": "empty", "time_limit": 40},
        "cell": {"signals": {"done": {"type": "boolean", "written_by": ["a"]}}},
        "arms": {
            "a": {
                "robot": "ur5",
                "tree": {"sequence": [{"reach_to_pose": {"posture": "up"}}, {"signal": "done"}]},
            },
            "b": {
                "robot": "ur5",
                "base": {"xyz": [0, 1.1, 0]},
                "tree": {"sequence": [{"wait": pause_s}, {"await": "done"}]},
            },
        },
    }
    result = bt.run(tree, faults={"planless": {"kind": "no_plan", "arm": "a"}})
    leaf = result.arms["a"].leaves["sequence/reach_to_pose"]
    assert leaf.code == "NO_PLAN"
    assert "planless" in leaf.reason
    assert result.arms["b"].leaves["sequence/await"].code == "PARTNER_GONE"
    assert result.sim_time_s < 20.0


def test_arm_without_a_plan_waits_only_for_arms_that_it_can_come_near() -> None:
    """The workspace of `far` overlaps with that of `a`, but the arm is not there."""
    rests: dict[str, Any] = {"robot": "ur5", "tree": {"sequence": [{"wait": 10}]}}
    tree: dict[str, Any] = {
        "bt_dualarm": 1,
        "world": {"scene": "empty", "time_limit": 40},
        "faults": {"planless": {"kind": "no_plan", "arm": "a", "until": 3.0}},
        "arms": {
            "a": {"robot": "ur5", "tree": {"reach_to_pose": {"posture": "up"}}},
            "near": rests | {"base": {"xyz": [0, 0.9, 0]}},
            "far": rests | {"base": {"xyz": [0, -1.7, 0]}},
        },
    }
    named = set[str]()
    with bt.open(tree) as opened:
        while opened.time < 2.5:
            opened.step(0.05)
            named.add(opened.trees["a"].snapshot().waiting.partition(" since")[0])
    assert named == {"", "waits for near to leave its path"}


@pytest.mark.parametrize("waits", ["meet", "await"])
def test_waiting_arm_moves_aside_and_comes_back(waits: str) -> None:
    """Such a run used to end with DEADLOCK although only the waiting arm blocked the path."""
    after = [{"meet": "both"}] if waits == "meet" else [{"await": "done"}]
    then: list[Any] = [
        {"go_home": {"speed": 0.8}},
        *([{"signal": "done"}] if waits == "await" else []),
    ]
    with bt.open(_covered(after, then)) as run:
        tools = list[Any]()
        while not tools or run.trees["there"].status == "RUNNING":
            run.step(0.1)
            tools.append(run.arms["there"].tool_pose.position)
        result = run.finish()
    assert result.outcome == "SUCCESS"
    reached, waited = result.arms["there"].runs
    home = result.arms["late"].runs[2]
    assert waited.ended_s is not None
    assert home.ended_s is not None
    assert reached.ended_s is not None
    assert waited.ended_s > home.ended_s > reached.ended_s
    moved = np.linalg.norm(np.array(tools) - [0.0, 0.0, 0.4], axis=1)
    assert moved[len(moved) // 2 :].max() > 0.08
    assert moved[-1] < 0.002


def test_rendezvous_does_not_take_place_while_an_arm_moves_aside() -> None:
    """The arm that it makes room for is back at the rendezvous before it has moved aside."""
    file = _covered([{"meet": "both"}], [{"go_home": {"speed": 0.8}}])
    file["world"]["time_limit"] = 60
    file["arms"]["there"]["limits"] = {"velocity": 0.06}
    with bt.open(file) as run:
        while run.time < 1.0 or run.trees["there"].status == "RUNNING":
            run.step(0.1)
        back = run.arms["there"].tool_pose.position
        result = run.finish()
    assert result.outcome == "SUCCESS"
    met = [arm.runs[-1].ended_s for arm in result.arms.values()]
    assert met[0] == met[1]
    assert np.linalg.norm(back - [0.0, 0.0, 0.4]) < 0.002


def test_arm_that_works_while_it_waits_does_not_move_aside() -> None:
    """Only an arm that does nothing but wait moves aside; a deadlock is reported after 18 s."""
    both = {"parallel": [{"meet": "both"}, {"hold_still": {"duration": 30.0}}]}
    result = bt.run(_covered([both, {"meet": "both"}]), duration=21.0)
    assert not [run for run in result.arms["there"].runs if run.code == "DEADLOCK"]


def test_arm_that_holds_still_for_the_one_that_it_blocks_is_a_deadlock() -> None:
    """It does not end by itself: the blocked arm waited for a minute, and then failed."""
    both = {"policy": "any", "children": [{"hold_still": {"partner": "late"}}, {"meet": "both"}]}
    file = _covered([{"parallel": both}, {"meet": "both"}])
    file["world"]["time_limit"] = 90
    result = bt.run(file)
    [deadlock] = [run for arm in result.arms.values() for run in arm.runs if run.code == "DEADLOCK"]
    assert deadlock.path == "sequence/reach_to_pose"
    assert "there holds still for late since" in deadlock.reason
    assert "Let there hold still elsewhere, or in another posture; a skill" in deadlock.reason
    assert result.sim_time_s < 25.0


def test_arm_that_holds_still_for_a_while_may_be_waited_for() -> None:
    """With a duration it ends by itself, and its arm may leave then."""
    held = {"hold_still": {"partner": "late", "duration": 8.0}}
    result = bt.run(_covered([held, {"go_home": {"speed": 0.8}}, {"meet": "both"}]))
    assert result.outcome == "SUCCESS"


@pytest.mark.parametrize("timeout", [None, 30])
def test_arm_does_not_wait_for_one_whose_tree_has_ended(timeout: float | None) -> None:
    """A node around the leaf that may end its wait later does not change that."""
    file = _covered([])
    late = file["arms"]["late"]
    if timeout is not None:
        late["tree"] = {"timeout": {"seconds": timeout, "child": late["tree"]}}
    result = bt.run(file)
    [failed] = [run for run in result.arms["late"].runs if run.code]
    assert failed.code == "IN_COLLISION"
    assert "there/" in failed.reason
    assert result.sim_time_s < 20.0


def test_arm_waits_for_one_that_is_going_to_leave() -> None:
    result = bt.run(_covered([{"wait": 6}, {"go_home": {"speed": 0.8}}, {"meet": "both"}]))
    assert result.outcome == "SUCCESS"


def test_arms_that_grasp_from_one_tray_yield_to_each_other() -> None:
    # Two of the three block each other on the straight parts of their approaches.
    result = bt.run(traffic_cell(7017, "lab").file)
    assert result.outcome == "SUCCESS"


def test_giver_retreats_elsewhere_if_the_taker_blocks_its_path() -> None:
    result = bt.run(handover(9407, "lab").file)
    assert result.outcome == "SUCCESS"


@pytest.mark.parametrize("x", some([0.73, 0.745], 2))
def test_arm_stopped_by_the_guard_plans_past_an_arm_that_waits_for_it(x: float) -> None:
    """The other arm has stopped beside the path, nearer than the guard allows, and stays."""
    down = {"rpy": [180, 0, 0]}
    far = {"to": {"xyz": [0.4, 0.5, 0.3], **down}, "speed": 0.1}
    passes = [
        {"reach_to_pose": {"to": {"xyz": [0.4, -0.5, 0.3], **down}}},
        {"signal": "ready"},
        {"reach_to_pose": far},
        {"signal": "done"},
    ]
    comes = [
        {"await": "ready"},
        {"wait": 0.5},
        {"reach_to_pose": {"to": {"xyz": [x, 0, 0.3], **down}}},
        {"await": "done"},
    ]
    signal = {"type": "boolean", "written_by": ["arm1"]}
    two = {"base": {"xyz": [1.25, 0, 0], "rpy": [0, 0, 180]}, "tree": {"sequence": comes}}
    file = {
        "bt_dualarm": 1,
        "name": "beside",
        "cell": {"signals": {"ready": signal, "done": signal}},
        "world": {"scene": "empty", "time_limit": 60},
        "arms": {
            "arm1": {"robot": "ur5", "tree": {"sequence": passes}},
            "arm2": {"robot": "ur5", **two},
        },
    }
    result = bt.run(file)
    assert [
        (arm, one.code) for arm in result.arms for one in result.arms[arm].runs if one.code
    ] == []


@pytest.mark.parametrize(
    ("leaf", "code"),
    [
        ({"go_home": {}}, ""),
        ({"move_linear": {"offset": {"xyz": [0, 0, 0.02]}}}, "DEADLOCK"),
    ],
)
def test_arm_that_made_room_returns_only_if_the_next_leaf_begins_there(
    leaf: dict[str, Any], code: str
) -> None:
    """`await` was a DEADLOCK, after up to a minute, whatever was to follow."""

    def cube(x: float) -> dict[str, Any]:
        pose = {"xyz": [x, -0.45, 0.425]}
        return {"shape": "box", "size": [0.05, 0.05, 0.05], "mass": 0.2, "pose": pose}

    def arm(x: float, y: float, yaw: float, *leaves: dict[str, Any]) -> dict[str, Any]:
        base = {"xyz": [x, y, 0.4], "rpy": [0, 0, yaw]}
        tree = {"sequence": list(leaves)}
        return {"robot": "ur5", "gripper": "robotiq_2f85", "base": base, "tree": tree}

    file = {
        "bt_dualarm": 1,
        "name": "beside",
        "world": {"scene": "table", "time_limit": 150},
        "cell": {"signals": {"held": {"type": "boolean", "written_by": ["stays"]}}},
        "objects": {"near": cube(0.25), "far": cube(0.4)},
        "arms": {
            "returns": arm(0, 0, 0, {"grasp": {"object": "near"}}, {"await": "held"}, leaf),
            "stays": arm(0.95, -0.45, 180, {"grasp": {"object": "far"}}, {"signal": "held"}),
        },
    }
    result = bt.run(file)
    _, waits, then = result.arms["returns"].runs
    assert waits.status == "SUCCESS", waits.reason
    assert then.code == code, then.reason
    assert ("moved aside for stays" in then.reason) == bool(code)
    assert result.sim_time_s < 30.0


def test_arm_that_made_room_for_one_that_holds_still_for_it_goes_on() -> None:
    """The one that held still where the other had waited failed, although that was to leave."""
    waits = {"sequence": [{"signal": "done"}, {"await": "left"}]}
    holds = {"policy": "any", "children": [{"hold_still": {"partner": "there"}}, waits]}
    file = _covered(
        [{"await": "done"}, {"go_home": {}}, {"signal": "left"}, {"wait": 1.0}],
        [{"parallel": holds}],
    )
    file["cell"]["signals"]["left"] = {"type": "boolean", "written_by": ["there"]}
    result = bt.run(file)
    assert result.outcome == "SUCCESS", str(result)


CIRCLE = {"circle": {"radius": 0.15, "plane": "xy", "speed": 0.1}}
LINE = {"move_linear": {"to": {"xyz": [0.45, 0.4, 0.75], "rpy": [180, 0, 0]}, "speed": 0.1}}


def facing_arms(
    robot: str,
    far: float,
    own: list[dict[str, Any]],
    other: list[dict[str, Any]],
    gripper: str | None = None,
) -> dict[str, Any]:
    """Two arms that face each other at a distance in m, and meet before they begin."""

    def arm(x: float, yaw: float, leaves: list[dict[str, Any]]) -> dict[str, Any]:
        base = {"xyz": [x, 0, 0.4], "rpy": [0, 0, yaw]}
        hand = {} if gripper is None else {"gripper": gripper}
        return {"robot": robot, "base": base, "tree": {"sequence": leaves}, **hand}

    return {
        "bt_dualarm": 1,
        "name": "facing",
        "world": {"scene": "empty", "reality": "ideal", "time_limit": 90},
        "cell": {"rendezvous": {"go": ["arm1", "arm2"]}},
        "arms": {"arm1": arm(0, 0, own), "arm2": arm(far, 180, other)},
    }


def reach(x: float, y: float, z: float = 0.75) -> dict[str, Any]:
    """A leaf that moves the tool to a position in m, pointing down."""
    return {"reach_to_pose": {"to": {"xyz": [x, y, z], "rpy": [180, 0, 0]}}}


@pytest.mark.parametrize(
    ("robot", "far", "begin", "leaf", "blocked"),
    some(
        [
            ("ur5", 1.2, -0.4, LINE, (0.5, 0.2)),
            ("panda", 1.2, 0.0, CIRCLE, (0.5, 0.2)),
            ("panda", 1.2, -0.4, LINE, (0.5, 0.2)),
            ("ur5", 1.3, 0.0, CIRCLE, (0.6, 0.0)),
        ],
        2,
    ),
)
def test_prescribed_path_waits_for_an_arm_that_rests_in_it(
    robot: str, far: float, begin: float, leaf: dict[str, Any], blocked: tuple[float, float]
) -> None:
    """It failed with IN_COLLISION as soon as the other arm stopped, although that moved on."""
    wait = 3 if leaf is CIRCLE and robot == "ur5" else 0.1
    comes: list[dict[str, Any]]
    comes = [{"meet": "go"}, {"wait": wait}, reach(*blocked), {"wait": 2}, {"go_home": None}]
    result = bt.run(facing_arms(robot, far, [reach(0.45, begin), {"meet": "go"}, leaf], comes))
    assert result.outcome == "SUCCESS"


def test_arm_does_not_move_aside_for_one_whose_leaf_was_halted() -> None:
    """The guard has stopped that arm on a prescribed path, and a timeout ends its leaf."""
    line = {"force_success": {"child": {"timeout": {"seconds": 5, "child": LINE}}}}
    own = [reach(0.45, -0.4), {"meet": "go"}, line, {"wait": 5}, reach(0.45, -0.4)]
    other = [{"meet": "go"}, reach(0.5, 0.2), {"wait": 4}, reach(0.45, 0.1)]
    with bt.open(facing_arms("ur5", 1.2, own, other)) as run:
        run.step(8.0)
        halted = run.arms["arm1"].tool_pose
        waiting = run.arms["arm2"].tool_pose
        run.step(3.5)
        assert run.arms["arm1"].tool_pose.distance(halted) < 1e-3, "not on its way back yet"
        assert run.arms["arm2"].tool_pose.distance(waiting) < 1e-3
        result = run.finish()
    assert [run.code for run in result.arms["arm1"].runs].count("HALTED") == 1
    assert result.outcome == "SUCCESS"


@pytest.mark.parametrize("robot", some(["ur5", "xarm7", "panda"], 3))
def test_prescribed_paths_that_block_each_other_are_a_deadlock(robot: str) -> None:
    """Both arms waited for a minute; neither may leave its path."""

    def leaves(x: float, y: float, leaf: dict[str, Any]) -> list[dict[str, Any]]:
        return [reach(x, y), {"meet": "go"}, leaf]

    circle = {"circle": {"radius": 0.2, "plane": "xy", "direction": "clockwise"}}
    line = {"move_linear": {"to": {"xyz": [0.35, 0.1, 0.75], "rpy": [180, 0, 0]}}}
    file = facing_arms(robot, 1.0, leaves(0.35, 0.2, circle), leaves(0.65, -0.2, line))
    result = bt.run(file)
    failed = [run for arm in result.arms.values() for run in arm.runs if run.status == "FAILURE"]
    # Where the first of them fails, the other one waits for an arm that has ended.
    assert sorted(run.code for run in failed) == ["DEADLOCK", "TIMED_OUT"]
    [deadlock] = [run for run in failed if run.code == "DEADLOCK"]
    assert "cannot leave its prescribed path: arm" in deadlock.reason
    assert result.sim_time_s < 12.0


def test_path_keeps_the_tool_off_what_another_arm_holds() -> None:
    """A line led the fingers into a rod that the other arm carried past."""
    line = {"move_linear": {"to": {"xyz": [0.45, 0.5, 0.75], "rpy": [180, 0, 0]}, "speed": 0.5}}
    own = [reach(0.45, -0.45), {"meet": "go"}, {"wait": 0.4}, line]
    other = [
        reach(0.68, 0.55, 0.8),
        {"spawn": {"object": "rod"}},
        {"meet": "go"},
        {"reach_to_pose": {"to": {"xyz": [0.68, -0.2, 0.75], "rpy": [180, 0, 0]}, "speed": 1.0}},
    ]
    file = facing_arms("ur5", 1.1, own, other, "robotiq_2f85")
    pose = {"xyz": [0.5, 0.55, 0.78]}
    rod = {"shape": "box", "size": [0.5, 0.03, 0.03], "mass": 0.2, "pose": pose, "spawned": False}
    file["objects"] = {"rod": rod}
    file["world"]["time_limit"] = 12
    touched = set[str]()
    with bt.open(file) as opened:
        world = opened.world

        def look() -> None:
            contacts = world.data.contact
            for geoms, distance in zip(contacts.geom, contacts.dist, strict=True):
                bodies = {world.model.body(world.model.geom_bodyid[geom]).name for geom in geoms}
                if distance < 0.0 and "rod" in bodies:
                    touched.update(body for body in bodies if body.startswith("arm1/"))

        world.on_forces.append(look)
        is_held = False
        while not opened.done:
            opened.step(0.02)
            if "rod" in world.objects and not is_held:
                world.attach("arm2", "rod")
                is_held = True
    assert is_held
    assert not touched
