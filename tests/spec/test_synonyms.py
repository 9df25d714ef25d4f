"""Names of nodes in other behavior tree libraries lead to ours."""

from __future__ import annotations

from pathlib import Path

import pytest

from bt_dualarm.behaviors.language import LANGUAGE
from bt_dualarm.spec.node_types import NodeType, kind_hint, synonyms_in

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
