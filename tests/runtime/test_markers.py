"""Markers that a tree looks for but no object has: a warning names the markers that exist."""

from __future__ import annotations

import pytest

from bt_dualarm.runtime.file_check import check
from bt_dualarm.skill.registry import Registry

KINDS = Registry.load().kinds

FILE = """\
bt_dualarm: 1
name: markers
world: {{scene: empty}}
objects:
  tag:
    shape: box
    size: [0.06, 0.06, 0.04]
    mass: 0.1
    marker: {{dictionary: apriltag_36h11, id: 5, size: 0.045}}
    pose: {{xyz: [0.5, 0, 0.02]}}
arms:
  arm1:
    robot: panda
    camera: {{}}
    tree: {{count: {{marker: {marker}}}}}
"""


@pytest.mark.parametrize(
    ("marker", "message", "hint"),
    [
        (
            "{id: 5, size: 0.045}",
            "no object has marker 5 of aruco_4x4_50; tag has 5 of apriltag_36h11",
            "did you mean dictionary: apriltag_36h11?",
        ),
        (
            "{dictionary: apriltag_36h11, id: 5, size: 0.06}",
            "that of tag measures 45 mm, not 60 mm",
            "did you mean size: 0.045?",
        ),
        ("{id: 7, size: 0.045}", "no object has marker 7 of aruco_4x4_50", "there are 5 of april"),
    ],
)
def test_a_marker_that_no_object_has_is_a_warning(marker: str, message: str, hint: str) -> None:
    checked = check(FILE.format(marker=marker), KINDS)
    [problem] = checked.problems
    assert problem.severity == "warning"
    assert problem.message == f"count: marker: {message}"
    assert problem.hint.startswith(hint)
    assert (problem.place.line, problem.place.column) == (15, 28)
    assert checked.file is not None


def test_a_marker_of_an_object_is_no_problem() -> None:
    given = "{dictionary: apriltag_36h11, id: 5, size: 0.045}"
    assert not check(FILE.format(marker=given), KINDS).problems
