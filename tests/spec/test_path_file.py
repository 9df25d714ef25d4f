"""Points of a path from a CSV or SVG file, which may be untrusted."""

from __future__ import annotations

import math
import random
from pathlib import Path

import pytest

import bt_dualarm as bt
from bt_dualarm.spec.path_file import points_in


def svg(data: str, before: str = "", extra: str = "") -> str:
    """An SVG drawing with one path."""
    drawing = f'<g {extra}><path d="{data}"/></g>'
    head = '<?xml version="1.0"?>'
    return f'{head}{before}<svg xmlns="http://www.w3.org/2000/svg">{drawing}</svg>'


@pytest.mark.parametrize(
    "text",
    [
        "0,0\n30,0\n30,20\n",
        "x, y\n0, 0\n30, 0\n\n30, 20",
        "# mm\n0;0\n30;0 # a corner\n3e1;20.0\r\n",
        "0 0\n0 0\n30\t0\n30 20\n",
    ],
)
def test_common_notations_of_csv_are_read(text: str) -> None:
    assert points_in(text, "a.csv") == [(0, 0), (30, 0), (30, 20)]


@pytest.mark.parametrize(
    ("data", "points"),
    [
        ("M0 0 L30 0 L30 20", [(0, 0), (30, 0), (30, -20)]),
        ("M 0,0 30,0 30,20", [(0, 0), (30, 0), (30, -20)]),
        ("m0 0l30 0l0 20", [(0, 0), (30, 0), (30, -20)]),
        ("M0,0H30V20", [(0, 0), (30, 0), (30, -20)]),
        ("M10-5h30v20", [(10, 5), (40, 5), (40, -15)]),
        ("M0 0h.5.5v1z", [(0, 0), (0.5, 0), (1, 0), (1, -1), (0, 0)]),
    ],
)
def test_lines_of_an_svg_path(data: str, points: list[tuple[float, float]]) -> None:
    """Relative and absolute, with and without separators; y is upward."""
    assert points_in(svg(data), "a.SVG") == [(x, y + 0.0) for x, y in points]


