"""A real browser for tests: headless Chromium, controlled by its DevTools protocol."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

_TIMEOUT_S = 60.0


class Tab:
    """An open page.

    Attributes:
        errors: Exceptions on the page, and errors in its log.
        requests: Requested addresses.
    """

    def __init__(self, socket: Any) -> None:  # websockets is found at run time
        self._socket = socket
        self._number = 0
        self.errors: list[str] = []
        self.requests: list[str] = []
        for domain in ("Runtime", "Page", "Network", "Log"):
            self._call(f"{domain}.enable")

    def open(self, url: str) -> None:
        self._call("Page.navigate", url=url)

    def value(self, script: str) -> Any:
        """Value of a JavaScript expression."""
        response = self._call("Runtime.evaluate", expression=script, returnByValue=True)
        assert "exceptionDetails" not in response, response
        return response["result"].get("value")

    def wait(self, script: str, timeout: float = _TIMEOUT_S) -> Any:
        """Value of an expression once it is true, within a timeout in s."""
        until = time.monotonic() + timeout
        while time.monotonic() < until:
            found = self.value(script)
            if found:
                return found
            time.sleep(0.05)  # a browser is another process
        raise AssertionError(f"{script} never came true; {self.value('document.body.innerText')}")

    def hover(self, what: str) -> None:
        """Move the mouse to the center of the first element that matches a selector."""
        box = f"document.querySelector({what!r}).getBoundingClientRect()"
        center = self.value(f"(b => [b.x + b.width / 2, b.y + b.height / 2])({box})")
        self._call("Input.dispatchMouseEvent", type="mouseMoved", x=center[0], y=center[1])

    def picture(self, path: Path) -> None:
        """Write a screenshot of the page as PNG."""
        path.write_bytes(base64.b64decode(self._call("Page.captureScreenshot")["data"]))

    def _call(self, method: str, **parameters: object) -> dict[str, Any]:
        self._number += 1
        command = {"id": self._number, "method": method, "params": parameters}
        self._socket.send(json.dumps(command))
        while True:
            response = json.loads(self._socket.recv(timeout=_TIMEOUT_S))
            if response.get("id") == self._number:
                assert "error" not in response, response
                result: dict[str, Any] = response["result"]
                return result
            self._record(response["method"], response["params"])

    def _record(self, method: str, reported: dict[str, Any]) -> None:
        if method == "Network.requestWillBeSent":
            self.requests.append(reported["request"]["url"])
        elif method == "Runtime.exceptionThrown":
            self.errors.append(str(reported["exceptionDetails"]))
        elif method == "Log.entryAdded" and reported["entry"]["level"] == "error":
            self.errors.append(str(reported["entry"]["text"]))
        elif method == "Runtime.consoleAPICalled" and reported["type"] in ("error", "assert"):
            self.errors.append(str(reported["args"]))


@contextmanager
def chromium(profile: Path) -> Iterator[Tab]:
    """A tab of a separate browser; the test is skipped where there is none."""
    program = shutil.which("chromium") or shutil.which("chromium-browser")
    if program is None:
        pytest.skip("there is no chromium to look at the page with")
    client = pytest.importorskip("websockets.sync.client", reason="no websockets to steer it with")
    command = [program, "--headless", "--no-sandbox", "--use-angle=swiftshader"]
    command += ["--enable-unsafe-swiftshader", "--remote-debugging-port=0", "--disable-gpu-sandbox"]
    command += [f"--user-data-dir={profile}", "--window-size=1400,900", "about:blank"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            response = ""
            while "DevTools listening" not in response:
                response = process.stderr.readline()
                assert response, "chromium ended"
            [port] = re.findall(r"127\.0\.0\.1:(\d+)/", response)
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/json") as answer:
                tabs = [tab for tab in json.load(answer) if tab["type"] == "page"]
            with client.connect(tabs[0]["webSocketDebuggerUrl"], max_size=None) as socket:
                yield Tab(socket)
        finally:
            process.terminate()
            process.wait(20)
