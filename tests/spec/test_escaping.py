"""Untrusted text: it cannot control a terminal, and JSON keeps its meaning."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_dualarm.spec.node_types import escaped


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain é 你好 → 😀", "plain é 你好 → 😀"),
        ("\x1b[2J", "\\u001b[2J"),
        ("\x9b1m\x7f", "\\u009b1m\\u007f"),
        ("a\u202eb\u200f", "a\\u202eb\\u200f"),
        ("a\r\nb\tc", "a\\u000d\nb\tc"),
        ("a\u2028b", "a\\u2028b"),
        ("\U000e0041", "\\udb40\\udc41"),
    ],
)
def test_control_characters_are_escaped(text: str, shown: str) -> None:
    assert escaped(text) == shown


@given(st.text())
def test_escaped_json_has_the_same_meaning(text: str) -> None:
    plain = json.dumps(text, ensure_ascii=False)
    assert json.loads(escaped(plain)) == text
