"""Why a gripper could not pick or place an object: no room, no ground, nothing in its hand."""

from __future__ import annotations

from pathlib import Path

import pytest

from bt_dualarm.diagnosis.evidence import Cause
from bt_dualarm.diagnosis.story import stories
from tests.replay.runs import recorded

FILE = """\
bt_dualarm: 1
name: grips
world: {{scene: table, time_limit: 20}}
objects:
  obj: {{shape: box, size: {size}, mass: 0.2, pose: {{xyz: [0.4, -0.45, {height}]}}}}
{others}
arms:
  arm1:
    robot: ur5
    gripper: robotiq_2f85
    base: {{xyz: [0, 0, 0.4]}}
    tree: {{sequence: {steps}}}
"""
LOOKS = """\
  arm2:
    robot: panda
    base: {xyz: [0.95, -0.2, 0.4], rpy: [0, 0, 180]}
    camera: {}
    tree:
      sequence:
        - wait: 5
"""
"""The beginning of an arm that looks from the other side."""
CUBE = [0.05, 0.05, 0.05]
AROUND = "\n".join(
    f"  {name}: {{shape: box, size: {CUBE}, mass: 1, pose: {{xyz: [{x}, {y}, 0.425]}}}}"
    for name, x, y in (
        ("east", 0.453, -0.45),
        ("west", 0.345, -0.45),
        ("north", 0.4, -0.395),
        ("south", 0.4, -0.505),
    )
)
NEIGHBOR = f"  beside: {{shape: box, size: {CUBE}, mass: 1, pose: {{xyz: [0.55, -0.45, 0.425]}}}}"
GRASP = "grasp: {object: obj}"
APPROACH = "{offset: {xyz: [0.1, 0, 0]}}"
HIGH = "place: {object: obj, at: {xyz: [0.25, -0.4, 0.47]}}"


def why(folder: Path, size: list[float], steps: str, others: str = "") -> Cause:
    """The first cause of the run's failure."""
    text = FILE.format(size=size, height=0.4 + size[2] / 2, steps=steps, others=others)
    [story] = stories(recorded(folder, text))
    return story.causes[0]


def test_obstacles_next_to_an_object_are_named_nearest_first(tmp_path: Path) -> None:
    cause = why(tmp_path, CUBE, f"[{GRASP}]", AROUND)
    assert cause.kind == "NO_ROOM"
    assert "next to it is east (3 mm away), " in cause.sentence
    assert cause.remedy == "move east away, or remove it first"


@pytest.mark.parametrize("size", [[0.12, 0.12, 0.05], [0.15, 0.1, 0.004]])
def test_an_object_that_lies_flat_is_too_wide(size: list[float], tmp_path: Path) -> None:
    cause = why(tmp_path, size, f"[{GRASP}]")
    assert cause.kind == "TOO_WIDE"
    assert "there is no room for fingers around its short side" in cause.sentence


def test_an_object_declared_in_the_air_falls_before_the_gripper_is_there(tmp_path: Path) -> None:
    """An arm that does not know where it is grasps where it was; otherwise where it has landed."""
    text = FILE.format(size=CUBE, height=0.7, steps=f"[{GRASP}]", others="")
    assert not stories(recorded(tmp_path / "known", text))
    seen = "grasp: {object: obj, at: {xyz: [0.4, -0.45, 0.7]}}"
    text = FILE.format(size=CUBE, height=0.7, steps=f"[{seen}]", others="")
    [story] = stories(recorded(tmp_path / "seen", text))
    assert story.code == "NOT_GRASPED"
    assert story.causes[0].kind == "FELL"
    assert "obj fell by 275 mm while 'sequence/grasp' reached" in story.causes[0].sentence


def test_a_goal_without_ground_below(tmp_path: Path) -> None:
    cause = why(tmp_path, CUBE, f"[{GRASP}, {HIGH}]")
    assert cause.kind == "NOTHING_THERE"
    assert "no ground within 15 mm" in cause.sentence
    assert "`at`" in cause.remedy


def test_remedy_of_a_regrasp_without_ground_below_names_what_it_has(tmp_path: Path) -> None:
    """It has neither a `depth` nor a `direction`, as `insert` has."""
    high = "regrasp: {at: {xyz: [0.4, -0.45, 0.5], rpy: [0, 0, 0]}}"
    cause = why(tmp_path, CUBE, f"[{GRASP}, {high}]")
    assert (cause.kind, cause.remedy) == ("NOTHING_THERE", "a lower `at`")


