"""Diagnosis: the planted cause of a failure is named first, with its context."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

import bt_dualarm
from benchmarks.random_programs import Dice
from benchmarks.why import first_cause, is_named
from benchmarks.why_generated import FAULTS, generated, planted
from benchmarks.why_interactions import interactions
from benchmarks.why_mistake import Mistake
from benchmarks.why_mistakes import mistakes
from benchmarks.why_mistakes_unseen import unseen
from bt_dualarm import cli
from bt_dualarm.core.errors import CollisionFailure
from bt_dualarm.diagnosis.story import stories
from bt_dualarm.replay.record import Record
from bt_dualarm.runtime.options import find_tree
from tests.families import some
from tests.replay.runs import RETURNING, SHORT, recorded, write_short

QUICK = (
    "a pose too far for a panda",
    "a post where the tool is to be",
    "another color asked for in visual_tracking",
    "a screen before the camera",
    "nobody picks the cube",
    "a key that was never written",
    "a timeout of 0.2 s",
    "two leaves move one arm",
    "a pose in centimeters",
    "nobody took the cube with fingers",
    "an arm is removed while it waits",
    "home and fail after a far target",
    "fail of a subtree after a wall",
    "an offset that adds up in a loop",
)
FAR_TARGET = """
bt_dualarm: 1
world: {scene: empty, time_limit: 2.0}
objects:
  cube:
    shape: box
    size: [0.05, 0.05, 0.05]
    mass: 0.1
    color: yellow
    fixed: true
    pose: {xyz: [0.68, 0.26, 0.7]}
arms:
  arm1:
    robot: panda
    base: {xyz: [1.60, 0.11, 0.28], rpy: [0, 0, 180]}
    posture: look_out
    camera: {mount: wrist, resolution: [320, 240], fov: 50, fps: 30}
    tree: {track: {duration: 5.0, reach: 0.1, score: cube}}
"""
BACK = 'reach_to_pose: {offset: "{goal}"}'
FAILING = SHORT.replace(BACK, "reach_to_pose: {offset: {xyz: [3, 0, 0]}}")

SELECTED = [
    mistake
    for one_in, family in ((14, [*mistakes(), *unseen()]), (20, interactions()))
    for chosen in [some(family, one_in)]
    for mistake in family
    if mistake in chosen or mistake.name in QUICK
]
"""Some of the mistakes of each family; ``make matrix`` plants all of them."""

MISTAKES = [
    pytest.param(
        mistake,
        id=mistake.name.replace(" ", "_"),
        marks=[] if mistake.name in QUICK else [pytest.mark.slow],
    )
    for mistake in SELECTED
]
SCREEN = """\
  screen:
    shape: box
    size: [0.01, 0.2, 0.2]
    fixed: true
    spawned: false
    pose: {xyz: [0.76, 0.11, 0.7]}
"""
BEHIND_THE_SCREEN = """
  arm2:
    robot: ur3
    base: {{xyz: [-2, 0, 0]}}
    tree:
      sequence:
        - wait: 1.5
        - spawn: {{object: screen}}
        - wait: 0.8
        - remove: {{object: cube}}
        - spawn: {{object: cube, at: {far}}}
"""
HALF_HIDDEN = """
bt_dualarm: 1
world: {scene: empty}
objects:
  cube: {shape: box, size: [0.05, 0.05, 0.05], mass: 0.1, color: red, pose: {xyz: [0.45, 0, 0.025]}}
  bar: {shape: box, size: [0.3, 0.02, 0.02], pose: {xyz: [0.45, 0.02, 0.1]}, fixed: true}
arms:
  arm1:
    robot: panda
    camera: {mount: wrist}
    tree:
      sequence:
        - look_at: {at: {xyz: [0.45, 0, 0.025]}, distance: 0.4}
        - locate: {object: cube}
