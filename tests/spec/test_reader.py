"""Strict YAML: positions of all values, size limits, and no exception but SpecError."""

from __future__ import annotations

import contextlib
import json
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_dualarm.spec.problems import SpecError
from bt_dualarm.spec.yaml_reader import (
    MAX_BYTES,
    MAX_DEPTH,
    MAX_NODES,
    read_file,
    read_mapping,
    read_text,
)


def complaints(text: str) -> list[str]:
    with pytest.raises(SpecError) as caught:
        read_text(text, "f")
    return [f"{p.place.line}:{p.place.column}: {p.message}" for p in caught.value.problems]


def test_data_and_positions() -> None:
    source = read_text("a: 1\nb:\n  - {c: 'x y', d: [2, 3]}\n", "f")
    assert source.data == {"a": 1, "b": [{"c": "x y", "d": [2, 3]}]}
    assert str(source.location(("a",))) == "f:1:4"
    assert str(source.key_location(("b", 0, "d"))) == "f:3:16"
    assert str(source.location(("b", 0, "d", 1))) == "f:3:23"
    assert source.location(("b", 0, "c")).width == len("'x y'")
    assert str(source.location(("b", 0, "d", 7))) == "f:3:19"


def test_block_text_and_quotes_are_text() -> None:
    source = read_text("a: |\n  yes\nb: \"1e3\"\nc: 'no'\nd: >-\n  x\n  y\n")
    assert source.data == {"a": "yes\n", "b": "1e3", "c": "no", "d": "x y"}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a: &x 1", ["1:4: anchor '&x' is not allowed"]),
        ("a: *x", ["1:4: alias '*x' is not allowed"]),
        ("a: !!int 1", ["1:4: tag 'tag:yaml.org,2002:int' is not allowed"]),
        ("a: ! 1", ["1:4: tag '!' is not allowed"]),
        ("a: {<<: {b: 1}}", ["1:5: merge key '<<' is not allowed"]),
        ("a: 1\nb: 2\na: 3", ["3:1: key 'a' is given twice"]),
        ("1: a", ["1:1: key '1' is not text"]),
        ("true: a", ["1:1: key 'true' is not text"]),
        ("? [a]\n: b", ["1:3: a key that is not text"]),
        ("? {a: b}\n: b", ["1:3: a key that is not text"]),
        ("!x a: b", ["1:1: an anchor or tag on a key is not allowed"]),
        ("%YAML 1.1\n---\na: 1", ["1:1: a YAML directive is not allowed"]),
        ("a: 1\n---\nb: 1", ["2:1: a second document in one file is not allowed"]),
        ("", ["0:0: is empty"]),
        ("# nothing\n", ["0:0: is empty"]),
        ("a: yes\nb: 1:30", [
            "1:4: 'yes' is a truth value to some YAML readers and text to others",
            "2:4: '1:30' is 90 to some YAML readers and text to others",
        ]),
    ],
)  # fmt: skip
def test_unsupported_and_ambiguous_yaml_is_refused(text: str, expected: list[str]) -> None:
    assert complaints(text) == expected


def test_on_and_no_are_text_as_keys() -> None:
    assert read_text("on: 1\nno: 2\n").data == {"on": 1, "no": 2}


@pytest.mark.parametrize(
    "text", ["a: [1", "a: b: c", "\ta: 1", "a: 'x", "a: @x", "- a\nb: 1", "a: \x07", 'a: "\\q"']
)
def test_syntax_errors_have_a_position(text: str) -> None:
    """Line and column are within the text."""
    with pytest.raises(SpecError) as caught:
        read_text(text)
    (problem,) = caught.value.problems
    assert problem.message.startswith("not YAML: ")
    assert 1 <= problem.place.line <= text.count("\n") + 2
    assert problem.place.column >= 1


CONTROL = [*range(0x09), *range(0x0B, 0x20), *range(0x7F, 0xA0), 0x202E, 0x2066]
"""Characters that control a terminal, or that change the direction of writing."""


@pytest.mark.parametrize("code", CONTROL, ids=hex)
@pytest.mark.parametrize("text", ['a: "x{}"', '"x{}": 1', 'a: [1, {{b: "{}"}}]'])
def test_control_characters_are_refused(code: int, text: str) -> None:
    (message,) = complaints(text.format(f"\\u{code:04x}"))
    assert f"the control character U+{code:04X}" in message
    assert message.isprintable()
    with pytest.raises(SpecError, match="control character"):
        read_mapping({"a": chr(code)})


@pytest.mark.parametrize("text", ["a\tb", "a\nb", "é", "→", "👩\u200d🔧", "עברית"])
def test_ordinary_characters_are_accepted(text: str) -> None:
    assert read_mapping({"a": text}).data == {"a": text}
    assert read_text(f"a: {json.dumps(text, ensure_ascii=False)}").data == {"a": text}


def test_size_limits() -> None:
    assert complaints("[" * (MAX_DEPTH + 1))[0].endswith("nested deeper than 64 levels")
    assert read_text("[" * MAX_DEPTH + "]" * MAX_DEPTH).data
    many = "[" + "1," * MAX_NODES + "]"
    assert complaints(many)[0].endswith("more than 10000 values in one file")
    assert complaints("[" + "yes, " * 500 + "]")[-1].startswith("1:497")


def test_unreadable_files_are_refused(tmp_path: Path) -> None:
    cases = {
        tmp_path / "missing.yaml": "no such file",
        tmp_path: "is not a regular file",
        tmp_path / "nul\0.yaml": "no such file",
    }
    big = tmp_path / "big.yaml"
    latin = tmp_path / "latin.yaml"
    fifo = tmp_path / "fifo.yaml"
    big.write_text("a: " + "x" * MAX_BYTES)
    latin.write_bytes(b"a: \xe9\n")
    os.mkfifo(fifo)
    cases |= {
        big: "is larger than 256 KiB",
        latin: "is not UTF-8 text: byte 3 is 0xe9",
        fifo: "is not a regular file",
    }
    for path, message in cases.items():
        with pytest.raises(SpecError, match=message):
            read_file(path)


def test_byte_order_mark_and_windows_line_ends(tmp_path: Path) -> None:
    file = tmp_path / "windows.yaml"
    file.write_bytes("\ufeffa: 1\r\nb: ö\r\n".encode())
    source = read_file(file)
    assert source.data == {"a": 1, "b": "ö"}
    assert str(source.location(("b",))).endswith(":2:4")


PIECES = [
    *("a: ", "- ", "[", "]", "{", "}", "\n", "  ", ", ", "? ", ": ", "&x ", "*x", "!t ", "<<"),
    *("'", '"', "|", ">", "#", "%", "@", "1:30", "yes", "\\u", "\0", "\t", "---", "...", "\ud7ff"),
    *("\x85", "\u2028", "é", "1e999", "0x_"),
]


@given(st.lists(st.sampled_from(PIECES), max_size=40).map("".join) | st.text(max_size=60))
def test_any_text_gives_data_or_a_spec_error(text: str) -> None:
    """Formatting the message of a SpecError raises nothing either."""
    with contextlib.suppress(SpecError):
        read_text(text)