def test_an_object_that_was_never_grasped(tmp_path: Path) -> None:
    cause = why(tmp_path, CUBE, f"[{HIGH}]")
    assert (cause.kind, cause.remedy) == ("NEVER_ATTACHED", "grasp: {object: obj} before")


@pytest.mark.parametrize("leaf", ["place: {at: {xyz: [0.25, -0.4, 0.47]}}", "regrasp"])
def test_a_leaf_that_needs_any_object_in_an_empty_hand(leaf: str, tmp_path: Path) -> None:
    """Without a port that names the object, no cause was given."""
    cause = why(tmp_path / "never", CUBE, f"[{leaf}]")
    assert cause.kind == "NEVER_ATTACHED"
    assert cause.remedy == "`grasp` an object before"
    cause = why(tmp_path / "released", CUBE, f"[{GRASP}, release, {leaf}]")
    assert cause.kind == "LET_GO", cause
    assert "'sequence/release' (release) had released obj at" in cause.sentence
    wide = [0.12, 0.12, 0.05]
    cause = why(tmp_path / "failed", wide, f"[force_success: {{child: {{{GRASP}}}}}, {leaf}]")
    assert cause.kind == "NEVER_ATTACHED"
    assert "arm1 never grasped obj: 'sequence/force_success/grasp' (grasp) failed" in cause.sentence


@pytest.mark.parametrize("releases", ["place: {at: {xyz: [0.3, -0.4, 0.426]}}", "release"])
def test_a_leaf_that_released_the_object_without_its_name(releases: str, tmp_path: Path) -> None:
    cause = why(tmp_path, CUBE, f"[{GRASP}, {releases}, {HIGH}]")
    assert cause.kind == "LET_GO", cause
    assert f"({releases.partition(':')[0]}) had released obj at" in cause.sentence


_WALL = "{shape: box, size: [0.1, 0.02, 0.2], mass: 1, pose: {xyz: [0.2, %g, 0.501]}}"
WALLS = f"  north: {_WALL % -0.38}\n  south: {_WALL % -0.52}"
BETWEEN = "place: {at: {xyz: [0.2, -0.45, 0.45], rpy: [0, 0, 0]}}"
"""Placing between these walls, where a hand has no room that holds the object from the side."""


def test_a_hand_that_does_not_fit_at_the_goal_needs_another_grasp(tmp_path: Path) -> None:
    """With a grasp from the side, the hand would be in the wall; from above there is room."""
    steps = f"[grasp: {{object: obj, approach: [0, -1, 0]}}, {BETWEEN}]"
    cause = why(tmp_path, [0.04, 0.05, 0.1], steps, WALLS)
    assert cause.kind == "IN_THE_WAY"
    assert cause.remedy.startswith("grasp it otherwise: give `then_at` of `grasp` this goal")


def test_what_belongs_to_the_scene_is_not_to_be_moved(tmp_path: Path) -> None:
    """The remedy was to move the table away."""
    cause = why(tmp_path, CUBE, f"[{GRASP}, move_linear: {{offset: {{xyz: [0.1, 0, -0.1]}}}}]")
    assert cause.kind == "IN_THE_WAY"
    assert cause.remedy == "take a path farther from table"


def test_a_goal_out_of_reach_with_this_grasp_is_named_with_a_remedy(tmp_path: Path) -> None:
    """Held from above, it cannot be set down at the edge of the workspace, where it can be held."""
    cause = why(tmp_path, CUBE, f"[{GRASP}, place: {{at: {{xyz: [0.6, -0.7, 0.425]}}}}]")
    assert cause.kind == "OUT_OF_REACH"
    sentence = "ur5 cannot reach (0.6, -0.7, 0.425) with this grasp, in any heading: the tool gets"
    assert cause.sentence.startswith(sentence)
    assert cause.sentence.count(" mm") == 1
    assert "`then_at`" in cause.remedy
    assert "orientation" not in cause.remedy
    given = "place: {at: {xyz: [0.6, -0.7, 0.425], rpy: [0, 0, 0]}}"
    cause = why(tmp_path / "given", CUBE, f"[{GRASP}, {given}]")
    assert cause.sentence.startswith("ur5 cannot reach (0.6, -0.7, 0.425) with this orientation")


