"""Skills that go `into` what another arm holds name the arm that does not hold it still."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from bt_dualarm.diagnosis.story import stories
from tests.replay.runs import recorded

FILE = """\
bt_dualarm: 1
name: into
world: {{scene: table, time_limit: 20}}
objects:
  post: {{shape: box, size: [0.04, 0.04, 0.20], mass: 0.2, pose: {{xyz: [0.4, -0.45, 0.5]}}}}
arms:
  holder:
    robot: ur5
    base: {{xyz: [0, 0, 0.4]}}
    tree: {{sequence: [{{approach_and_attach: {{object: post}}}}, {holding}, {{wait: 0.2}}]}}
  comer:
    robot: ur5
    base: {{xyz: [1.1, -0.45, 0.4], rpy: [0, 0, 180]}}
    tree:
      sequence:
        - wait: 4.0
        - move_linear: {{offset: {{xyz: {offset}}}, into: post}}
"""
INTO = [-0.19, 0.11, -0.28]
COOKBOOK = Path(__file__).parents[2] / "docs" / "cookbook"


@pytest.mark.parametrize(
    ("holding", "clause", "kind", "why"),
    [
        (
            "{hold_still: {duration: 1.0}}",
            "holder holds post, but not in hold_still with partner: comer",
            "OTHER_ARM",
            "holder, which holds post, was not in hold_still with partner: comer",
        ),
        (
            "{hold_still: {partner: comer, duration: 0.5}}, {detach: {object: post}}",
            "holder no longer holds post",
            "LET_GO",
            "holder let go of post at ",
        ),
    ],
    ids=["without a partner", "released"],
)
def test_failure_names_the_arm_that_does_not_hold_still(
    holding: str, clause: str, kind: str, why: str, tmp_path: Path
) -> None:
    """Only what the arm would touch was named, and `insert` into nothing had "nothing to touch"."""
    [story] = stories(recorded(tmp_path, FILE.format(holding=holding, offset=INTO)))
    assert story.reason.endswith(f"; {clause}")
    assert story.causes[0].kind == kind
    assert story.causes[0].sentence.startswith(why)
    assert "hold_still: {partner: comer} in the tree of holder" in story.causes[0].remedy


@pytest.mark.parametrize("partner", ["partner: comer, ", ""])
def test_arm_that_holds_an_object_is_not_blamed_for_a_goal_out_of_reach(
    partner: str, tmp_path: Path
) -> None:
    """The distance that plans keep from it changes nothing there: it was named all the same."""
    holding = f"{{hold_still: {{{partner}duration: 2.0}}}}"
    far = [3, 0, 0]
    record = recorded(tmp_path, FILE.format(holding=holding, offset=far))
    [story] = [one for one in stories(record) if one.arm == "comer"]
    assert "holder" not in story.reason
    assert "holder" not in story.causes[0].sentence


def test_timeout_of_an_insertion_is_not_blamed_on_the_arm_that_holds_the_hole(
    tmp_path: Path,
) -> None:
    """The tool hardly moves while it searches, and what it goes into is at its goal."""
    text = (COOKBOOK / "plug.yaml").read_text(encoding="utf-8")
    text = text.partition("\ngoal:")[0]
    shutil.copytree(COOKBOOK / "scenes", tmp_path / "scenes")
    before, insert, after = text.partition("- insert: ")
    ports, _, rest = after.partition("\n")
    child = f"{{insert: {ports}}}"
    halted = f"{{timeout: {{seconds: 9, child: {child}}}}}"
    text = f"{before}- retry: {{times: 3, child: {halted}}}\n{rest}"
    found = [one for one in stories(recorded(tmp_path, text)) if one.kind == "insert"]
    assert insert
    assert [one.causes[0].kind for one in found] == ["TOO_LITTLE_TIME"]


def test_arm_that_held_still_to_the_end_of_the_run_is_not_blamed_for_it(tmp_path: Path) -> None:
    """The end of the run halted both leaves in one tick, and `hold_still` was not running then."""
    holding = "{hold_still: {partner: comer, duration: 9.0}}"
    text = FILE.format(holding=holding, offset=[-0.1, 0.05, -0.1])
    record = recorded(tmp_path, text.replace("into: post", "into: post, speed: 0.02"), duration=5)
    found = {one.kind: one.causes for one in stories(record)}
    assert [one.kind for one in found["move_linear"]] == ["TOO_LITTLE_TIME"]
    waited, ended = found["hold_still"]
    assert waited.sentence.endswith(": comer was at 'sequence/move_linear' then")
    assert ended.kind == "TOO_LITTLE_TIME"
