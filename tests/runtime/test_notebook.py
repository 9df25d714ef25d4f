"""Runs and results in a notebook: well-formed tables in which all text is escaped."""

from __future__ import annotations

from dataclasses import replace
from typing import Any
from xml.etree import ElementTree as ET

import bt_dualarm as bt
from bt_dualarm.behaviors.report import LeafReport
from bt_dualarm.runtime.outcome import html_table, metrics_text

EVIL = "<script>alert('x')</script> & \"more\""

TWO: dict[str, Any] = {
    "bt_dualarm": 1,
    "name": "two",
    "world": {"scene": "empty", "seed": 7},
    "arms": {
        "left": {
            "robot": "ur5",
            "tree": {"sequence": [{"wait": {"seconds": 0.1}}, {"wait": {"seconds": 0.2}}]},
        },
        "right": {
            "robot": "ur3",
            "base": {"xyz": [0, 1.5, 0]},
            "tree": {"fail": {"reason": EVIL}},
        },
    },
}


def parsed(text: str) -> ET.Element:
    """Parse a table; raise if it is not well-formed."""
    return ET.fromstring(text)  # noqa: S314 - it is ours


def cells_of(text: str) -> list[list[str]]:
    """Texts of a table's rows below its header."""
    return [[cell.text or "" for cell in row] for row in parsed(text).iter("tr")][1:]


def caption_of(text: str) -> str:
    return parsed(text).findtext("caption") or ""


def test_every_text_of_a_table_is_escaped() -> None:
    table = html_table(EVIL, (EVIL, "b"), [(EVIL, "1"), ("x", EVIL)])
    assert "<script" not in table
    assert caption_of(table) == EVIL
    assert cells_of(table) == [[EVIL, "1"], ["x", EVIL]]


def test_every_cell_is_aligned_to_the_left() -> None:
    """Jupyter aligns cells to the right, where the indentation of nodes would be lost."""
    table = parsed(html_table("", ("a",), [("b",)]))
    cells = [cell for row in table.iter("tr") for cell in row]
    assert [cell.get("style") for cell in cells] == ["text-align: left"] * 2


def test_metrics_are_rounded_and_few() -> None:
    assert metrics_text({"path_rms_m": 1.23456789e-5, "turns": 2}) == (
        "path_rms_m = 1.235e-05, turns = 2"
    )
    assert metrics_text({f"m{i}": i for i in range(8)}).endswith("m5 = 5, and 2 more")


def test_a_run_shows_its_nodes_and_a_result_its_leaves() -> None:
    with bt.open(TWO) as run:
        before = cells_of(run._repr_html_())
        assert before[0] == ["left (ur5)", "RUNNING", ""]
        assert [row[0].strip() for row in before[1:4]] == ["sequence", "wait", "wait"]
        assert [row[1] for row in before[1:4]] == ["INVALID"] * 3, "nothing was ticked yet"
        run.step(0.15)
        during = run._repr_html_()
        assert [row[1] for row in cells_of(during)[1:4]] == ["RUNNING", "SUCCESS", "RUNNING"]
        assert caption_of(during) == "two, seed 7: at 0.15 s"
        result = run.finish()
        after = run._repr_html_()
    assert after == result._repr_html_()
    rows = cells_of(after)
    assert [row[:2] for row in rows] == [
        ["left (ur5)", "SUCCESS"],
        ["sequence/wait", "SUCCESS"],
        ["sequence/wait#2", "SUCCESS"],
        ["right (ur3)", "FAILURE"],
        ["fail", "FAILURE FAIL"],
    ]
    assert EVIL in rows[-1][2]
    assert caption_of(after).startswith("two, seed 7: FAILURE after ")


def test_a_leaf_shows_its_metrics() -> None:
    result = bt.run({**TWO, "arms": {"left": TWO["arms"]["left"]}})
    (arm,) = result.arms.values()
    report = LeafReport("circle", "circle", "SUCCESS", 0.0, 1.0, metrics={"path_rms_m": 2.5e-5})
    shown = replace(result, arms={"left": replace(arm, runs=(report,))})
    assert cells_of(shown._repr_html_())[-1] == ["circle", "SUCCESS", "path_rms_m = 2.5e-05"]


def test_an_arm_that_is_not_in_the_world_is_shown() -> None:
    left = TWO["arms"]["left"]
    absent = {**TWO["arms"]["right"], "spawned": False}
    with bt.open({**TWO, "arms": {"left": left, "right": absent}}) as run:
        rows = cells_of(run._repr_html_())
    assert rows[-2:] == [["right (ur3)", "not in the world", ""], ["\u2003fail", "INVALID", ""]]