def test_a_hand_in_the_way_after_regrasp_needs_another_approach_of_it(tmp_path: Path) -> None:
    """`regrasp` has no `then_at`."""
    regrasp = "regrasp: {object: obj, approach: [0, -1, 0]}"
    steps = f"[{GRASP}, {regrasp}, {BETWEEN}]"
    cause = why(tmp_path, [0.04, 0.05, 0.1], steps, WALLS)
    assert cause.kind == "IN_THE_WAY"
    assert cause.remedy.startswith("grasp it otherwise: another `approach` of `regrasp`")


def test_the_mass_of_what_stands_on_it_is_not_taken_for_an_assumption(tmp_path: Path) -> None:
    """The advice was to give the leaf the mass of the object alone."""
    top = NEIGHBOR.replace("mass: 1", "mass: 20").replace("0.55, -0.45, 0.425", "0.4, -0.45, 0.475")
    cause = why(tmp_path, CUBE, f"[{GRASP}]", top)
    assert cause.kind == "OVERLOADED"
    assert "assumes" not in cause.sentence


def test_fall_before_the_object_was_located_is_not_the_cause(tmp_path: Path) -> None:
    """Another arm had let it fall; this one found it, and was told to place it on a support."""
    text = FILE.replace("mass: 0.2", "mass: 0.2, color: yellow").format(
        size=CUBE,
        height=0.5,
        steps="[wait: 1, look_at: {at: {xyz: [0.4, -0.45, 0.42]}}, locate: {object: obj}, "
        "grasp: {object: obj, approach: [0, 0, 1]}]",
        others="",
    )
    [story] = stories(
        recorded(tmp_path, text.replace("robotiq_2f85", "robotiq_2f85\n    camera: {}"))
    )
    assert story.kind == "grasp"
    assert [cause.kind for cause in story.causes] == ["NO_ROOM"]


def test_peg_without_a_hole_has_a_remedy(tmp_path: Path) -> None:
    """Only the number of tried positions was repeated."""
    at = "{xyz: [0.3, -0.4, 0.43], rpy: [0, 0, 0]}"
    insert = f"insert: {{object: obj, at: {at}, depth: 0.01, radius: 0}}"
    cause = why(tmp_path, [0.02, 0.02, 0.08], f"[{GRASP}, {insert}]")
    assert cause.kind == "NOT_FOUND", cause
    assert cause.remedy == "an `at` nearer to the hole, or a larger `radius`"


def test_no_neighbor_is_blamed_for_an_approach_without_a_grasp(tmp_path: Path) -> None:
    cause = why(
        tmp_path, [0.2, 0.2, 0.04], "[grasp: {object: obj, approach: [0, 0, -1]}]", NEIGHBOR
    )
    assert cause.kind == "NO_ROOM"
    assert "within 30° of `approach`" in cause.sentence
    assert "next to it" not in cause.sentence
    assert cause.remedy == "another `approach`, or none"


def test_the_remedy_for_an_assumed_mass_is_to_give_it(tmp_path: Path) -> None:
    """A grip at a beam's end holds its 0.2 kg, but not what is assumed without a mass."""
    grasp = "grasp: {object: obj, approach: [1, 0, 0], margin: 8}"
    text = FILE.format(size=[0.3, 0.05, 0.05], height=0.425, steps=f"[{grasp}]", others="")
    [story] = stories(recorded(tmp_path, text.replace("table,", "table, reality: rough,")))
    cause = story.causes[0]
    assert cause.kind == "OVERLOADED", cause
    assert "the leaf assumes 1 kg, as `mass` is not given; obj has 0.2 kg" in cause.sentence
    assert cause.remedy == "give the leaf the mass: mass: 0.2"


def test_a_load_that_slips_out_of_the_hand_is_too_heavy_for_it(tmp_path: Path) -> None:
    """An arm that estimates its payload takes hold of anything; only the reason was repeated."""
    text = FILE.format(size=[0.025] * 3, height=0.4125, steps=f"[{GRASP}]", others="")
    heavy = text.replace("mass: 0.2", "mass: 23").replace("robot: ur5", "robot: ur10e")
    [story] = stories(recorded(tmp_path, heavy.replace("table,", "table, reality: rough,")))
    assert story.code in ("DROPPED", "SLIPPED")
    cause = story.causes[0]
    assert cause.kind == "OVERLOADED", cause
    assert "obj (23 kg) is too heavy for the grip: robotiq_2f85 may hold 5 kg" in cause.sentence


