"""Names of nodes in other behavior tree libraries lead to ours."""

from __future__ import annotations

from pathlib import Path

import pytest

from bt_dualarm.behaviors.language import LANGUAGE
from bt_dualarm.runtime.file_check import check
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.node_types import NodeType, kind_hint, synonyms_in
from bt_dualarm.spec.problems import suggestion

PAGE = Path(__file__).parents[2] / "docs" / "ticking.md"
SYNONYMS = synonyms_in(LANGUAGE.values())


@pytest.mark.parametrize(
    ("given", "hint"),
    [
        ("fallback", "here it is 'selector'"),
        ("Fallback", "here it is 'selector'"),
        ("ReactiveSequence", "here it is 'reactive_sequence'"),
        ("ReactiveSelector", "here it is 'reactive_fallback'"),
        ("LoopString", "here it is 'for_each', with items"),
        ("RetryUntilSuccessful", "here it is 'retry', with times"),
        ("SubTree", "here it is 'subtree'"),
        ("ForceSuccess", "here it is 'force_success'"),
        ("Inverter", "here it is 'inverter'"),
        ("Timeout", "here it is 'timeout'"),
        ("wait:{seconds", "write a space after the colon: 'wait: {seconds'"),
        ("inverte", "did you mean 'inverter'? (load your own skills with --skills DIR)"),
    ],
)
def test_hint_for_a_synonym(given: str, hint: str) -> None:
    assert kind_hint(given, LANGUAGE) == hint


def test_the_hint_for_an_unknown_name_has_all_names_and_the_option_for_skills() -> None:
    hint = kind_hint("frobnicate", {name: NodeType(name, "") for name in ("go", "look")})
    assert hint == "available: go, look (load your own skills with --skills DIR)"


def test_every_synonym_leads_to_a_node_type_and_none_is_one() -> None:
    assert {meant.partition(",")[0] for meant in SYNONYMS.values()} <= LANGUAGE.keys()
    assert not {name.lower() for name in SYNONYMS} & {word.replace("_", "") for word in LANGUAGE}


def test_the_documentation_has_every_synonym() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert [name for name in SYNONYMS if f"`{name}`" not in page] == []


@pytest.mark.parametrize(
    ("pose", "meant"),
    [
        ("{relative_to: cube, xyz: [0, 0, 0.1]}", "in_frame"),
        ("{frame_id: base, xyz: [0.4, 0, 0.1]}", "in_frame"),
        ("{parent: cube}", "in_frame"),
        ("{over: cube, by: 0.1}", "above"),
        ("{onto: cube}", "on"),
        ("{next_to: cube}", "beside"),
    ],
)
def test_words_of_other_systems_for_a_relative_pose_lead_to_ours(pose: str, meant: str) -> None:
    """They were taken for a pose in the world, whose fields were listed."""
    tree = f"""
bt_dualarm: 1
world: {{scene: empty}}
objects:
  cube: {{shape: box, size: [0.05, 0.05, 0.05], mass: 0.1, pose: {{xyz: [0.5, 0, 0.025]}}}}
arms: {{arm1: {{robot: panda, tree: {{reach_to_pose: {{to: {pose}}}}}}}}}
"""
    [problem] = check(tree, Registry.load().kinds).problems
    assert problem.hint == f"here it is '{meant}'"


@pytest.mark.parametrize(
    ("given", "valid", "hint"),
    [
        ("gravity", ("scene", "reality"), "it is always 9.81 m/s² downward"),
        ("elif", ("condition", "then", "else"), "here it is 'else'"),
        ("do", ("condition", "then", "else"), "here it is 'then'"),
        ("do", ("condition", "child"), "here it is 'child'"),
    ],
)
def test_what_other_formats_have_leads_to_what_there_is(
    given: str, valid: tuple[str, ...], hint: str
) -> None:
    """`gravity` was taken for `reality`."""
    assert suggestion(given, valid, "field").startswith(hint)
