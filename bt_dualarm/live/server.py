"""Who may ask for what: pages of this server, with its token, and nobody else's."""

from __future__ import annotations

import ipaddress
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
from typing import Any, Final
from urllib.parse import parse_qsl

from bt_dualarm.errors import DualArmError
from bt_dualarm.live.answers import Answer, Answers, ViewError
from bt_dualarm.spec.source import Json

HOST: Final = "127.0.0.1"
_LARGEST_BODY: Final = 20_000
_DIGITS: Final = len(str(_LARGEST_BODY))
_PATIENCE_S: Final = 10.0
_MOST_FIELDS: Final = 4
_MOST_AT_ONCE: Final = 16
"""Requests that are answered at a time; more are sent away."""

_TEXT: Final = "text/plain; charset=utf-8"

_log = logging.getLogger(__name__)


class ViewServer(ThreadingHTTPServer):
    """Serves one page at an address that only its user knows.

    Args:
        answers: What is behind the page.
        port: Number of the port; 0 takes any that is free.
        host: Address of one interface of this machine; pages name it, or they get nothing.

    Attributes:
        url: Address of the page, with its token.
        hosts: What a browser may call this server.

    Raises:
        ViewError: The port is taken, or not allowed; the address is none of this machine's.
    """

    daemon_threads = True

    def __init__(self, answers: Answers, port: int = 0, host: str = HOST) -> None:
        self.token = secrets.token_urlsafe(16)
        self._slots = BoundedSemaphore(_MOST_AT_ONCE)
        try:
            super().__init__((_interface(host), port), partial(_Handler, answers, self.token))
        except (OSError, OverflowError) as error:
            raise ViewError(f"cannot serve on {host}, port {port}: {error}") from error
        place = self.server_address[1]
        names = (host, "localhost") if host == HOST else (host,)
        self.hosts = frozenset(f"{name}:{place}" for name in names)
        self.url = f"http://{host}:{place}/{self.token}/"

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
        """Whatever the view answers to."""
        what, _, query = self._allowed() or ("?", "", "")
        question = self._answers.questions.get(what)
        if question is None:
            self._refuse(HTTPStatus.FORBIDDEN)
            return
        try:
            self._answer(question(_fields(query)))
        except DualArmError as error:
            self._complain(error)

    def do_POST(self) -> None:
        """Press a button."""
        allowed = self._allowed()
        is_json = self.headers.get_content_type() == "application/json"
        if allowed is None or allowed[0] != "do" or not is_json:
            self._refuse(HTTPStatus.FORBIDDEN)
            return
        try:
            done = self._answers.do(self._asked())
        except DualArmError as error:
            self._complain(error)
            return
        self._answer(Answer.of(done))

    def _allowed(self) -> tuple[str, str, str] | None:
        """What below the token is asked for, and its query; None for whoever is not to ask."""
        host = self.headers.get("Host", "")
        origin = self.headers.get("Origin")
        if not isinstance(self.server, ViewServer):
            return None
        if host not in self.server.hosts:
            return None
        if origin is not None and origin != f"http://{host}":
            return None
        token, _, asked = self.path.removeprefix("/").partition("/")
        if not secrets.compare_digest(token.encode(), self._token.encode()):
            return None
        return asked.partition("?")

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
        self._answer(Answer(_TEXT, b"nothing is served here"), status)

    def _complain(self, error: DualArmError) -> None:
        self._answer(Answer(_TEXT, str(error).encode()), HTTPStatus.BAD_REQUEST)

    def _answer(self, answer: Answer, status: HTTPStatus = HTTPStatus.OK) -> None:
        self.send_response(status)
        self.send_header("Content-Type", answer.kind)
        self.send_header("Content-Length", str(len(answer.content)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        self.end_headers()
        self.wfile.write(answer.content)

    def log_message(self, format: str, *values: object) -> None:  # noqa: A002 - its parent's name
        """Nothing is said on the terminal."""
        _log.debug(format, *values)


def _interface(host: str) -> str:
    """An address that can be held against what a browser says.

    Raises:
        ViewError: It is no address, or that of all interfaces.
    """
    try:
        address = ipaddress.IPv4Address(host)
    except ValueError:
        raise ViewError(f"{host!r} is no IPv4 address of an interface") from None
    if address.is_unspecified or address.is_multicast:
        raise ViewError(f"{host} is not the address of one interface: name that")
    return host


def _fields(query: str) -> dict[str, str]:
    """The fields of a query.

    Raises:
        ViewError: There are too many.
    """
    try:
        return dict(parse_qsl(query, max_num_fields=_MOST_FIELDS))
    except ValueError:
        raise ViewError("too many fields") from None