def test_open_gripper_is_named_as_the_leaf_that_released(tmp_path: Path) -> None:
    """`insert`, which keeps hold of its peg, was taken for such a leaf, and this was not."""
    text = FILE.format(
        size=CUBE,
        height=0.425,
        steps=f"[{GRASP}, open_gripper, transport: {{object: obj, to: {{xyz: [0.4, -0.3, 0.6]}}}}]",
        others="",
    )
    [story] = stories(recorded(tmp_path, text))
    assert story.code == "NOT_ATTACHED"
    assert story.causes[0].kind == "LET_GO"
    assert "(open_gripper) had released obj" in story.causes[0].sentence


FAR = """\
bt_dualarm: 1
name: far
world: {scene: empty, time_limit: 20}
objects:
  shelf: {shape: box, fixed: true, size: [0.2, 0.2, 0.2], pose: {xyz: [0.35, -0.4, 0.1]}}
  bar: {shape: box, size: [0.16, 0.035, 0.035], mass: 0.3, pose: {xyz: [0.35, -0.4, 0.2175]}}
arms:
  arm1:
    robot: ur5
    gripper: robotiq_2f85
    tree: {sequence: [{grasp: {object: bar}}, {hand_over: {object: bar, to: arm2}}]}
  arm2:
    robot: panda
    gripper: panda_hand
    base: {xyz: [2.5, 0, 0], rpy: [0, 0, 180]}
    tree: {take_over: {object: bar, from: arm1}}
"""


def test_a_handover_without_a_place_is_not_due_to_what_is_near_the_giver(tmp_path: Path) -> None:
    """The giver holds the bar above the shelf, and would bring it."""
    [_, story] = sorted(stories(recorded(tmp_path, FAR)), key=lambda story: story.arm)
    cause = story.causes[0]
    assert cause.kind == "OUT_OF_REACH"
    assert cause.sentence.startswith("arm1 and arm2 found no place to hand over bar")
    assert "`point`" in cause.remedy


def test_what_another_gripper_holds_is_in_the_way_of_the_arm_that_holds_it(tmp_path: Path) -> None:
    """Only welded objects counted as held: the advice was to move the object away."""
    text = FILE.format(
        size=[0.24, 0.05, 0.05],
        height=0.425,
        steps=f"[await: held, {GRASP.replace('obj}', 'other}')}, move_linear: {APPROACH}]",
        others=NEIGHBOR.replace("beside", "other").replace("0.55", "0.15"),
    )
    text += """\
  arm2:
    robot: ur5
    gripper: robotiq_2f85
    base: {xyz: [0.95, -0.45, 0.4], rpy: [0, 0, 180]}
    tree: {sequence: [grasp: {object: obj}, signal: held]}
cell: {signals: {held: {type: boolean, written_by: [arm2]}}}
"""
    [story] = stories(recorded(tmp_path, text))
    cause = story.causes[0]
    assert cause.kind == "OTHER_ARM"
    assert cause.sentence.endswith("other would touch obj, which it holds")
    assert cause.remedy.endswith(
        "if they are to meet, name it: into: obj, while arm2 is in hold_still with partner: arm1"
    )


def test_fingers_that_hide_a_part_of_what_they_hold_are_named(tmp_path: Path) -> None:
    """Its color was found, in another outline: the advice was to tune the color."""
    text = FILE.replace("mass: 0.2", "mass: 0.2, color: yellow").format(
        size=CUBE,
        height=0.425,
        steps=f"[{GRASP}, reach_to_pose: {{to: {{xyz: [0.45, -0.25, 0.6], rpy: [180, 0, 0]}}}}]",
        others="",
    )
    text += (
        LOOKS
        + """\
        - look_at: {at: {xyz: [0.45, -0.25, 0.58]}, distance: 0.4, direction: [-1, 0, -0.2]}
        - locate: {object: obj}
"""
    )
    [story] = stories(recorded(tmp_path, text))
    assert story.code == "NOT_SEEN"
    assert story.causes[0].kind == "OCCLUDED"
    assert "arm1/gripper/left is between the camera and a part of obj" in story.causes[0].sentence


