"""Requests of a browser to the server of the tuning page."""

from __future__ import annotations

import http.client
import json
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from bt_dualarm.spec.values import Color
from bt_dualarm.tuning import HOST, AsSnippet, PageError, Shot, Tuning, page_server, still
from tests.tuning.test_look import two_squares


class Browser:
    """Sends requests to one server."""

    def __init__(self, port: int) -> None:
        self.port = port

    def request(
        self, method: str, path: str, body: bytes = b"", kind: str = "", host: str = HOST
    ) -> tuple[int, str, bytes]:
        """Send a request; returns status, type and content of the response."""
        connection = http.client.HTTPConnection(HOST, self.port, timeout=30)
        headers = {"Host": f"{host}:{self.port}", "Content-Type": kind}
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        content = answer.read()
        connection.close()
        return answer.status, answer.headers.get_content_type(), content

    def post(self, path: str, data: object) -> tuple[int, Any]:
        body = json.dumps(data).encode()
        status, _, content = self.request("POST", path, body, "application/json")
        return status, json.loads(content)


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    return tmp_path / "color.yaml"


@pytest.fixture
def browser(saved: Path) -> Iterator[Browser]:
    shot = Shot(still(two_squares()), "two squares")
    tuning = Tuning(shot, Color.named("blue"), AsSnippet(saved, shot.what))
    with page_server(tuning) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        yield Browser(server.server_address[1])
        server.shutdown()
        thread.join()


def test_page_and_image_are_served(browser: Browser) -> None:
    """The page loads nothing from other servers."""
    status, kind, page = browser.request("GET", "/")
    assert (status, kind) == (200, "text/html")
    assert b"http://" not in page
    assert b"https://" not in page
    status, kind, png = browser.request("GET", "/image.png")
    assert (status, kind) == (200, "image/png")
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    assert (cv2.cvtColor(image, cv2.COLOR_BGR2RGB) == two_squares()).all()


def test_clicked_color_is_saved(browser: Browser, saved: Path) -> None:
    """Blue finds nothing; a click on a yellow square finds both, and this color is saved."""
    status, begin = browser.post("/begin", {})
    assert (status, begin["found"], begin["can_save"]) == (200, [], True)
    click = {"color": begin["color"], "at": [30, 30], "range": 0, "widen": False}
    status, seen = browser.post("/click", click)
    assert status == 200
    assert [one["centroid_px"] for one in seen["found"]] == [[30.0, 30.0], [65.0, 15.0]]
    assert seen["mask"].startswith("data:image/png;base64,")
    status, reply = browser.post("/save", {"color": seen["color"]})
    assert (status, reply) == (200, {"message": f"written: {saved}"})
    assert f"color: {seen['notation']}\n" in saved.read_text(encoding="utf-8")


def test_widening_click_extends_the_range(browser: Browser) -> None:
    _, begin = browser.post("/begin", {})
    click = {"color": begin["color"], "at": [30, 30], "range": 0, "widen": True}
    _, seen = browser.post("/click", click)
    ((low, high),) = (one["hue"] for one in seen["color"])
    assert low == begin["color"][0]["hue"][0]
    assert 54 <= high < low, "from blue to yellow, the arc through red is the shorter one"


def test_slider_values_are_applied(browser: Browser) -> None:
    _, seen = browser.post("/look", {"color": [{"hue": [42, 70]}]})
    assert seen["color"] == [{"hue": [42, 70], "saturation": [0.4, 1], "value": [0.2, 1]}]
    assert len(seen["found"]) == 2


@pytest.mark.parametrize(
    ("path", "content", "message"),
    [
        ("/look", {"color": [{"hue": [1, 999]}]}, "hue: must be at most 360 deg, not 999"),
        ("/look", {"color": [{"hue": [1, 2], "value": [1, 0]}]}, "swap the two"),
        ("/look", [], "color"),
        ("/click", {"color": "red", "at": [80, 0], "range": 0, "widen": False}, "outside"),
        ("/click", {"color": "red", "at": [8, 0], "range": 1, "widen": True}, "a click needs"),
        ("/click", {"color": "red", "at": "x", "range": 0, "widen": True}, "a click needs"),
    ],
)
def test_invalid_request_is_refused_with_a_reason(
    browser: Browser, path: str, content: object, message: str
) -> None:
    status, reply = browser.post(path, content)
    assert status == 400
    assert message in reply["error"]


def test_requests_of_other_sites_are_refused(browser: Browser, saved: Path) -> None:
    """Another site can neither send JSON without a preflight nor use its own host name."""
    body = json.dumps({"color": "red"}).encode()
    assert browser.request("POST", "/save", body, "text/plain")[0] == 403
    assert browser.request("POST", "/save", body)[0] == 403
    foreign = "evil.example"
    assert browser.request("POST", "/save", body, "application/json", foreign)[0] == 403
    assert browser.request("GET", "/", host=foreign)[0] == 403
    assert browser.request("GET", "/../saving.py")[0] == 404
    assert browser.request("POST", "/nothing", body, "application/json")[0] == 404
    assert not saved.exists()


def test_occupied_port_is_an_error() -> None:
    tuning = Tuning(Shot(still(two_squares()), "two"), Color.named("red"), None)
    with page_server(tuning) as server, pytest.raises(PageError, match="cannot serve on port"):
        page_server(tuning, server.server_address[1])


def test_exception_is_logged_but_not_printed(
    browser: Browser,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The connection is closed without a response, and the next request is served."""

    def broken(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(Tuning, "_seen", broken)
    with pytest.raises(http.client.RemoteDisconnected):
        browser.post("/begin", {})
    assert "ZeroDivisionError" in caplog.text
    assert capsys.readouterr() == ("", "")
    assert browser.request("GET", "/")[0] == 200
