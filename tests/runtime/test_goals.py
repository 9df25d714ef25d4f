"""Goals and invariants: they are evaluated on the true world, and do not change the run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import bt_dualarm as bt
from bt_dualarm.cli import replay, why

TREE: dict[str, Any] = {
    "bt_dualarm": 1,
    "name": "goals",
    "world": {"scene": "empty"},
    "cell": {
        "zones": {
            "bin": {"size": [0.3, 0.3, 0.3], "pose": {"xyz": [0.5, 0.2, 0.3]}},
            "tube": {"shape": "cylinder", "size": [0.1, 0.2], "around": "tray"},
        }
    },
    "objects": {
        "cube": {
            "shape": "box",
            "size": [0.05, 0.05, 0.05],
            "mass": 0.1,
            "pose": {"xyz": [0.5, 0.2, 0.325], "rpy": [0, 0, 90]},
        },
        "tray": {
            "shape": "box",
            "size": [0.2, 0.2, 0.02],
            "mass": 1.0,
            "fixed": True,
            "pose": {"xyz": [0.5, 0.2, 0.29]},
        },
        "rod": {
            "shape": "cylinder",
            "size": [0.02, 0.2],
            "mass": 0.1,
            "fixed": True,
            "pose": {"xyz": [-0.5, 0.5, 0.5], "rpy": [0, 30, 0]},
        },
        # Its center is 0.5 m from its frame.
        "ball": {
            "shape": "compound",
            "parts": {"all": {"shape": "sphere", "size": [0.02], "pose": {"xyz": [0, 0, 0.5]}}},
            "mass": 0.1,
            "fixed": True,
            "pose": {"xyz": [0.5, 0.2, 0.3], "rpy": [0, 45, 0]},
        },
        "later": {
            "shape": "sphere",
            "size": [0.02],
            "mass": 0.1,
            "pose": {"xyz": [1, 1, 1]},
            "spawned": False,
        },
    },
    "arms": {
        "arm1": {"robot": "ur5", "tree": {"wait": 0.3}},
        "arm2": {"robot": "panda", "base": {"xyz": [0, 1.2, 0]}, "tree": {"wait": 0.2}},
    },
}

CASES: list[tuple[dict[str, object], str]] = [
    ({"object": "cube", "at": {"xyz": [0.5, 0.2, 0.325]}}, ""),
    # A cube is the same after a quarter turn.
    ({"object": "cube", "at": {"xyz": [0.5, 0.2, 0.325], "rpy": [0, 0, 180]}, "angle": 1}, ""),
    ({"object": "cube", "at": {"xyz": [0.5, 0.2, 0.325], "rpy": [0, 0, 45]}}, "turned by 45.0"),
    ({"object": "cube", "at": {"xyz": [0.5, 0.23, 0.325]}}, "30.0 mm from its place"),
    ({"object": "cube", "at": {"xyz": [0.5, 0.23, 0.325]}, "within": 0.04}, ""),
    ({"object": "cube", "in_zone": "bin"}, ""),
    ({"object": "cube", "in_zone": "tube"}, ""),
    ({"object": "rod", "in_zone": "bin"}, "outside bin"),
    ({"object": "ball", "height": [0.65, 0.66]}, ""),
    ({"object": "ball", "in_zone": "bin"}, "outside bin"),
    ({"object": "ball", "distance_to": "cube", "apart": 0.4}, ""),
    ({"object": "cube", "distance_to": "ball", "apart": 0.4}, ""),
    ({"object": "cube", "on": "tray"}, ""),
    ({"object": "tray", "on": "cube"}, "does not stand on"),
    ({"object": "rod", "on": "tray"}, "does not stand on"),
    ({"object": "cube", "on": "rod"}, "cube does not stand on rod, but on tray"),
    ({"object": "rod", "tilt": 31}, ""),
    ({"object": "rod", "tilt": 29}, "tilted by 30.0"),
    ({"object": "cube", "height": [0.3, 0.35]}, ""),
    ({"object": "cube", "height": [0.4, 0.5]}, "height of 0.325 m"),
    ({"object": "cube", "held": False}, ""),
    ({"object": "cube", "held": True}, "no arm holds"),
    ({"object": "cube", "held_by": "arm1"}, "arm1 does not hold"),
    ({"object": "cube", "speed": 0.01, "lasting": 0.1}, ""),
    ({"object": "cube", "speed": 0.01, "lasting": 5}, "not for 5 s"),
    ({"object": "later", "speed": 1}, "not in the world"),
    ({"tool": "arm1", "speed": 0.05, "force": 1}, ""),
    ({"tool": "arm1", "height": [5, 6]}, "the tool of arm1 is at a height"),
    ({"tool": "arm1", "distance_to": "arm2", "apart": 0.2}, ""),
    ({"tool": "arm1", "distance_to": "cube", "apart": 3}, "from cube, not 3000.0 mm"),
    # A length and its bound never read the same.
    ({"object": "cube", "at": {"xyz": [0.5, 0.23, 0.325]}, "within": 0.02998}, "not within 29.98"),
]


@pytest.fixture(scope="module")
def result() -> bt.RunResult:
    goals = {f"g{number}": condition for number, (condition, _) in enumerate(CASES)}
    return bt.run(TREE | {"goal": goals})


@pytest.mark.parametrize("number", range(len(CASES)), ids=lambda n: "_".join(CASES[n][0]))
def test_a_goal_is_evaluated_on_the_true_world(number: int, result: bt.RunResult) -> None:
    goal = result.goals[f"g{number}"]
    reason = CASES[number][1]
    assert goal.met == (not reason), goal.reason
    assert reason in goal.reason


def test_goals_do_not_change_the_run(result: bt.RunResult) -> None:
    plain = bt.run(TREE)
    assert plain.state_sha256 == result.state_sha256
    assert plain.goals == {}
    assert not plain.is_false_success
    assert (result.outcome, result.is_false_success) == ("SUCCESS", True)


@pytest.mark.usefixtures("without_plots")
@pytest.mark.parametrize(
    ("section", "condition", "expected"),
    [
        ("always", {"object": "cube", "height": [0.3255, 0.4]}, "always rule is violated at 0."),
        ("never", {"object": "cube", "on": "tray"}, "never rule is violated at 0."),
    ],
)
def test_a_violated_invariant_ends_the_run(
    section: str,
    condition: dict[str, object],
    expected: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    tree = TREE | {section: {"rule": condition, "other": {"tool": "arm1", "speed": 9}}}
    if section == "never":
        tree[section] = {"rule": condition}
    ended = bt.run(tree, record=tmp_path)
    assert ended.ending == bt.Ending.INVARIANT
    assert ended.outcome == "UNFINISHED"
    assert ended.sim_time_s < 0.3
    assert expected in ended.error
    assert why([str(tmp_path)]) == 0
    assert f"why: the run ended by an invariant: {expected}" in capsys.readouterr().out
    assert replay([str(tmp_path), "--check"]) == 0


@pytest.mark.usefixtures("without_plots")
def test_bt_why_names_the_goals_that_were_missed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bt.run(TREE | {"goal": {"far": {"object": "rod", "in_zone": "bin"}}}, record=tmp_path)
    assert why([str(tmp_path)]) == 0
    output = capsys.readouterr().out
    assert "every tree succeeded\ngoal far was not met: rod is" in output


def test_an_invariant_that_holds_ends_nothing() -> None:
    ended = bt.run(TREE | {"always": {"calm": {"tool": "arm2", "speed": 0.5, "force": 5}}})
    assert ended.outcome == "SUCCESS"


@pytest.mark.parametrize(
    "goal",
    [
        {"object": "cube", "held": False},
        {"object": "cube", "height": [0.3, 100.0]},
        {"object": "cube", "at": {"xyz": [0.5, 0.2, 0.325]}},
    ],
)
def test_an_object_that_a_fault_has_taken_away_meets_no_goal(goal: dict[str, Any]) -> None:
    """It is kept far above: it met what asks for no place, or was "49675 mm" from its own."""
    gone: dict[str, Any] = {"kind": "removed_object", "object": "cube"}
    for until, met in ((9.0, False), (0.2, True)):  # until after the run, or during it
        file = TREE | {"goal": {"there": goal}, "faults": {"gone": gone | {"until": until}}}
        [found] = bt.run(file).goals.values()
        assert found.met is met
        assert found.reason == ("" if met else "cube is taken away by the fault 'gone'")


def test_an_arm_that_holds_a_handle_holds_the_door() -> None:
    """`held: false` was met: what moves on a joint is held under a name of its own."""

    def part(size: list[float], at: list[float]) -> dict[str, Any]:
        return {"shape": "box", "size": size, "pose": {"xyz": at}}

    door = {
        "shape": "compound",
        "mass": 5,
        "fixed": True,
        "pose": {"xyz": [0.2, -0.6, 0.35]},
        "parts": {
            "post": {"shape": "box", "size": [0.04, 0.04, 0.6]},
            "panel": part([0.3, 0.02, 0.5], [0.17, 0, 0]),
            "handle": part([0.014, 0.014, 0.1], [0.28, 0.05, 0]),
            "stem": part([0.014, 0.05, 0.014], [0.28, 0.025, 0]),
        },
        "joints": {
            "hinge": {"type": "hinge", "parts": ["panel", "handle", "stem"], "axis": [0, 0, 1]}
            | {"anchor": [0.02, 0, 0], "range": [0, 100]}
        },
    }
    goals: dict[str, Any] = {
        "free": {"held": False},
        "held": {"held": True},
        "by": {"held_by": "a"},
    }
    arm: dict[str, Any] = {"robot": "ur5e", "gripper": "robotiq_2f85"}
    grasp: dict[str, Any] = {"grasp": {"object": "door", "part": "handle"}}
    for leaves, reasons in (
        (
            [grasp, {"holding": {"object": "door"}}],
            {"free": "a holds door.hinge", "held": "", "by": ""},
        ),
        (
            [grasp, "release"],
            {"free": "", "held": "no arm holds door", "by": "a does not hold door"},
        ),
    ):
        file = {
            "bt_dualarm": 1,
            "world": {"scene": "empty"},
            "objects": {"door": door},
            "arms": {"a": arm | {"tree": {"sequence": leaves}}},
            "goal": {name: {"object": "door"} | goal for name, goal in goals.items()},
        }
        ended = bt.run(file)
        assert ended.outcome == "SUCCESS", str(ended)
        found = ended.goals
        assert {name: goal.reason for name, goal in found.items()} == reasons


@pytest.mark.parametrize(("gap", "reason"), [(2e-5, ""), (1e-3, "cube does not stand on tray")])
def test_object_stands_where_its_contact_is_interrupted(gap: float, reason: str) -> None:
    """Contacts of what rests on something light come and go, by micrometers, from step to step."""
    cube = TREE["objects"]["cube"] | {"pose": {"xyz": [0.5, 0.2, 0.325 + gap]}}
    tree = TREE | {"objects": TREE["objects"] | {"cube": cube}}
    tree |= {"goal": {"stands": {"object": "cube", "on": "tray"}}}
    with bt.open(tree) as run:
        assert run.world.data.ncon == 0
        assert run.goals["stands"].reason == reason
