"""Who may ask for what: pages of this server, with its token, and nobody else's.

One thread reads all requests side by side, so that whoever sends slowly, or nothing, keeps nobody
else waiting; what is asked with the token is answered by a few threads more.
"""

from __future__ import annotations

import asyncio
import io
import ipaddress
import json
import logging
import secrets
import socket
from asyncio import StreamReader, StreamWriter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from email.message import Message
from http import HTTPStatus
from http.client import HTTPException, parse_headers
from typing import Final
from urllib.parse import parse_qsl

from bt_dualarm.errors import DualArmError
from bt_dualarm.live.answers import Answer, Answers, ViewError
from bt_dualarm.spec.source import Json

HOST: Final = "127.0.0.1"
PATIENCE_S: Final = 10.0
"""Seconds in which a request must be there, and in which each part of an answer must be taken."""

MOST_CONNECTIONS: Final = 300
"""Connections that are open at a time; for one more the oldest that has asked nothing yet goes."""

_LARGEST_BODY: Final = 20_000
_DIGITS: Final = len(str(_LARGEST_BODY))
_LARGEST_HEAD: Final = 16_000
_MOST_FIELDS: Final = 4
_THREADS: Final = 8
"""Threads that answer; no more requests wait for them than there are connections."""

_PART: Final = 1 << 16
"""Bytes of an answer that are handed to the system at a time: one connection takes no more."""

_LEFT_OVER: Final = 1 << 18
_LEFT_OVER_S: Final = 0.5
"""Bytes that are read and dropped after a refusal, and for how long: the answer gets through."""

_TEXT: Final = "text/plain; charset=utf-8"
_REFUSED: Final = Answer(_TEXT, b"nothing is served here")
_ONCE: Final = ("Host", "Origin", "Content-Length", "Content-Type")

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Reply:
    status: HTTPStatus
    answer: Answer

    @classmethod
    def refusal(cls, status: HTTPStatus = HTTPStatus.FORBIDDEN) -> _Reply:
        return cls(status, _REFUSED)

    @classmethod
    def complaint(cls, error: DualArmError) -> _Reply:
        return cls(HTTPStatus.BAD_REQUEST, Answer(_TEXT, str(error).encode(errors="replace")))

    @property
    def head(self) -> bytes:
        lines = (
            f"HTTP/1.1 {self.status.value} {self.status.phrase}",
            f"Content-Type: {self.answer.kind}",
            f"Content-Length: {len(self.answer.content)}",
            "Connection: close",
            "Cache-Control: no-store",
            "X-Content-Type-Options: nosniff",
            "Referrer-Policy: no-referrer",
            "Cross-Origin-Resource-Policy: same-origin",
        )
        return "".join(f"{line}\r\n" for line in (*lines, "")).encode("latin-1")


