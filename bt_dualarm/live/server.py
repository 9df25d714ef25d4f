"""Who may ask for what: a page on the loopback address, with a token, from nobody else's page."""

from __future__ import annotations

import json
import logging
import secrets
import sys
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from socket import socket
from socketserver import BaseServer
from threading import BoundedSemaphore
from typing import Any, Final, Protocol

from bt_dualarm.errors import DualArmError
from bt_dualarm.spec.source import Json

HOST: Final = "127.0.0.1"
_LARGEST_BODY: Final = 20_000
_DIGITS: Final = len(str(_LARGEST_BODY))
_PATIENCE_S: Final = 10.0
_MOST_AT_ONCE: Final = 16
"""Requests that are answered at a time; more are sent away."""

_log = logging.getLogger(__name__)


class ViewError(DualArmError):
    """The page cannot be served, or was asked for something that it does not understand."""


class Answers(Protocol):
    """What is behind the page."""

    def page(self) -> str:
        """The page, in HTML."""

    def scene(self) -> Json:
        """Shapes and meshes."""

    def now(self) -> Json:
        """The run as it stands."""

    def do(self, asked: Json) -> Json:
        """Press a button.

        Raises:
            DualArmError: There is no such button.
        """


class ViewServer(ThreadingHTTPServer):
    """Serves one page at an address that only its user knows.

    Args:
        answers: What is behind the page.
        port: Number of the port; 0 takes any that is free.

    Attributes:
        url: Address of the page, with its token.

    Raises:
        ViewError: The port is taken, or not allowed.
    """

    daemon_threads = True

    def __init__(self, answers: Answers, port: int = 0) -> None:
        self.token = secrets.token_urlsafe(16)
        self._slots = BoundedSemaphore(_MOST_AT_ONCE)
        try:
            super().__init__((HOST, port), partial(_Handler, answers, self.token))
        except (OSError, OverflowError) as error:
            raise ViewError(f"cannot serve on port {port}: {error}") from error
        self.url = f"http://{HOST}:{self.server_address[1]}/{self.token}/"

    def process_request(self, request: Any, client_address: Any) -> None:  # its parent's types
        """Answer in a thread, as long as there are not too many."""
        if not self._slots.acquire(blocking=False):
            self.shutdown_request(request)
            return
        super().process_request(request, client_address)

    def process_request_thread(self, request: Any, client_address: Any) -> None:  # as above
        """Answer, then make room for another one."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._slots.release()

    def handle_error(self, request: object, client_address: object) -> None:  # noqa: ARG002 - its parent's
        """A browser that has gone is nothing to tell; the rest is a bug."""
        level = logging.DEBUG if isinstance(sys.exception(), ConnectionError) else logging.ERROR
        _log.log(level, "a request for the view failed", exc_info=True)


class _Handler(BaseHTTPRequestHandler):
    timeout = _PATIENCE_S  # of the socket, which the parent sets

    def __init__(
        self,
        answers: Answers,
        token: str,
        request: socket,
        client_address: tuple[str, int],
        server: BaseServer,
    ) -> None:
        self._answers, self._token = answers, token
        super().__init__(request, client_address, server)

    def do_GET(self) -> None:
        """The page, the scene, the run as it stands."""
        asked = self._allowed()
        if asked == "":
            self._answer("text/html; charset=utf-8", self._answers.page().encode())
        elif asked in ("scene", "now"):
            facts = self._answers.scene() if asked == "scene" else self._answers.now()
            self._answer("application/json", json.dumps(facts, allow_nan=False).encode())
        else:
            self._refuse(HTTPStatus.FORBIDDEN)

    def do_POST(self) -> None:
        """Press a button."""
        if self._allowed() != "do" or self.headers.get_content_type() != "application/json":
            self._refuse(HTTPStatus.FORBIDDEN)
            return
        try:
            done = self._answers.do(self._asked())
        except DualArmError as error:
            self._answer("text/plain; charset=utf-8", str(error).encode(), HTTPStatus.BAD_REQUEST)
            return
        self._answer("application/json", json.dumps(done, allow_nan=False).encode())

    def _allowed(self) -> str | None:
        """What below the token is asked for; None for whoever is not to ask at all."""
        host = self.headers.get("Host", "")
        origin = self.headers.get("Origin")
        if not isinstance(self.server, ViewServer):
            return None
        port = self.server.server_port
        if host not in (f"{HOST}:{port}", f"localhost:{port}"):
            return None
        if origin is not None and origin != f"http://{host}":
            return None
        token, _, asked = self.path.removeprefix("/").partition("/")
        if not secrets.compare_digest(token.encode(), self._token.encode()):
            return None
        return asked

    def _asked(self) -> Json:
        """The request's content.

        Raises:
            ViewError: It is none, or too long.
        """
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal() or len(length) > _DIGITS or int(length) > _LARGEST_BODY:
            raise ViewError("a request has a length, and a short one")
        try:
            asked = json.loads(self.rfile.read(int(length)))
        except (ValueError, RecursionError):
            raise ViewError("a request is JSON") from None
        if not isinstance(asked, dict):
            raise ViewError("a request is an object")
        return asked

    def _refuse(self, status: HTTPStatus) -> None:
        self._answer("text/plain; charset=utf-8", b"nothing is served here", status)

    def _answer(self, kind: str, content: bytes, status: HTTPStatus = HTTPStatus.OK) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *values: object) -> None:  # noqa: A002 - its parent's name
        """Nothing is said on the terminal."""
        _log.debug(format, *values)
