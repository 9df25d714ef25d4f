"""The tuning server responds to any request, and writes only the color."""

from __future__ import annotations

import json
import logging
import math
import socket
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.values import Color
from bt_dualarm.tuning import HOST, IntoTree, Shot, Tuning, _Handler, still
from tests.tuning.test_look import two_squares
from tests.tuning.test_page import Browser, browser, saved
from tests.tuning.test_saving import HOMES, TREE

__all__ = ["browser", "saved"]

ANY_TEXT = st.text(st.characters(codec=None), max_size=5)
NUMBERS = st.integers() | st.floats() | st.sampled_from([1e400, -1e400, math.nan])
WORDS = st.sampled_from(["color", "hue", "saturation", "value", "at", "range", "widen", "yellow"])
ANYTHING: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | NUMBERS | WORDS | ANY_TEXT,
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(WORDS | ANY_TEXT, inner, max_size=4)
    ),
    max_leaves=8,
)
"""Any JSON value that Python can write, including infinite numbers and lone surrogates."""

REQUESTS = ANYTHING | st.fixed_dictionaries(
    {
        "color": st.just([{"hue": [10, 50]}]) | st.lists(ANYTHING, max_size=2) | ANYTHING,
        "at": st.lists(NUMBERS, min_size=2, max_size=2) | ANYTHING,
        "range": st.just(0) | ANYTHING,
        "widen": st.booleans() | ANYTHING,
    }
)


@given(data=REQUESTS, path=st.sampled_from(["/begin", "/look", "/click"]))
@settings(max_examples=250, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_every_request_gets_a_response(
    browser: Browser, caplog: pytest.LogCaptureFixture, data: object, path: str
) -> None:
    """The response is a result or an error in strict JSON, without a traceback in the log."""
    with caplog.at_level(logging.ERROR):
        status, kind, content = browser.request(
            "POST", path, json.dumps(data).encode(), "application/json"
        )
    assert (status in (200, 400), kind) == (True, "application/json")
    answer = json.loads(content, parse_constant=pytest.fail)
    assert status == 200 or answer["error"]
    assert caplog.text == ""


@pytest.mark.parametrize(
    "body",
    [b"", b"{", b"1" * 5000, b"[" * 60_000, b"\xff", b'"\\ud800"', b'{"color": 1e400}', b"NaN"],
    ids=lambda body: body[:16].decode("latin-1"),
)
def test_invalid_json_is_refused(browser: Browser, body: bytes) -> None:
    status, _, content = browser.request("POST", "/look", body, "application/json")
    reply = json.loads(content)["error"]
    assert (status, reply) == (400, "a request must be JSON with finite numbers and valid text")


@pytest.mark.parametrize("length", ["", "-1", "1e3", "65537", "9" * 5000, "٣"])
def test_invalid_content_length_is_refused(browser: Browser, length: str) -> None:
    lines = (
        "POST /look HTTP/1.1",
        f"Host: {HOST}:{browser.port}",
        "Content-Type: application/json",
        f"Content-Length: {length}",
    )
    with socket.create_connection((HOST, browser.port), timeout=30) as connection:
        connection.sendall("\r\n".join((*lines, "", "{}")).encode())
        assert connection.recv(100).startswith(b"HTTP/1.0 400")


def test_stalled_request_times_out(browser: Browser, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten bytes are announced and three arrive: the connection is closed after the timeout."""
    monkeypatch.setattr(_Handler, "timeout", 0.2)
    head = f"POST /look HTTP/1.1\r\nHost: {HOST}:{browser.port}\r\n"
    head += "Content-Type: application/json\r\nContent-Length: 10\r\n\r\nabc"
    with socket.create_connection((HOST, browser.port), timeout=30) as connection:
        connection.sendall(head.encode())
        assert connection.recv(100) == b""


def test_concurrent_saves_all_succeed(tmp_path: Path) -> None:
    """As from two windows: each is written, and the final file is one of them, complete."""
    registry = Registry.load()
    path = tmp_path / "tree.yaml"
    path.write_text(TREE % HOMES["written at the leaf"][0], encoding="utf-8")
    shot = Shot(still(two_squares()), "two squares")
    tuning = Tuning(shot, Color.named("blue"), IntoTree(path, "arm1", None, registry))

    def save(hue: int) -> str:
        return str(tuning.save({"color": [{"hue": [hue, hue + 10]}]})["message"])

    with ThreadPoolExecutor(8) as pool:
        replies = list(pool.map(save, range(16)))
    assert {reply.rpartition(":")[0].partition(":")[0] for reply in replies} == {"written"}
    tree = load_tree_file(path, registry.kinds).arms["arm1"].tree
    (color,) = tree.ports["color"]
    assert color["hue"][0] in range(16)
    assert [found.name for found in tmp_path.iterdir()] == [path.name]
