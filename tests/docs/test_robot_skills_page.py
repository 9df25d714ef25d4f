"""docs/robot_skills.md has every robot and skill, and its cells agree with runs."""

from __future__ import annotations

import re

import pytest

from benchmarks.robot_skills import (
    BARE,
    LEFT_OUT,
    PAGE,
    Place,
    gripping,
    motions,
    seeing,
    tried,
)
from bt_dualarm.robots.gripper import gripper_names
from bt_dualarm.robots.robot_description import robot_names
from bt_dualarm.skill.registry import Registry
from tests.families import some

TEXT = PAGE.read_text(encoding="utf-8")
FAILS = {
    (robot, skill, gripper or BARE)
    for row in TEXT.partition("## Failures")[2].splitlines()
    for robot, skill, gripper in re.findall(r"`(\w+)` (\w+)(?: with `(\w+)`)?", row)
}
"""Robot, skill and gripper of every cell that is not a success."""

MOTIONS = tuple(motions(Place.of("ur5", None)))
CASES = [
    *some(((robot, skill, BARE) for robot in robot_names() for skill in MOTIONS), 59),
    *some(((robot, skill, BARE) for robot in robot_names() for skill in ("locate", "track")), 15),
    *some(
        ((robot, "place", gripper) for robot in robot_names() for gripper in gripper_names()), 17
    ),
]


def test_every_robot_and_skill_is_on_the_page() -> None:
    head = next(line for line in TEXT.splitlines() if line.startswith("| skill |"))
    assert re.findall(r"`(\w+)`", head) == list(robot_names())
    for skill in Registry.load().skills:
        assert f"`{skill}`" in TEXT
    assert all(f"`{skill}`" in TEXT.splitlines()[-1] for skill in LEFT_OUT)


@pytest.mark.parametrize(("robot", "skill", "gripper"), CASES, ids="-".join)
def test_outcome_of_a_skill_on_a_robot_is_that_on_the_page(
    robot: str, skill: str, gripper: str
) -> None:
    """A sample of the cells is run; `make matrix` runs them all."""
    leaves: dict[str, list[dict[str, object] | str]]
    if gripper != BARE:
        place = Place.of(robot, gripper)
        leaves = dict(gripping(place))
    elif skill in ("locate", "track"):
        place = Place.of(robot, None, looks=True)
        leaves = dict(seeing(place))
    else:
        place = Place.of(robot, None)
        leaves = dict(motions(place))
    cell = tried(place, skill, leaves[skill], "lab")
    assert bool(cell.failure) == ((robot, skill, gripper) in FAILS), cell.reason