class ViewServer:
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

    def __init__(self, answers: Answers, port: int = 0, host: str = HOST) -> None:
        self._answers, self._token = answers, secrets.token_urlsafe(16)
        try:
            self._socket = socket.create_server((_interface(host), port), backlog=MOST_CONNECTIONS)
            # Accepted sockets take it over: the system would keep megabytes for each slow reader.
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _PART)
        except (OSError, OverflowError) as error:
            raise ViewError(f"cannot serve on {host}, port {port}: {error}") from error
        self._pool = ThreadPoolExecutor(_THREADS, thread_name_prefix="view")
        # In the order in which they came; those that have asked for something are no longer here.
        self._silent: dict[StreamWriter, None] = {}
        self._open = 0
        self._loop = asyncio.new_event_loop()
        self._end = asyncio.Event()
        place = self._socket.getsockname()[1]
        names = (host, "localhost") if host == HOST else (host,)
        self.hosts = frozenset(f"{name}:{place}" for name in names)
        self.url = f"http://{host}:{place}/{self._token}/"

    def serve_forever(self) -> None:
        """Answer until `shutdown`; connections that are open then are broken off."""
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        finally:
            left = asyncio.all_tasks(self._loop)
            for task in left:
                task.cancel()
            self._loop.run_until_complete(asyncio.gather(*left, return_exceptions=True))
            self._loop.run_until_complete(asyncio.sleep(0))  # in which connections are closed
            self._loop.close()

    def shutdown(self) -> None:
        """Answer no more; to be called from another thread."""
        self._loop.call_soon_threadsafe(self._end.set)
        self._pool.shutdown(wait=False, cancel_futures=True)

    async def _serve(self) -> None:
        server = await asyncio.start_server(
            self._connected, sock=self._socket, limit=_LARGEST_HEAD, backlog=MOST_CONNECTIONS
        )
        async with server:
            await self._end.wait()

    async def _connected(self, reader: StreamReader, writer: StreamWriter) -> None:
        """Read one request, answer it, and close the connection."""
        self._open += 1
        self._silent[writer] = None
        if self._open > MOST_CONNECTIONS:
            next(iter(self._silent)).transport.abort()
        try:
            writer.transport.set_write_buffer_limits(0)  # `drain` waits until all of it is taken
            async with asyncio.timeout(PATIENCE_S):
                work = await self._request(reader)
            self._silent.pop(writer, None)
            reply = work if isinstance(work, _Reply) else await self._worked(work)
            await _send(writer, reply)
            if not isinstance(work, _Reply):
                return
            writer.write_eof()
            async with asyncio.timeout(_LEFT_OVER_S):
                await _drop(reader)
        except (OSError, EOFError, TimeoutError):  # a browser that has gone is nothing to tell
            _log.debug("a request for the view was broken off", exc_info=True)
        except asyncio.CancelledError:  # the server ends; asyncio would log a traceback of it
            _log.debug("a request for the view came too late")
            writer.transport.abort()
        finally:
            self._silent.pop(writer, None)
            self._open -= 1
            writer.transport.abort() if writer.is_closing() else writer.close()

    async def _request(self, reader: StreamReader) -> _Reply | Callable[[], Answer]:
        """What is asked for, once all of it is there; of whoever is not to ask no body is read."""
        try:
            head = await reader.readuntil(b"\r\n\r\n")
            line, _, rest = head.partition(b"\r\n")
            method, target, _ = line.decode("ascii").split(" ")
            headers = parse_headers(io.BytesIO(rest))
        except (asyncio.LimitOverrunError, ValueError, HTTPException):
            return _Reply.refusal(HTTPStatus.BAD_REQUEST)
        asked = self._allowed(target, headers)
        if asked is None:
            return _Reply.refusal()
        what, query = asked
        if method == "GET":
            question = self._answers.questions.get(what)
            return _Reply.refusal() if question is None else lambda: question(_fields(query))
        if method != "POST" or what != "do" or headers.get_content_type() != "application/json":
            return _Reply.refusal()
        try:
            length = _length(headers)
        except ViewError as error:
            return _Reply.complaint(error)
        body = await reader.readexactly(length)
        return lambda: Answer.of(self._answers.do(_pressed(body)))

    async def _worked(self, work: Callable[[], Answer]) -> _Reply:
        """The answer, by one of the threads."""
        try:
            return _Reply(HTTPStatus.OK, await self._loop.run_in_executor(self._pool, work))
        except DualArmError as error:
            return _Reply.complaint(error)
        except Exception as error:
            if self._end.is_set():
                raise EOFError from error
            _log.exception("a request for the view failed")
            return _Reply.refusal(HTTPStatus.INTERNAL_SERVER_ERROR)

    def _allowed(self, target: str, headers: Message) -> tuple[str, str] | None:
        """What below the token is asked for, and its query; None for whoever is not to ask."""
        host, origin = headers.get("Host", ""), headers.get("Origin")
        if any(len(headers.get_all(name, ())) > 1 for name in _ONCE):
            return None
        if host not in self.hosts or "Transfer-Encoding" in headers:
            return None
        if origin is not None and origin != f"http://{host}":
            return None
        token, _, asked = target.removeprefix("/").partition("/")
        if not secrets.compare_digest(token.encode(), self._token.encode()):
            return None
        what, _, query = asked.partition("?")
        return what, query


async def _send(writer: StreamWriter, reply: _Reply) -> None:
    """Send an answer part by part; who does not take one in time gets no more."""
    content = memoryview(reply.answer.content)
    writer.write(reply.head)
    for start in range(0, max(1, len(content)), _PART):
        writer.write(content[start : start + _PART])
        async with asyncio.timeout(PATIENCE_S):
            await writer.drain()


async def _drop(reader: StreamReader) -> None:
    """Read what is left of a request that was refused, up to a limit."""
    dropped = 0
    while dropped < _LEFT_OVER:
        part = await reader.read(_PART)
        if not part:
            return
        dropped += len(part)


def _length(headers: Message) -> int:
    """Bytes of the body.

    Raises:
        ViewError: They are not said, or too many.
    """
    length = headers.get("Content-Length", "")
    if not length.isdecimal() or len(length) > _DIGITS or int(length) > _LARGEST_BODY:
        raise ViewError("a request has a length, and a short one")
    return int(length)


def _pressed(body: bytes) -> Json:
    """The content of a request.

    Raises:
        ViewError: It is no object in JSON.
    """
    try:
        asked = json.loads(body)
    except (ValueError, RecursionError):
        raise ViewError("a request is JSON") from None
    if not isinstance(asked, dict):
        raise ViewError("a request is an object")
    return asked


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
