"""An implausible gripper description is refused with the place of the error."""

from __future__ import annotations

from pathlib import Path

import pytest

from bt_dualarm.core.share import share_dir
from bt_dualarm.robots.gripper import load_gripper
from bt_dualarm.robots.urdf_xml import DescriptionError
from tests.robots.small_arm import line_of

TEXT = (share_dir("assets") / "grippers" / "robotiq_2f85.yaml").read_text(encoding="utf-8")

WRONG = {
    "a stroke in millimeters": ("{value: 0.085,", "{value: 85,", "in meters: 0.085, if 85 mm"),
    "a speed in millimeters": ("[0.020, 0.150]", "[20, 150]", "must be at most 2, not 20"),
    "a speed that falls": ("[0.020, 0.150]", "[0.150, 0.020]", "the smaller value comes first"),
    "a pad off the middle": (
        "pad: {xyz: [0, 0.0035,",
        "pad: {xyz: [0, 0.0135,",
        "its inner face is at y = 0.01 m, not at 0",
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_wrong_value_is_refused_with_its_place(what: str, tmp_path: Path) -> None:
    right, wrong, message = WRONG[what]
    assert TEXT.count(right) == 1
    (tmp_path / "claw.yaml").write_text(TEXT.replace(right, wrong), encoding="utf-8")
    with pytest.raises(DescriptionError) as caught:
        load_gripper("claw.yaml", tmp_path)
    assert message in str(caught.value)
    assert caught.value.problems[0].place.line == line_of(TEXT, right)