"""


@pytest.mark.parametrize("mistake", MISTAKES)
def test_the_planted_mistake_is_named_first(mistake: Mistake, tmp_path: Path) -> None:
    cause = first_cause(mistake, tmp_path)
    assert is_named(mistake, cause), cause


PLANTED = (
    ("carry", "a crate in the path", 0),
    ("drawer", "a crate before it", 4),
    ("insert", "a plugged hole", 1),
    ("carry", "a frozen joint", 0),
    ("track", "the target is let go", 0),
    ("sight", "removed by another arm", 0),
    ("sight", "the wrong place", 4),
    ("handover", "a partner that is removed", 0),
    ("pick", "too heavy", 21),
)
"""Generated mistakes that were not named first: task, fault, seed."""


@pytest.mark.parametrize(("task", "fault", "seed"), PLANTED)
def test_a_generated_mistake_is_named_first(
    task: str, fault: str, seed: int, tmp_path: Path
) -> None:
    mistake = planted(task, fault, Dice(seed))
    assert mistake is not None
    cause = first_cause(mistake, tmp_path)
    assert is_named(mistake, cause), cause


def test_generated_mistakes_are_of_all_kinds_and_repeatable() -> None:
    first, again = (list(generated(7, 40)) for _ in range(2))
    assert [(one.name, one.tree) for one in first] == [(one.name, one.tree) for one in again]
    assert all(one.original != one.tree for one in first)
    assert {one.name.split()[1] for one in generated(8, 120)} == set(FAULTS)


def test_gains_that_make_the_tool_swing_are_to_be_smaller(tmp_path: Path) -> None:
    """It called the tool, which moved faster than its target, too slow, and asked for more."""
    text = find_tree("visual_tracking").read_text()
    gains = "controller: proportional, gain_u: 0.5, gain_v: 0.5"
    [story] = stories(recorded(tmp_path, text.replace("controller: predictive", gains)))
    cause = story.causes[0]
    assert (story.code, cause.kind) == ("NOT_FOLLOWING", "TOO_SLOW")
    assert "too slow" not in cause.sentence
    assert "proportional control by these gains does not follow" in cause.sentence
    assert cause.remedy == "smaller gains, or controller: predictive"


def test_a_removed_partner_is_named_once(tmp_path: Path) -> None:
    """The sentence named the removal twice, with two times."""
    mistake = planted("handover", "a partner that is removed", Dice(0))
    assert mistake is not None
    cause = first_cause(mistake, tmp_path)
    assert cause is not None
    assert cause.sentence.count("removed") == 1
    assert cause.leaf == "sequence/remove"


class Bends(bt_dualarm.Skill):
    """Fails because a partner would collide with itself."""

    example = "bends"

    def run(self) -> bt_dualarm.Ticks:
        """Fail in the first tick."""
        reason = "arm2/forearm_link would be 5 mm deep in arm2/pedestal"
        raise CollisionFailure(reason, "arm2/forearm_link", "arm2/pedestal")
        yield


def test_partner_that_collides_with_itself_does_not_count_as_in_the_way(tmp_path: Path) -> None:
    """A leaf may plan for its partners, too."""
    other = {"robot": "ur3", "base": {"xyz": [2, 0, 0]}, "tree": {"wait": 1}}
    arms = {"arm1": {"robot": "ur5", "tree": "bends"}, "arm2": other}
    tree = {"bt_dualarm": 1, "world": {"scene": "empty"}, "arms": arms}
    bt_dualarm.run(tree, skills=[Bends], record=tmp_path / "record")
    cause = stories(Record.read(tmp_path / "record"))[0].causes[0]
    assert cause.kind == "SELF_COLLISION"
    assert cause.sentence.startswith("arm2 would collide with itself: arm2/forearm_link")


def test_there_are_at_least_90_mistakes() -> None:
    names = [mistake.name for mistake in (*mistakes(), *unseen(), *interactions())]
    assert len(names) >= 90
    assert len(set(names)) == len(names)
    assert set(QUICK) <= set(names)


@pytest.fixture(scope="module")
def failed(tmp_path_factory: pytest.TempPathFactory) -> Record:
    return recorded(tmp_path_factory.mktemp("failed"), FAILING)


def test_a_story_has_chain_ports_and_preceding_events(failed: Record) -> None:
    [story] = stories(failed)
    assert [(link["path"], link["status"]) for link in story.chain] == [
        ("sequence", "FAILURE"),
        ("sequence/reach_to_pose", "FAILURE"),
    ]
    assert story.ports["offset"]["xyz"] == [3, 0, 0]
    assert story.place == "short.yaml:16"
    assert story.causes[0].kind == "OUT_OF_REACH"
    assert "the tool moved by" in story.before[0]
    assert story.causes[0].remedy


def test_a_leaf_that_succeeded_can_be_asked_for(failed: Record) -> None:
    [story] = stories(failed, "set")
    assert (story.status, story.leaf) == ("SUCCESS", "sequence/set")


def test_a_leaf_that_succeeded_before_a_halt_was_not_halted(tmp_path: Path) -> None:
    """The halt of its parent resets it as well."""
    tree = "{timeout: {seconds: 0.3, child: {sequence: [{log: done}, {wait: 5}]}}}"
    text = f"bt_dualarm: 1\nworld: {{scene: empty}}\narms: {{arm1: {{robot: ur5, tree: {tree}}}}}"
    record = recorded(tmp_path, text)
    found = {name: stories(record, name)[0] for name in ("log", "wait")}
    assert {name: story.status for name, story in found.items()} == {
        "log": "SUCCESS",
        "wait": "HALTED",
    }
    assert found["log"].causes[0].sentence == "'timeout/sequence/log' succeeded"


def test_a_time_selects_the_nodes_running_then(failed: Record) -> None:
    [story] = stories(failed, "0.3")
    assert (story.status, story.leaf) == ("RUNNING", "sequence/aside/reach_to_pose")
    assert (story.at_s, story.began_s) == (0.3, 0.0)
    assert story.causes[0].kind == "RUNNING"
    assert "had run for 0.30 s; it succeeded at 0." in story.causes[0].sentence
    assert [link["status"] for link in story.chain] == ["RUNNING"] * 3
    [end] = stories(failed)
    assert story.before != end.before, "the second before that time, not before the end"


def test_the_command_prints_the_story(failed: Record, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.why([str(failed.folder)]) == 0
    out = capsys.readouterr().out
    assert out.startswith("short, seed 0, ")
    assert "arm1: sequence/reach_to_pose (short.yaml:16) FAILURE" in out
    assert "outside the reach of ur5" in out
    assert "to change: bring" in out
    assert cli.why([str(failed.folder), "reach_to_pose", "--json"]) == 0
    reported = json.loads(capsys.readouterr().out)
    assert reported["stories"][0]["causes"][0]["kind"] == "OUT_OF_REACH"


def test_a_run_that_succeeded_exits_with_code_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded(tmp_path)
    assert cli.why([str(tmp_path / "out")]) == 1
    assert "every tree succeeded" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("about", "message"),
    [
        ("circel", "no node is called 'circel'"),
        ("99", "99 s is outside the record, which goes from 0 to"),
        ("-3", "outside the record"),
        ("nan", "outside the record"),
    ],
)
def test_an_unknown_node_or_time_exits_with_code_2(
    failed: Record, about: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.why([str(failed.folder), "--", about]) == 2
    assert message in capsys.readouterr().err


def test_a_missing_record_exits_with_code_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.why([str(tmp_path / "none")]) == 2
    assert "there is no folder" in capsys.readouterr().err
    assert cli.why([str(tmp_path)]) == 2
    assert "contains no record" in capsys.readouterr().err


def test_a_truncated_record_is_explained_as_far_as_it_goes(
    failed: Record, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("run.history", "events.jsonl"):
        content = (failed.folder / name).read_bytes()
        (tmp_path / name).write_bytes(content[: len(content) - 30])
    assert cli.why([str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "the run was interrupted" in out
    assert "part of a block" in out


@pytest.mark.parametrize(("leaf", "faster"), [("wait: 5", False), (BACK, True)])
def test_a_faster_motion_is_suggested_only_for_a_motion(
    leaf: str, faster: bool, tmp_path: Path
) -> None:
    late = SHORT.replace(BACK, f"timeout: {{seconds: 0.2, child: {{{leaf}}}}}")
    [story] = stories(recorded(tmp_path, late))
    assert story.causes[0].kind == "TOO_LITTLE_TIME"
    assert ("a faster motion" in story.causes[0].remedy) == faster


SLOW = "move_joints: {by: [30, 0, 0, 0, 0, 0], speed: 0.1}"


def only(tmp_path: Path, tree: str) -> Record:
    """Record of a run of one arm with a tree."""
    arms = f"arms: {{arm1: {{robot: ur5, tree: {{{tree}}}}}}}"
    return recorded(tmp_path, f"bt_dualarm: 1\nworld: {{scene: empty}}\n{arms}\n")


def timed_out(tmp_path: Path) -> Record:
    """Record of a motion within three timeouts, of which the second one halts it."""
    limit = f"timeout: {{seconds: 400 ms, child: {{timeout: {{seconds: 3, child: {{{SLOW}}}}}}}}}"
    return only(tmp_path, f"timeout: {{seconds: 1 min, child: {{{limit}}}}}")


def test_the_timeout_that_ended_a_leaf_is_named_with_its_time_in_seconds(tmp_path: Path) -> None:
    """`300 ms s` ended it; and of several timeouts, only the innermost one was considered."""
    [story] = stories(timed_out(tmp_path))
    (cause,) = story.causes
    assert cause.kind == "TOO_LITTLE_TIME"
    assert cause.sentence.endswith(
        "had run for 0.40 s when the timeout 'timeout/timeout' ended it: not finished within 0.4 s"
    )


def test_a_wait_that_a_timeout_has_halted_is_explained_by_it_as_well(tmp_path: Path) -> None:
    """A claim has no code when it is halted. The code of the other arm was followed by a colon."""
    ball = "ball: {shape: sphere, size: [0.05], mass: 1, pose: {xyz: [1, 1, 0.05]}}"
    wait = "timeout: {seconds: 0.2, child: {claim: {object: ball, child: {wait: 1}}}}"
    meets = "sequence: [{wait: 0.5}, {meet: there}]"
    arms = (
        f"a: {{robot: ur5, tree: {{sequence: [{{delay: {{seconds: 0.1, child: {{{wait}}}}}}}, "
        "{meet: there}]}}, "
        f"b: {{robot: ur5, base: {{xyz: [3, 0, 0]}}, tree: {{claim: {{object: ball, child: "
        f"{{{meets}}}}}}}}}"
    )
    cell = "cell: {rendezvous: {there: [a, b]}}"
    text = f"bt_dualarm: 1\nobjects: {{{ball}}}\n{cell}\narms: {{{arms}}}\n"
    found = {one.arm: one.causes for one in stories(recorded(tmp_path, text))}
    assert [one.kind for one in found["a"]] == ["OTHER_ARM", "TOO_LITTLE_TIME"]
    assert not any(one.sentence.endswith((": ", "with ")) for one in found["b"])


@pytest.mark.parametrize("asked", ["0.4", "0.42"])
def test_a_timeout_is_a_failure_at_its_time(asked: str, tmp_path: Path) -> None:
    """Nothing had failed, as no leaf did: the leaf was halted."""
    [story] = stories(timed_out(tmp_path), asked)
    assert story.status == "HALTED"
    assert story.ended_s == pytest.approx(0.4)
    assert story.causes[0].kind == "TOO_LITTLE_TIME"


def test_a_leaf_that_was_halted_within_a_timeout_has_not_run_out_of_time(tmp_path: Path) -> None:
    """The timeout around it fails later, as another leaf in it does."""
    race = f"parallel: {{policy: any, children: [{{{SLOW}}}, {{wait: 0.1}}]}}"
    inner = f"sequence: [{{{race}}}, {{fail: {{}}}}]"
    record = only(tmp_path, f"timeout: {{seconds: 5, child: {{{inner}}}}}")
    [halted] = stories(record, "move_joints")
    assert halted.status == "HALTED"
    assert "timeout '" not in halted.causes[0].sentence


def test_arms_whose_claim_is_waited_for_were_at_work_when_the_run_ended(tmp_path: Path) -> None:
    """Their trees were "INVALID then": the end of a run halts all nodes in one tick.

    The tree of an arm that waited as well was `RUNNING then`.
    """
    ball = "ball: {shape: sphere, size: [0.05], mass: 1, pose: {xyz: [1, 1, 0.05]}}"
    claim = f"claim: {{object: ball, child: {{{SLOW}}}}}"
    arms = [
        f"{name}: {{robot: ur5, base: {{xyz: [{3 * index}, 0, 0]}}, "
        f"tree: {{delay: {{seconds: {0.1 * (index + 1):g}, child: {{{claim}}}}}}}}}"
        for index, name in enumerate("abc")
    ]
    text = f"bt_dualarm: 1\nobjects: {{{ball}}}\narms: {{{', '.join(arms)}}}\n"
    found = {one.arm: one.causes for one in stories(recorded(tmp_path, text, duration=1))}
    at_work = {
        "a": ": a was at 'delay/claim/move_joints' then",
        "b": ": b was at 'delay/claim' then",
    }
    for arm, others in (("b", "a"), ("c", "ab")):
        waits = [one.sentence for one in found[arm] if one.kind == "OTHER_ARM"]
        assert len(waits) == len(others)
        for other in others:
            assert any(one.endswith(at_work[other]) for one in waits), waits


@pytest.mark.parametrize(
    ("tree", "leaf", "sentence"),
    [
        (
            f"guard: {{condition: {{not: {{elapsed: 0.1}}}}, child: {{{SLOW}}}}}",
            "guard/not/elapsed",
            "'guard/not/elapsed' succeeded, and 'guard/not' inverts that",
        ),
        (
            f"guard: {{condition: {{not: {{any: [{{elapsed: 0.1}}]}}}}, child: {{{SLOW}}}}}",
            "guard/not/any/elapsed",
            "'guard/not/any/elapsed' succeeded, and 'guard/not' inverts that",
        ),
        (
            "inverter: {child: {inverter: {child: {fail: {reason: so}}}}}",
            "inverter/inverter/fail",
            "the tree failed on purpose (short.yaml:3): so",
        ),
        (
            "timeout: {seconds: 0.1, child: {on_halt: {child: {wait: 1}, cleanup: {wait: 0.3}}}}",
            "timeout/on_halt/wait",
            "'timeout/on_halt/wait' had run for 0.10 s when the timeout 'timeout' ended it: not "
            "finished within 0.1 s",
        ),
        (
            "force_failure: {child: {wait: 0.1}}",
            "force_failure",
            "'force_failure' (short.yaml:3) fails whatever the result of its child",
        ),
    ],
)
def test_a_node_that_fails_unlike_its_child_is_explained_by_it(
    tree: str, leaf: str, sentence: str, tmp_path: Path
) -> None:
    """Of all but an `inverter` it was said that they were running, and nothing blocked them.

    A halted `on_halt` was explained by its cleanup, which had run for 0 s.
    """
    [story] = stories(only(tmp_path, tree))
    assert story.leaf == leaf
    assert [one.sentence for one in story.causes] == [sentence]


def test_a_key_that_is_written_later_in_the_same_tick_was_not_written_yet(tmp_path: Path) -> None:
    """`set` was said to have written the 1 that `test` had not found."""
    retried = 'selector: [{test: "{n} == 1"}, {set: {key: n, value: 1}}]'
    record = only(
        tmp_path, f"sequence: [{{set: {{key: n, value: 0}}}}, {{{retried}}}, {{fail: {{}}}}]"
    )
    [story] = stories(record, "test")
    (key,) = story.keys
    assert (key["leaf"], key["value"]) == ("sequence/set", 0)
    assert "had written n = 0" in story.causes[0].sentence


def test_the_joint_that_applies_its_whole_effort_is_the_cause(tmp_path: Path) -> None:
    """Its drive is weak by the draw of seed 2; a joint that lags behind for it was named alone."""
    text = """
