"""Edits of one value in a text: they change that value, and nothing else."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_dualarm.runtime.options import find_tree
from bt_dualarm.spec.problems import SpecError
from bt_dualarm.spec.yaml_reader import flow_text, read_text, with_value

RANGES = [{"hue": [10, 20], "saturation": [0.5, 1]}]
WRITTEN = "[{hue: [10, 20], saturation: [0.5, 1]}]"

EDITS = {
    "a word in a flow mapping": (
        "tree:  # the tree\n  - track: {color: yellow , plane: yz}  # follow\n",
        f"tree:  # the tree\n  - track: {{color: {WRITTEN} , plane: yz}}  # follow\n",
        ("tree", 0, "track", "color"),
    ),
    "quoted text": ('a: "{c}"  # why\n', f"a: {WRITTEN}  # why\n", ("a",)),
    "only the numbers that differ": (
        "a:\n  - hue:\n      - 42   # low\n      - 20 # high\n    saturation: [0.5,  0.9]\nb: 1\n",
        "a:\n  - hue:\n      - 10   # low\n      - 20 # high\n    saturation: [0.5,  1]\nb: 1\n",
        ("a",),
    ),
    "a block of another shape": (
        "t:\n  a:\n  - hue: [1, 2]\n\n  # of b\n  b: 1\n",
        f"t:\n  a: {WRITTEN}\n\n  # of b\n  b: 1\n",
        ("t", "a"),
    ),
    "a flow list of another shape over lines": (
        "a: [{hue: [1, 2]},\n    {hue: [3, 4]}]  # two\nb: 1\n",
        f"a: {WRITTEN}  # two\nb: 1\n",
        ("a",),
    ),
    "a key that is not there, in a block": (
        "x:\n  - track:\n      plane: yz  # here\n",
        f"x:\n  - track:\n      color: {WRITTEN}\n      plane: yz  # here\n",
        ("x", 0, "track", "color"),
    ),
    "a key that is not there, in braces": (
        "x: {track: { plane: yz}}\n",
        f"x: {{track: {{ color: {WRITTEN}, plane: yz}}}}\n",
        ("x", "track", "color"),
    ),
    "a key in empty braces": (
        "x: {track: {}}\n",
        f"x: {{track: {{color: {WRITTEN}}}}}\n",
        ("x", "track", "color"),
    ),
    "a key below nothing": (
        "x:\n  - track:  # all defaults\n  - wait: 1\n",
        f"x:\n  - track: {{color: {WRITTEN}}}  # all defaults\n  - wait: 1\n",
        ("x", 0, "track", "color"),
    ),
    "a key of a bare word": (
        "x:\n  - track  # all defaults\n",
        f"x:\n  - {{track: {{color: {WRITTEN}}}}}  # all defaults\n",
        ("x", 0, "track", "color"),
    ),
    "a bare word as a value": (
        "x: track\n", f"x: {{track: {{color: {WRITTEN}}}}}\n", ("x", "track", "color")
    ),
    "no line end at the end": ("a: yellow", f"a: {WRITTEN}", ("a",)),
    "a byte order mark": ("\ufeffa: yellow\n", f"\ufeffa: {WRITTEN}\n", ("a",)),
    "characters of two words": ("ä: 😀  # 😀\na: yellow\n", f"ä: 😀  # 😀\na: {WRITTEN}\n", ("a",)),
}  # fmt: skip


@pytest.mark.parametrize("name", EDITS)
def test_an_edit_changes_only_its_value(name: str) -> None:
    before, after, path = EDITS[name]
    assert with_value(before, "t.yaml", path, RANGES) == after


@pytest.mark.parametrize("name", EDITS)
@pytest.mark.parametrize("ending", ["\r\n", "\r"])
def test_line_endings_are_kept(name: str, ending: str) -> None:
    before, after, path = EDITS[name]
    changed = with_value(before.replace("\n", ending), "t.yaml", path, RANGES)
    assert changed == after.replace("\n", ending)


@pytest.mark.parametrize("name", EDITS)
def test_an_edit_repeated_changes_nothing(name: str) -> None:
    _, after, path = EDITS[name]
    assert with_value(after, "t.yaml", path, RANGES) == after


def test_comments_in_a_value_are_not_lost() -> None:
    text = "a:\n  # the lamp is warm\n  - hue: [1, 2]\n"
    with pytest.raises(SpecError, match=r"t\.yaml:3:3: error: .* lose the comments") as caught:
        with_value(text, "t.yaml", ("a",), RANGES)
    assert WRITTEN in str(caught.value)


def test_an_edit_that_would_change_more_is_refused() -> None:
    with pytest.raises(SpecError, match="neighbors"):
        with_value("a: |\n  yellow\nb: 1\n", "t.yaml", ("a",), RANGES)


@given(st.recursive(
    st.integers(-99, 99) | st.floats(-9, 9).map(lambda x: round(x, 3)) | st.booleans()
    | st.text("abcon yes:#-'\"é,{}[]", max_size=8),
    lambda inner: st.lists(inner, max_size=3)
    | st.dictionaries(st.sampled_from("pqr"), inner, max_size=3),
    max_leaves=8,
))  # fmt: skip
def test_flow_text_is_read_back_unchanged(value: object) -> None:
    assert read_text(f"a: {flow_text(value)}").data == {"a": value}


@pytest.mark.parametrize("name", ["pick_and_track", "experiments/tracking"])
def test_any_scalar_of_a_shipped_tree_can_be_changed_alone(name: str) -> None:
    """Its line is unchanged around it, and all other lines are unchanged."""
    text = find_tree(name).read_text(encoding="utf-8")
    source = read_text(text)
    for path, span in source.values.items():
        if isinstance(source.get(path), (dict, list)):
            continue
        before = text.split("\n")
        after = with_value(text, name, path, "other").split("\n")
        old = before.pop(span.line)
        new = after.pop(span.line)
        assert after == before
        assert new == f"{old[: span.column]}other{old[span.end_column :]}"
