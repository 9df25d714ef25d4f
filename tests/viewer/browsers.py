"""A test client of the viewer: sends requests like the page does, or invalid ones."""

from __future__ import annotations

import http.client
import json
import time
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit


class Browser:
    """Sends requests of the page to a server.

    Args:
        url: Address of the page.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self.place = urlsplit(url)

    def ask(
        self, what: str, body: object = None, *, token: bool = True, **headers: str
    ) -> tuple[int, bytes]:
        connection = http.client.HTTPConnection("127.0.0.1", self.place.port or 0, timeout=10)
        path = f"{self.place.path}{what}" if token else f"/{what}"
        content = None if body is None else body if isinstance(body, bytes) else json.dumps(body)
        kind = {} if body is None else {"Content-Type": "application/json"}
        given = {name.replace("_", "-"): value for name, value in headers.items()}
        method = "GET" if body is None else "POST"
        try:
            connection.request(method, path, content, kind | given)
            answer = connection.getresponse()
            return answer.status, answer.read()
        finally:
            connection.close()

    def fetch(self, what: str) -> Any:
        """Response in JSON."""
        status, content = self.ask(what)
        assert status == 200, content
        return json.loads(content)

    def now(self) -> dict[str, Any]:
        found: dict[str, Any] = self.fetch("now")
        return found

    def press(self, action: str, value: object = None) -> None:
        status, content = self.ask("do", {"action": action, "value": value})
        assert status == 200, content

    def until(self, what: str, is_so: Callable[[Any], bool]) -> Any:
        """Response once it satisfies a condition."""
        for _ in range(600):
            found = self.fetch(what)
            if is_so(found):
                return found
            time.sleep(0.05)  # another process watches the file
        raise AssertionError(f"{what} never met the condition: {found}")

    def held(self) -> dict[str, Any]:
        """State of the run once it is held."""
        for _ in range(500):
            found = self.now()
            if found["held"] and found["paused"]:
                return found
            time.sleep(0.01)  # the run continues in another thread
        raise AssertionError("the run is not held")
