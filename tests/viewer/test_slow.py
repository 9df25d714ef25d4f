"""Slow or silent clients do not block others."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from threading import active_count

import numpy as np
import pytest

from bt_dualarm.spec.yaml_reader import Json
from bt_dualarm.viewer import server as server_module
from bt_dualarm.viewer.server import MOST_CONNECTIONS, Asked, PageAnswer, Served
from tests.viewer.browsers import Browser

SLOW = 200
LARGE = b"x" * 20_000_000


class Fake:
    """A source of the server with a small answer, a large one, and one that raises."""

    @property
    def questions(self) -> Mapping[str, Asked]:
        def broken(_: object) -> PageAnswer:
            raise RuntimeError("a bug")

        return {
            "now": lambda _: PageAnswer.of({"kind": "fake"}),
            "large": lambda _: PageAnswer.numbers(LARGE),
            "broken": broken,
        }

    def do(self, asked: Json) -> Json:
        return asked


@pytest.fixture
def browser() -> Iterator[Browser]:
    served = Served(Fake())
    served.begin()
    try:
        yield Browser(served.url)
    finally:
        served.end()


def partial_requests(browser: Browser) -> Mapping[str, bytes]:
    """Data that a slow client sends before it stalls."""
    address = browser.place
    head = f"Host: 127.0.0.1:{address.port}\r\n".encode()
    post = f"POST {address.path}do HTTP/1.1\r\n".encode() + head
    return {
        "nothing": b"",
        "half a request line": b"GET /",
        "half a head": f"GET {address.path}now HTTP/1.1\r\n".encode() + head,
        "half a body": post + b"Content-Type: application/json\r\nContent-Length: 99\r\n\r\n{",
        "takes nothing": f"GET {address.path}large HTTP/1.1\r\n".encode() + head + b"\r\n",
    }


@pytest.mark.parametrize(
    "how", ["nothing", "half a request line", "half a head", "half a body", "takes nothing"]
)
def test_slow_clients_do_not_block_others(browser: Browser, how: str) -> None:
    """With 200 of them, 20 requests are answered within a second (median), by a few threads."""
    threads = active_count()
    with ExitStack() as stack:
        for _ in range(SLOW):
            slow = socket.create_connection(("127.0.0.1", browser.place.port or 0), timeout=10)
            stack.enter_context(slow)
            slow.sendall(partial_requests(browser)[how])
        browser.now()  # earlier connections have been accepted by now
        took = []
        for _ in range(20):
            start = time.monotonic()
            assert browser.now() == {"kind": "fake"}
            browser.press("go")
            took.append(time.monotonic() - start)
        assert np.median(took) < 1.0
        assert active_count() - threads <= 8


def test_oldest_silent_connection_is_closed_at_the_limit(browser: Browser) -> None:
    with ExitStack() as stack:
        silent = []
        for _ in range(MOST_CONNECTIONS + 20):
            one = socket.create_connection(("127.0.0.1", browser.place.port or 0), timeout=10)
            silent.append(stack.enter_context(one))
            assert len(silent) % 50 or browser.now()["kind"] == "fake"
        assert browser.now()["kind"] == "fake"
        assert silent[0].recv(1) == b""
        silent[-1].setblocking(False)
        with pytest.raises(BlockingIOError):
            silent[-1].recv(1)


def test_slow_clients_time_out(browser: Browser, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server_module, "TIMEOUT_S", 0.2)
    for how, begun in partial_requests(browser).items():
        with socket.create_connection(("127.0.0.1", browser.place.port or 0), timeout=10) as slow:
            slow.sendall(begun)
            if how == "takes nothing":
                browser.now()
            try:
                while slow.recv(1 << 16):
                    pass
            except ConnectionResetError:
                pass
    assert browser.now()["kind"] == "fake"


def test_end_of_the_server_closes_open_connections(caplog: pytest.LogCaptureFixture) -> None:
    """Without a traceback."""
    served = Served(Fake())
    served.begin()
    browser = Browser(served.url)
    with ExitStack() as stack:
        for begun in partial_requests(browser).values():
            slow = socket.create_connection(("127.0.0.1", browser.place.port or 0), timeout=10)
            stack.enter_context(slow)
            slow.sendall(begun)
        assert browser.now()["kind"] == "fake"
        served.end()
        assert slow.recv(1 << 20), "data sent until then"
    assert caplog.text == ""
    with pytest.raises(ConnectionRefusedError):
        browser.now()


def test_exception_is_logged_but_not_served(
    browser: Browser, caplog: pytest.LogCaptureFixture
) -> None:
    assert browser.ask("broken") == (500, b"nothing is served here")
    assert "a bug" in caplog.text
    assert browser.now()["kind"] == "fake"


@pytest.mark.parametrize(
    "head",
    [
        b"\r\n\r\n",
        b"GET\r\n\r\n",
        b"GET  HTTP/1.1\r\n\r\n",
        b"GET /\xff\xfe HTTP/1.1\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 200 + b"\r\n",
        b"GET / HTTP/1.1\r\nX: " + b"y" * 100_000 + b"\r\n\r\n",
        b"\x16\x03\x01" + b"\x00" * 200 + b"\r\n\r\n",
    ],
)
def test_invalid_http_is_refused(browser: Browser, head: bytes) -> None:
    with socket.create_connection(("127.0.0.1", browser.place.port or 0), timeout=10) as one:
        one.sendall(head)
        reply = one.recv(1000)
    assert reply.startswith((b"HTTP/1.1 400 ", b"HTTP/1.1 403 "))


def test_ambiguous_request_is_refused(browser: Browser) -> None:
    """With two hosts, two lengths, a chunked body, or another origin."""
    address = browser.place
    line = f"POST {address.path}do HTTP/1.1\r\n"
    host = f"Host: 127.0.0.1:{address.port}\r\n"
    kind = "Content-Type: application/json\r\n"
    body = json.dumps({"action": "go"})
    length = f"Content-Length: {len(body)}\r\n"
    good = line + host + kind + length
    for head, status in (
        (good, b"200"),
        (good + host, b"403"),
        (good + "Content-Length: 3\r\n", b"403"),
        (good + "Origin: http://127.0.0.1\r\n", b"403"),
        (line + host + kind + "Transfer-Encoding: chunked\r\n", b"403"),
        (line + host + kind, b"400"),
    ):
        with socket.create_connection(("127.0.0.1", address.port or 0), timeout=10) as one:
            one.sendall(f"{head}\r\n{body}".encode())
            assert one.recv(1000).split(b" ")[1] == status, head
