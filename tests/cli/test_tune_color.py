"""The command ``bt-tune-color``."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import pytest

from bt_dualarm.cli import check, tune_color
from bt_dualarm.runtime.options import find_tree
from bt_dualarm.tuning import png
from tests.tuning.test_look import two_squares


@pytest.fixture
def photo(tmp_path: Path) -> str:
    path = tmp_path / "photo.png"
    path.write_bytes(png(two_squares()))
    return str(path)


def test_found_regions_of_an_image_are_listed(
    photo: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tune_color([photo]) == 0
    out = capsys.readouterr().out.splitlines()
    assert out[:2] == [photo, "color: yellow"]
    assert out[2].startswith("  1  center 30.0, 30.0 px  area 400 px²")
    assert len(out) == 4


def test_nothing_found_is_code_1(photo: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert tune_color([photo, "--color", "blue"]) == 1
    assert "nothing of this color" in capsys.readouterr().out


def test_picked_pixels_become_ranges_a_snippet_and_an_image(
    photo: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    snippet = tmp_path / "color.yaml"
    image = tmp_path / "seen.png"
    arguments = ["--pick", "30,30", "--snippet", str(snippet), "--out", str(image), "--json"]
    assert tune_color([photo, *arguments]) == 0
    report = json.loads(capsys.readouterr().out.partition("\nwritten")[0])
    assert [one["area_px"] for one in report["found"]] == [400.0, 100.0]
    assert f"color: [{{hue: {report['color'][0]['hue']}" in snippet.read_text(encoding="utf-8")
    drawn = cv2.imread(str(image))
    assert drawn is not None
    assert drawn.shape[1] == 3 * 480 + 8


def test_tree_is_evaluated_changed_and_checked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first camera image of a tracking arm is evaluated, and its file gets other ranges."""
    tree = tmp_path / "mine.yaml"
    before = find_tree("visual_tracking").read_text(encoding="utf-8")
    tree.write_text(before, encoding="utf-8")
    arguments = [str(tree), "--renderer", "ray", "--hue", "40", "72", "--write"]
    assert tune_color(arguments) == 0
    assert f"written: {tree}:" in capsys.readouterr().out
    after = tree.read_text(encoding="utf-8")
    assert after == before.replace("{color: yellow,", "{color: [{hue: [40, 72]}],")
    assert check([str(tree)]) == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["PHOTO", "--write"], "an image has no ranges"),
        (["PHOTO", "--pick", "80,0"], "pixel 80,0 is outside the image, which is 80x60"),
        (["PHOTO", "--value", "0.9", "0.1"], "value goes from 0.9 down to 0.1"),
        (["PHOTO", "--out", "/no/such/folder/x.png"], "cannot write /no/such/folder/x.png"),
        (["nothing.png"], "nothing.png: cannot be read"),
        (["visual_tracking", "--write"], "is shipped; copy it"),
        (["visual_tracking", "--arm", "arm9"], "there is no arm 'arm9'"),
        (["visual_tracking", "--line", "1"], "no leaf on line 1"),
        (["visual_tracking", "--posture", "look_ot"], "did you mean 'look_out'"),
        (["circle"], "no arm has one"),
    ],
)
def test_impossible_request_is_code_2(
    arguments: list[str], message: str, photo: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tune_color([photo if word == "PHOTO" else word for word in arguments]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("option", "message"),
    [
        (["--hue", "1", "361"], "'361' is not a hue from 0 to 360 degrees"),
        (["--value", "a", "1"], "'a' is not a number from 0 to 1"),
        (["--pick", "1;2"], "'1;2' is not a pixel X,Y"),
        (["--color", "pnk"], "there is no color 'pnk'"),
        (["--color", "["], "not YAML"),
        (["--serve", "70000"], "'70000' is not a port"),
        (["--at", "-1"], "'-1' is not a number of seconds"),
        (["--write", "--snippet", "x.yaml"], "not allowed with"),
    ],
)
def test_invalid_option_is_refused_at_once(
    option: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        tune_color(["x.png", *option])
    assert caught.value.code == 2
    assert message in capsys.readouterr().err