def test_object_of_another_arm_in_the_path_is_no_advice_to_place_it(tmp_path: Path) -> None:
    """A leaf that only looks at it was told that the other arm holds it already."""
    text = FILE.replace("    gripper: robotiq_2f85\n", "")
    text = text.replace("mass: 0.2", "mass: 0.2, color: yellow").format(
        size=[0.06, 0.06, 0.06],
        height=0.43,
        steps="[approach_and_attach: {object: obj}, "
        "reach_to_pose: {to: {xyz: [0.5775, -0.2169, 0.6193], rpy: [180, 0, 0]}}, wait: 30]",
        others="",
    )
    text += (
        LOOKS
        + """\
        - look_at:
            at: {xyz: [0.5775, -0.2169, 0.6193]}
            distance: 0.368
            direction: [0.2417, -0.9752, -0.0625]
        - timeout: {seconds: 4, child: {locate: {object: obj}}}
"""
    )
    causes = [
        story.causes[0] for story in stories(recorded(tmp_path, text)) if "locate" in story.leaf
    ]
    assert [cause.kind for cause in causes] == ["OTHER_ARM"]


def test_an_approach_without_room_is_to_be_changed(tmp_path: Path) -> None:
    """The fingers find room at the rim of a wide cup only from above; it was to be turned."""
    text = FILE.replace("shape: box", "shape: cup, wall: 0.004").format(
        size=[0.046, 0.08],
        height=0.44,
        steps="[grasp: {object: obj, approach: [0, -1, 0]}]",
        others="",
    )
    [story] = stories(recorded(tmp_path, text))
    assert "table is too near" in story.reason
    assert story.causes[0].remedy == "another `approach`, or none"


def test_a_round_object_is_as_wide_as_twice_its_radius(tmp_path: Path) -> None:
    text = FILE.replace("shape: box", "shape: cylinder").format(
        size=[0.05, 0.12], height=0.46, steps=f"[{GRASP}]", others=""
    )
    [story] = stories(recorded(tmp_path, text))
    assert story.code == "TOO_WIDE"
    assert "obj is 100 by 100 by 120 mm" in story.causes[0].sentence


KNOCKED = """\
bt_dualarm: 1
name: knocked
world: {{scene: table, reality: lab, time_limit: 20}}
objects:
  obj: {{shape: box, size: {size}, mass: 0.2, friction: 0.5, pose: {{xyz: [0.4, -0.45, {height}]}}}}
  wall: {{shape: box, fixed: true, size: [0.05, 0.05, 0.1], pose: {{xyz: [0.15, -0.45, 0.45]}}}}
arms:
  arm1:
    robot: ur5
    gripper: {gripper}
    base: {{xyz: [0, 0, 0.4]}}
    tree:
      sequence:
        - grasp: {{object: obj, approach: [0, 0, -1], point: [0, 0, {top}]}}
        - move_until_contact: {{direction: [-1, 0, 0], distance: 0.3, force: 60, speed: 0.2}}
"""


@pytest.mark.parametrize(
    ("gripper", "size", "top", "code"),
    [
        ("robotiq_2f85", [0.05, 0.05, 0.3], 0.13, "SLIPPED"),
        ("suction_cup", [0.1, 0.1, 0.2], 0.1, "DROPPED"),  # touches between two recorded states
    ],
)
def test_what_knocked_an_object_out_of_the_hand_is_named(
    gripper: str, size: list[float], top: float, code: str, tmp_path: Path
) -> None:
    """The lower end of a bar hits a wall, and turns in the hand, or off the cup."""
    text = KNOCKED.format(gripper=gripper, size=size, height=0.4 + size[2] / 2, top=top)
    [story] = stories(recorded(tmp_path, text))
    assert story.code == code, story.reason
    cause = story.causes[0]
    assert cause.kind == "RAN_INTO"
    assert cause.sentence.startswith("obj ran into wall at ")
    assert cause.remedy.startswith("move wall away")


def test_an_object_to_which_a_pose_is_relative_was_never_spawned(tmp_path: Path) -> None:
    """The reason was repeated, with the advice to locate what is not in the world."""
    crate = NEIGHBOR.replace("mass: 1", "mass: 1, spawned: false")
    cause = why(tmp_path, CUBE, f"[{GRASP}, place: {{at: {{on: beside}}}}]", crate)
    assert cause.kind == "NOT_SPAWNED_YET", cause
    assert cause.remedy == "a leaf that spawns beside before"
