"""Why a drawer or a door could not be moved: the planted cause is named first."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest
import yaml

from bt_dualarm.diagnosis.evidence import Cause
from bt_dualarm.diagnosis.story import stories
from tests.replay.runs import recorded
from tests.skills.scenarios import CABINET, GRIPPING, PULLS, Tree

OPENS: Tree = {"operate": {"object": "cabinet", "joint": "slide", "to": 0.15}}
POST: Tree = {
    "post": {"shape": "box", "size": [0.03, 0.03, 0.06], "mass": 1, "fixed": True}
    | {"pose": {"xyz": [0.36, -0.455, 0.43]}}
}
"""In front of the drawer, beside the handle: the drawer can move by 80 mm."""


def causes_of(
    folder: Path,
    *leaves: Any,
    joint: Tree | None = None,
    objects: Tree | None = None,
    faults: Tree | None = None,
    base: tuple[float, float, float] = (0.0, 0.0, 0.4),
) -> list[Cause]:
    cabinet = copy.deepcopy(CABINET)
    cabinet["cabinet"]["joints"]["slide"] |= joint or {}
    file = {
        "bt_dualarm": 1,
        "name": "joints",
        "world": {"scene": "table", "time_limit": 30},
        "objects": cabinet | (objects or {}),
        "arms": {"arm1": GRIPPING | {"base": {"xyz": [*base]}, "tree": {"sequence": [*leaves]}}},
    }
    if faults is not None:
        file["faults"] = faults
    [story] = stories(recorded(folder, yaml.safe_dump(file)))
    return list(story.causes)


@pytest.mark.parametrize(
    ("joint", "source"),
    [({"friction": 60}, "friction"), ({"spring": 500}, "spring"), ({"damping": 500}, "damping")],
)
def test_joint_that_is_too_stiff(joint: Tree, source: str, tmp_path: Path) -> None:
    cause = causes_of(tmp_path, PULLS, OPENS, joint=joint)[0]
    assert cause.kind == "TOO_STIFF", cause
    assert "cabinet.slide" in cause.sentence
    assert f"N by {source}" in cause.sentence
    assert "force: " in cause.remedy or "tool_speed" in cause.remedy


def test_obstacle_in_the_path_of_the_part(tmp_path: Path) -> None:
    cause = causes_of(
        tmp_path, {"grasp": {"object": "cabinet", "part": "handle"}}, OPENS, objects=POST
    )[0]
    assert cause.kind == "IN_THE_WAY", cause
    assert "post" in cause.sentence


def test_goal_beyond_the_range(tmp_path: Path) -> None:
    """The check refuses a literal goal; this one is known only in the run."""
    known: Tree = {"set": {"key": "goal", "value": 0.25}}
    far: Tree = {"operate": {"object": "cabinet", "joint": "slide", "to": "{goal}"}}
    cause = causes_of(tmp_path, known, PULLS, far)[0]
    assert cause.kind == "OUT_OF_RANGE", cause
    assert "0 to 0.18 m" in cause.sentence


def test_grip_that_must_not_be_firm(tmp_path: Path) -> None:
    weak: Tree = {"grasp": PULLS["grasp"] | {"most_force": 20}}
    cause = causes_of(tmp_path, weak, OPENS, joint={"friction": 30})[0]
    assert cause.kind == "WEAK_GRIP", cause


def test_handle_that_slides_out_of_the_hand(tmp_path: Path) -> None:
    """An injected fault gives the handle less friction than the arm assumes."""
    fault = {"kind": "reduced_friction", "object": "cabinet.slide", "friction": 0.02, "begin": 4.5}
    causes = causes_of(tmp_path, PULLS, OPENS, joint={"friction": 25}, faults={"oil": fault})
    assert "HANDLE_SLIPPED" in {cause.kind for cause in causes}, causes


def test_nothing_is_held(tmp_path: Path) -> None:
    cause = causes_of(tmp_path, OPENS)[0]
    assert cause.kind == "NEVER_ATTACHED", cause
    assert cause.sentence == "arm1 never grasped cabinet.slide: no leaf had grasped it before"
    assert cause.remedy == "grasp: {object: cabinet.slide, then_to: 0.15} before"


CHEST: Tree = {
    "chest": {
        "shape": "compound",
        "mass": 0.25,
        "pose": {"xyz": [0.4, -0.4, 0.4205]},
        "parts": {
            "body": {"shape": "box", "size": [0.2, 0.035, 0.04]},
            "lid": {"shape": "box", "size": [0.03, 0.035, 0.006], "pose": {"xyz": [0, 0, 0.025]}},
        },
        "joints": {
            "hinge": {"type": "hinge", "parts": ["lid"], "axis": [0, -1, 0], "mass": 0.01}
            | {"anchor": [-0.015, 0, 0.022], "range": [0, 100]}
        },
    }
}


@pytest.mark.parametrize(
    ("leaves", "sentence"),
    [
        ([], "arm1 holds chest by a part that 'hinge' does not move"),
        (
            [{"place": {"at": {"xyz": [0.45, -0.35, 0.4205]}}}],
            "arm1 never grasped chest.hinge: no leaf had grasped it before",
        ),
    ],
)
def test_an_arm_that_has_held_other_parts(
    leaves: list[Tree], sentence: str, tmp_path: Path
) -> None:
    lifts: Tree = {"operate": {"object": "chest", "joint": "hinge", "to": 60}}
    cause = causes_of(tmp_path, {"grasp": {"object": "chest"}}, *leaves, lifts, objects=CHEST)[0]
    assert (cause.kind, cause.sentence) == ("NEVER_ATTACHED", sentence)


def test_drawer_that_was_grasped_by_what_does_not_move(tmp_path: Path) -> None:
    """The advice was to let go of the whole cabinet (`fixed: false`)."""
    cause = causes_of(tmp_path, {"grasp": {"object": "cabinet"}})[0]
    assert cause.kind == "FIXED", cause
    assert "`part`" in cause.remedy


def test_end_of_the_motion_is_out_of_reach(tmp_path: Path) -> None:
    """The arm can grasp the handle, but is too far away to push the drawer shut."""
    grasps: Tree = {"grasp": {"object": "cabinet", "part": "handle"}}
    shuts: Tree = {"operate": {"object": "cabinet", "joint": "slide", "to": 0.0}}
    cause = causes_of(tmp_path, grasps, shuts, joint={"at": 0.18}, base=(0.0, 0.33, 0.4))[0]
    assert cause.kind == "OUT_OF_REACH", cause
    assert "cabinet.slide at 0 mm" in cause.sentence