bt_dualarm: 1
world: {scene: empty, seed: 2}
arms:
  arm1:
    robot: baxter_right
    gripper: panda_hand
    base: {xyz: [0, 0, 0.9]}
    reality: {drive: {gain: 0.15}}
    tree:
      move_joints: {to: {right_s0: 0, right_s1: -20, right_e0: 0, right_e1: 76}, speed: 0.2}
"""
    [story] = stories(recorded(tmp_path, text))
    assert story.reason.endswith("; right_s1 applies its whole 50 N m")
    assert story.causes[0].kind == "OVERLOADED"
    assert "right_s1" in story.causes[0].sentence


def test_advice_to_come_nearer_counts_the_orientation(tmp_path: Path) -> None:
    """The tool, pointing down, stays much farther from the target than from the workspace."""
    far = SHORT.replace(BACK, "reach_to_pose: {to: {xyz: [0.96, 0, 0.5], rpy: [180, 0, 0]}}")
    [story] = stories(recorded(tmp_path, far))
    [cause] = story.causes
    assert cause.kind == "OUT_OF_REACH"
    stays = round(1e3 * story.numbers["residual_m"])
    assert f"with this orientation, the tool stays {stays} mm away" in cause.sentence
    assert cause.remedy.endswith(f"at least {stays} mm nearer")


def test_a_target_that_never_came_within_reach_is_the_cause_and_not_the_time(
    tmp_path: Path,
) -> None:
    """`track` still waited for it when the run was over."""
    [story] = stories(recorded(tmp_path, FAR_TARGET))
    assert story.causes[0].kind == "LEFT_REACH", story.causes
    assert "out of reach for 1." in story.causes[0].sentence


def test_a_target_larger_than_the_image_is_the_cause(tmp_path: Path) -> None:
    """Its color is right and its center within the view: `track` cannot tell where that is."""
    board = FAR_TARGET.replace("0.05, 0.05, 0.05", "0.02, 0.9, 0.9")
    assert board != FAR_TARGET
    short = board.replace("reach: 0.1", "wait: 1.0")
    [story] = stories(recorded(tmp_path, short))
    assert story.causes[0].kind == "TOO_LARGE_IN_VIEW", story.causes
    assert "cube reached from border to border" in story.causes[0].sentence


def test_what_hid_a_lost_target_is_the_cause_and_not_where_it_is_later(tmp_path: Path) -> None:
    """The cube is carried out of view while it is hidden, and most of the time is there."""
    near, far = "{xyz: [0.68, 0.11, 0.7]}", "{xyz: [0.68, 1.4, 0.7]}"
    text = FAR_TARGET.replace("{xyz: [0.68, 0.26, 0.7]}", near).replace("limit: 2.0", "limit: 20")
    text = text.replace("reach: 0.1", "lost_timeout: 3.0")
    text = text.replace("arms:\n", SCREEN + "arms:\n") + BEHIND_THE_SCREEN.format(far=far)
    story = next(one for one in stories(recorded(tmp_path, text)) if one.leaf == "track")
    assert story.code == "LOST"
    assert story.causes[0].kind == "OCCLUDED", story.causes
    assert "screen is between the camera and cube" in story.causes[0].sentence


def test_a_bar_that_hides_a_part_of_an_outline_is_the_cause(tmp_path: Path) -> None:
    """Most of the cube is in view: its color is found, but not its shape."""
    [story] = stories(recorded(tmp_path, HALF_HIDDEN))
    assert story.causes[0].kind == "OCCLUDED", story.causes
    assert "bar is between the camera and a part of cube" in story.causes[0].sentence


@pytest.mark.parametrize("ending", ["stopped", "diverged", "killed"])
def test_what_ended_the_run_is_the_cause_and_not_its_duration(ending: str, tmp_path: Path) -> None:
    """A later time limit would not help."""
    with bt_dualarm.open(write_short(tmp_path), record=tmp_path / "out") as run:
        run.step(0.3)
        if ending == "diverged":
            run.world.data.qvel[0] = math.nan
        else:
            run.stop()
        run.finish()
    if ending == "killed":
        (tmp_path / "out/summary.json").unlink()
    [story] = stories(Record.read(tmp_path / "out"))
    cause = story.causes[0]
    assert (cause.kind, cause.remedy) == ("RUN_ENDED", "")
    said = {"stopped": "a stop was requested", "diverged": "the simulation diverged at 0.30"}
    assert said.get(ending, "its process was ended") in cause.sentence


def test_leaf_of_a_removed_arm_did_not_end_with_the_run(tmp_path: Path) -> None:
    """Asked for by its name as well as without it."""
    removing = RETURNING.replace("        - spawn: {arm: arm2}\n", "").replace("removable", "# ")
    record = recorded(tmp_path, removing)
    for asked in (None, "arm2:sequence/reach_to_pose"):
        [story] = stories(record, asked)
        assert story.causes[0].kind == "TAKEN_AWAY", story.causes
        assert not any("at the end of the record" in cause.sentence for cause in story.causes)


def test_a_run_that_ended_before_its_first_step_did_not_succeed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record = recorded(tmp_path, duration=1e-4)
    assert cli.why([str(record.folder)]) == 1
    assert capsys.readouterr().out.splitlines()[-1] == "nothing failed"


def test_fault_that_ended_a_loop_explains_the_comparison_after_it(tmp_path: Path) -> None:
    """The reason was that the expression is false."""
    count = {"sequence": [{"set": {"key": "n", "value": "{n} + 1"}}, {"wait": 0.2}]}
    leaves = [
        {"look_at": {"at": {"xyz": [0.5, 0, 0.025]}}},
        {"set": {"key": "n", "value": 0}},
        {"while": {"condition": {"sees": {"object": "cube"}}, "child": count}},
        {"test": "{n} > 100"},
    ]
    cube = {"shape": "box", "size": [0.05] * 3, "mass": 0.1, "color": "red"}
    tree = {
        "bt_dualarm": 1,
        "world": {"scene": "empty", "time_limit": 10},
        "objects": {"cube": cube | {"pose": {"xyz": [0.5, 0, 0.025]}}},
        "arms": {"arm1": {"robot": "panda", "camera": {}, "tree": {"sequence": leaves}}},
        "faults": {"dark": {"kind": "dark_camera", "begin": "4 s", "arm": "arm1"}},
    }
    assert bt_dualarm.run(tree, record=tmp_path / "out").outcome == "FAILURE"
    (story,) = stories(Record.read(tmp_path / "out"))
    assert story.kind == "test"
    assert [cause.kind for cause in story.causes] == ["INJECTED", "CONDITION"]
    assert (
        "the camera of arm1 is dark; 'sequence/while/sees' had failed" in story.causes[0].sentence
    )