def test_curves_of_an_svg_path() -> None:
    """A quarter of a circle as a cubic curve, its smooth continuation, and a quadratic curve."""
    k = 0.5522847498
    quarter = f"M 100 0 C 100 {100 * k} {100 * k} 100 0 100"
    points = points_in(svg(quarter), "a.svg")
    assert len(points) == 17
    assert all(abs(math.hypot(*point) - 100) < 0.03 for point in points)
    smooth = points_in(svg(f"{quarter} S -100 {100 * k} -100 0"), "a.svg")
    assert len(smooth) == 33
    assert all(abs(math.hypot(*point) - 100) < 0.03 for point in smooth), "mirrored control point"
    parabola = points_in(svg("M 0 0 Q 50 100 100 0 T 200 0"), "a.svg")
    for x, y in parabola:
        expected = -x * (100 - x) / 50 if x <= 100 else (x - 100) * (200 - x) / 50
        assert y == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("text", "name", "message"),
    [
        ("0,0\n1,2,3\n", "a.csv", "line 2: expected two numbers, not '1,2,3'"),
        ("x,y\nname,z\n0,0\n1,1", "a.csv", "line 2: expected two numbers"),
        ("0,0\n1,nan\n", "a.csv", "is not a number within"),
        ("0,0\n1,1e300\n", "a.csv", "is not a number within 1e\\+06"),
        ("0,0\n0,0\n", "a.csv", "fewer than two different points"),
        ("", "a.csv", "fewer than two different points"),
        ("\n".join(f"{n},0" for n in range(2001)), "a.csv", "more than 2000 points"),
        ("<svg><path d='M0 0 L1 1'></svg>", "a.svg", "line 1: not XML"),
        ("<svg/>", "a.svg", "has no path element"),
        (svg("M0 0 L1 1", extra='transform="scale(2)"'), "a.svg", "transforms are not supported"),
        (svg("M0 0 A1 1 0 0 1 2 2"), "a.svg", "the command 'A' is not supported"),
        (svg("M0 0 L1"), "a.svg", "the command 'L' needs 2 numbers"),
        (svg("L1 1"), "a.svg", "does not begin with the command M"),
        (svg("1 1"), "a.svg", "a number stands where a command is expected"),
        (svg("M0 0 L1 1 Z 3"), "a.svg", "a number stands where a command is expected"),
        (svg("M0 0 L1 1 M2 2 L3 3"), "a.svg", "has a second subpath"),
        (svg("M0 0 L1 #"), "a.svg", "'#' is neither a command nor a number"),
        (
            svg("M0 0 L1 1", '<!DOCTYPE s [<!ENTITY a "b"><!ENTITY c "&a;&a;">]>'),
            "a.svg",
            "declares a document type",
        ),
        (svg("M0 0 " + "C1 1 2 2 3 3 " * 200), "a.svg", "more than 2000 points"),
    ],
)
def test_mistakes_are_named(text: str, name: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        points_in(text, name)


def test_mutated_files_are_read_or_refused() -> None:
    """Only ValueError is raised, and every point that is read is finite."""
    dice = random.Random(1)  # noqa: S311 - no secret
    seeds = [
        svg("M 10,50 C 10,20 40,20 50,50 S 90,80 90,50 Q1 2 3 4 T5 6 h3v4z"),
        "x,y\n0,0\n3;4\n",
    ]
    letters = 'MLHVCSQTZmz0123456789.,-+eE <>"&;#\n\t\x00é'
    for number in range(3000):
        text = [*dice.choice(seeds)]
        for _ in range(dice.randint(1, 6)):
            at = dice.randrange(len(text))
            text[at : at + dice.randint(0, 3)] = dice.choices(letters, k=dice.randint(0, 4))
        try:
            points = points_in("".join(text), ("a.svg", "a.csv")[number % 2])
        except ValueError:
            continue
        assert all(math.isfinite(one) for point in points for one in point)


TREE = """\
bt_dualarm: 1
world: {scene: empty}
arms:
  arm1:
    robot: ur5
    base: {xyz: [0, 0, 0.4]}
    posture: present
    tree: {follow_path: {file: FILE, tool_speed: 0.04}}
"""


def problems(folder: Path, file: str) -> str:
    (folder / "tree.yaml").write_text(TREE.replace("FILE", file))
    return "\n".join(map(str, bt.check(folder / "tree.yaml")))


def test_nothing_outside_the_folder_is_read(tmp_path: Path) -> None:
    """Neither by its name nor by a link; huge files and other formats are refused, too."""
    folder = tmp_path / "trees"
    folder.mkdir()
    (tmp_path / "out.csv").write_text("0,0\n1,1\n")
    (folder / "link.csv").symlink_to(tmp_path / "out.csv")
    (folder / "huge.csv").write_text("0,0\n" * 80_000)
    (folder / "bytes.csv").write_bytes(b"\xff\xfe0,0")
    (folder / "inner").mkdir()
    (folder / "inner" / "ok.csv").write_text("0,0\n30,0\n")
    for file, message in (
        ("../out.csv", "'../out.csv' is not below the folder of the tree or scene file"),
        (str(tmp_path / "out.csv"), "is not below the folder of the tree or scene file"),
        ("link.csv", "link.csv: leads out of the folder"),
        ("huge.csv", "huge.csv: is larger than 256 KiB"),
        ("bytes.csv", "bytes.csv: is not text in UTF-8"),
        ("none.csv", "none.csv: there is no such file"),
        ("tree.yaml", "expected a CSV or SVG file, not 'tree.yaml'"),
        ('"{key}"', "a file cannot come from the blackboard"),
    ):
        assert message in problems(folder, file), file
    assert problems(folder, "inner/ok.csv") == ""


@pytest.mark.parametrize("file", ["./inner/ok.csv", "inner//ok.csv", "inner/./ok.csv"])
def test_a_path_may_be_written_in_several_ways(file: str, tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "ok.csv").write_text("0,0\n30,0\n")
    (tmp_path / "tree.yaml").write_text(TREE.replace("FILE", file))
    leaf = bt.run(tmp_path / "tree.yaml").arms["arm1"].leaves["follow_path"]
    assert (leaf.status, leaf.reason) == ("SUCCESS", "")


@pytest.mark.usefixtures("without_plots")
def test_the_record_has_the_file(tmp_path: Path) -> None:
    """A replay needs the record alone."""
    (tmp_path / "logo.svg").write_text(svg("M 0 0 C 0 60 80 60 80 0"))
    (tmp_path / "tree.yaml").write_text(TREE.replace("FILE", "logo.svg"))
    result = bt.run(tmp_path / "tree.yaml", record=tmp_path / "out")
    leaf = result.arms["arm1"].leaves["follow_path"]
    assert (leaf.status, leaf.reason) == ("SUCCESS", "")
    (tmp_path / "logo.svg").unlink()
    from bt_dualarm.replay.record import Record

    texts = Record.read(tmp_path / "out").start["texts"]
    assert any(path.endswith("logo.svg") and "<svg" in text for path, text in texts.items())
