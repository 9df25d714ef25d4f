"""A color is saved where it was read from, and nothing else in the file changes."""

from __future__ import annotations

from pathlib import Path

import pytest

from bt_dualarm.runtime.file_check import check
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.problems import SpecError, errors
from bt_dualarm.spec.values import Color
from bt_dualarm.tuning import AsSnippet, IntoTree, NoColorPortError, SavingError

TREE = """\
# A comment before all.
bt_dualarm: 1
world: {scene: empty}
params:
  target: {type: color, default: red, description: what to follow}  # ours
  word: {type: text, default: red}
subtrees:
  watch:
    params: {what: {type: color, default: red}}
    tree: {track: {color: "{what}", plane: yz}}
arms:
  arm1:
    robot: panda
    posture:   look_out   # spaces kept
    camera: {mount: wrist}
    tree:
%s
"""

SAVED = Color.model_validate([{"hue": (20, 35), "saturation": (0.4, 1), "value": (0.3, 1)}])

HOMES = {
    "written at the leaf": (
        "      track: {color: yellow, plane: yz}  # follow",
        "      track: {color: [{hue: [20, 35], value: [0.3, 1]}], plane: yz}  # follow",
    ),
    "ranges before": (
        "      track:\n        color: [{hue: [1,  2], saturation: [0.5, 1], value: [0.2, 1]}]",
        "      track:\n        color: [{hue: [20,  35], saturation: [0.4, 1], value: [0.3, 1]}]",
    ),
    "not written at all": (
        "      sequence:\n        - wait: 1\n        - track",
        "      sequence:\n        - wait: 1\n"
        "        - {track: {color: [{hue: [20, 35], value: [0.3, 1]}]}}",
    ),
    "a name again": ("      track: {color: orange}", "      track: {color: red}"),
}


@pytest.fixture(scope="module")
def registry() -> Registry:
    return Registry.load()


def write(folder: Path, tree: str) -> Path:
    path = folder / "tree.yaml"
    path.write_text(TREE % tree, encoding="utf-8")
    return path


@pytest.mark.parametrize("name", HOMES)
def test_color_is_saved_at_its_leaf(name: str, tmp_path: Path, registry: Registry) -> None:
    before, after = HOMES[name]
    path = write(tmp_path, before)
    color = Color.named("red") if name == "a name again" else SAVED
    message = IntoTree(path, "arm1", None, registry)(color)
    assert path.read_text(encoding="utf-8") == TREE % after
    assert message.startswith(f"written: {path}:")
    assert errors(check(path, registry.kinds).problems) == ()


def test_color_is_saved_in_its_parameter(tmp_path: Path, registry: Registry) -> None:
    path = write(tmp_path, '      track: {color: "{target}"}')
    before = path.read_text(encoding="utf-8")
    path.chmod(0o640)
    IntoTree(path, "arm1", None, registry)(SAVED)
    changed = before.replace("default: red, desc", f"default: {SAVED.notation}, desc")
    short = changed.replace(" saturation: [0.4, 1],", "")
    assert path.read_text(encoding="utf-8") == short
    assert path.stat().st_mode & 0o777 == 0o640


@pytest.mark.parametrize(
    ("tree", "reason"),
    [
        ('      track: {color: "{word}"}', "the parameter 'word', which is not a color but a text"),
        ("      subtree: {use: watch}", "this color is '{what}', a parameter of the subtree"),
    ],
)
def test_color_without_a_single_location_is_refused(
    tree: str, reason: str, tmp_path: Path, registry: Registry
) -> None:
    path = write(tmp_path, tree)
    before = path.read_bytes()
    with pytest.raises(SpecError) as caught:
        IntoTree(path, "arm1", None, registry)(SAVED)
    assert reason in str(caught.value)
    assert f"{path}:" in str(caught.value)
    assert path.read_bytes() == before


def test_one_of_several_leaves_is_selected_by_its_line(tmp_path: Path, registry: Registry) -> None:
    path = write(tmp_path, "      sequence:\n        - track: {color: red}\n        - track")
    with pytest.raises(NoColorPortError, match=r"(?s)give --line N:\n.*:18:.*:19:"):
        IntoTree(path, "arm1", None, registry)(SAVED)
    with pytest.raises(NoColorPortError, match="no leaf on line 1 looks for"):
        IntoTree(path, "arm1", 1, registry)(SAVED)
    IntoTree(path, "arm1", 19, registry)(SAVED)
    lines = path.read_text(encoding="utf-8").splitlines()
    assert lines[17] == "        - track: {color: red}"
    assert "[20, 35]" in lines[18]


def test_tree_without_a_camera_leaf_is_an_error(tmp_path: Path, registry: Registry) -> None:
    path = write(tmp_path, "      wait: 1")
    with pytest.raises(NoColorPortError, match="no leaf of arm1 looks for a color"):
        IntoTree(path, "arm1", None, registry)(SAVED)


def test_snippet_is_a_valid_port(tmp_path: Path, registry: Registry) -> None:
    """Its line can be pasted into a leaf."""
    path = tmp_path / "color.yaml"
    AsSnippet(path, "photo.png")(SAVED)
    (port,) = (line for line in path.read_text().splitlines() if not line.startswith("#"))
    tree = write(tmp_path, f"      track:\n        {port}")
    assert errors(check(tree, registry.kinds).problems) == ()


def test_unwritable_folder_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(SavingError, match="cannot write"):
        AsSnippet(tmp_path / "nowhere" / "color.yaml", "photo.png")(SAVED)
