"""The HTTP server of the viewer: the gate of a run, requests, access by token, open pages."""

from __future__ import annotations

import asyncio
import io
import ipaddress
import json
import logging
import math
import reprlib
import secrets
import socket
import time
from asyncio import StreamReader, StreamWriter
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from email.message import Message
from http import HTTPStatus
from http.client import HTTPException, parse_headers
from threading import Condition, Lock, Thread
from typing import Final, Protocol, TypeAlias
from urllib.parse import parse_qsl

from bt_dualarm.behaviors.report import StatusChange
from bt_dualarm.core.errors import DualArmError
from bt_dualarm.core.share import share_dir
from bt_dualarm.runtime.arm_runtime import IdleObserver, RunView
from bt_dualarm.runtime.summary import json_ready
from bt_dualarm.spec.yaml_reader import Data, Json

_POLL_S: Final = 0.1
"""Wall-clock seconds between two checks of whether the run is to end."""

_MOST_BREAKPOINTS: Final = 50
_LONGEST_REASON: Final = 300


class GateError(DualArmError):
    """A page requested an invalid speed or breakpoint."""


class Gate(IdleObserver):
    """Observer that holds the run between two physics steps: pause, step, tick, speed, breakpoint.

    Trees, controllers and physics stop together; only simulated time exists for them, so the
    result of the run is not affected.

    Args:
        asked_to_end: Returns whether the run is to end, which ends any hold.
        on_hold: Called between two steps when the run is about to be held.
        paused: Whether the run starts paused.
        speed: Simulated seconds per wall-clock second; infinity for no limit.

    Attributes:
        chores: Called repeatedly while the run is held; each returns whether it changed what pages
            show.
    """

    def __init__(
        self,
        asked_to_end: Callable[[], bool],
        on_hold: Callable[[], object] = lambda: None,
        *,
        paused: bool = True,
        speed: float = 1.0,
    ) -> None:
        self._asked_to_end = asked_to_end
        self._on_hold = on_hold
        self._changed = Condition()
        self._paused = paused
        self._speed = speed
        self._is_held = False
        self.chores: list[Callable[[], bool]] = []
        self._steps: int | None = None
        self._until_tick = False
        self._breakpoints: dict[str, None] = {}
        self._why = "begins here" if paused else ""
        self._ahead: tuple[float, float] | None = None

    @property
    def state(self) -> dict[str, object]:
        """State for pages, JSON-ready; ``held`` follows ``paused`` with a short delay."""
        speed = None if self._speed == float("inf") else self._speed
        return {
            "paused": self._paused,
            "held": self._is_held,
            "speed": speed,
            "why": self._why,
            "breakpoints": [*self._breakpoints],
        }

    def pause(self) -> None:
        """Hold the run after its next step."""
        self._set(paused=True, why="paused")

    def go(self) -> None:
        """Continue the run."""
        self._set(paused=False)

    def step(self) -> None:
        """Continue for one physics step."""
        self._set(paused=False, steps=1)

    def tick(self) -> None:
        """Continue until trees have been ticked."""
        self._set(paused=False, until_tick=True)

    def set_speed(self, speed: Data) -> None:
        """Set the simulated seconds per wall-clock second; None for no limit.

        Raises:
            GateError: The speed is not a number from 0.001 to 1000.
        """
        # Compared without conversion, because a large integer may not fit into a float.
        is_number = isinstance(speed, int | float) and not isinstance(speed, bool)
        if speed is not None and not (is_number and 1e-3 <= speed <= 1e3):
            raise GateError(f"a speed is a number from 0.001 to 1000, not {reprlib.repr(speed)}")
        with self._changed:
            self._speed = float("inf") if speed is None else float(speed)
            self._ahead = None

    def set_breakpoints(self, names: list[str]) -> None:
        """Pause whenever a node with one of these names, types or paths changes its status.

        ``NAME FAILURE`` pauses at this status only, ``FAILURE`` at this status of any node.

        Raises:
            GateError: There are too many breakpoints, or they are too long.
        """
        if len(names) > _MOST_BREAKPOINTS or any(len(name) > _LONGEST_REASON for name in names):
            raise GateError(
                f"at most {_MOST_BREAKPOINTS} breakpoints, each {_LONGEST_REASON} characters"
            )
        self._breakpoints = dict.fromkeys(name.strip() for name in names if name.strip())

    def on_event(self, change: StatusChange) -> None:
        """Pause if the change matches a breakpoint."""
        for name in self._breakpoints:
            node, _, status = name.rpartition(" ")
            if not node and status not in ("SUCCESS", "FAILURE", "RUNNING", "INVALID"):
                node = status
                status = ""
            is_match = node in ("", change.path, change.kind) or change.path.endswith(f"/{node}")
            if is_match and status in ("", change.new):
                self._set(paused=True, why=f"{change.arm}:{change.path} → {change.new}")

    def after_ticks(self, run: RunView) -> None:  # noqa: ARG002 - that there was one is enough
        """Pause if one tick was requested."""
        if self._until_tick:
            self._set(paused=True, why="one tick")

    def after_step(self, time: float) -> None:
        """Limit the speed, and wait while the run is paused."""
        if self._steps is not None:
            self._steps -= 1
            if self._steps <= 0:
                self._set(paused=True, why="one step")
        self._keep_pace(time)
        if self._paused:
            self._on_hold()
            self.hold()
            self._ahead = None

    def hold(self) -> None:
        """Wait while the run is paused."""
        self._is_held = True
        while self._paused and not self._asked_to_end():
            with self._changed:
                if self._paused:
                    self._changed.wait(_POLL_S)
            for chore in self.chores:
                if chore():
                    self._on_hold()
        self._is_held = False

    def _keep_pace(self, simulated: float) -> None:
        """Sleep while simulated time is ahead of the wall clock."""
        if self._speed == float("inf"):
            return
        now = time.monotonic()
        if self._ahead is None:
            self._ahead = now, simulated
        began, since = self._ahead
        left = (simulated - since) / self._speed - (now - began)
        while left > 0 and not self._asked_to_end() and self._ahead is not None:
            time.sleep(min(left, _POLL_S))
            left -= _POLL_S

    def _set(
        self, *, paused: bool, why: str = "", steps: int | None = None, until_tick: bool = False
    ) -> None:
        with self._changed:
            self._paused = paused
            self._why = why
            self._steps = steps
            self._until_tick = until_tick
            self._changed.notify_all()


Query: TypeAlias = Mapping[str, str]
"""Query fields of a request."""

_LONGEST: Final = 500
_MOST: Final = 10**9
_PAGE: Final = "live.html"
_PARTS: Final = {
    "STYLE_OF_THE_VIEW": "live.css",
    "SCRIPT_OF_THE_SCENE": "scene.js",
    "SCRIPT_OF_THE_SOURCE": "source.js",
    "SCRIPT_OF_THE_PANELS": "live_panels.js",
    "SCRIPT_OF_THE_VIEW": "live.js",
}


class ViewError(DualArmError):
    """The page cannot be served, or a request is invalid."""


@dataclass(frozen=True)
class PageAnswer:
    """Content of a response.

    Attributes:
        kind: Media type.
        content: The content.
    """

    kind: str
    content: bytes

    @classmethod
    def of(cls, data: Data) -> PageAnswer:
        """JSON response; numbers that are not finite, as of a diverged run, become null."""
        try:
            text = json.dumps(data, allow_nan=False)
        except ValueError:
            text = json.dumps(json_ready(data), allow_nan=False)
        return cls("application/json", text.encode())

    @classmethod
    def page(cls) -> PageAnswer:
        """The HTML page, shared by all views."""
        return cls("text/html; charset=utf-8", whole_page().encode())

    @classmethod
    def jpeg(cls, content: bytes | None) -> PageAnswer:
        """Image response.

        Raises:
            ViewError: There is no image.
        """
        return cls("image/jpeg", _present(content, "picture"))

    @classmethod
    def numbers(cls, content: bytes | None) -> PageAnswer:
        """Mesh response.

        Raises:
            ViewError: There is no such mesh.
        """
        return cls("application/octet-stream", _present(content, "such mesh"))


def _present(content: bytes | None, what: str) -> bytes:
    if content is None:
        raise ViewError(f"there is no {what}")
    return content


Asked: TypeAlias = Callable[[Query], PageAnswer]
"""Handler of a request."""


class Answers(Protocol):
    """Handlers of the requests and commands of a page."""

    @property
    def questions(self) -> Mapping[str, Asked]:
        """Handlers of requests, by name; each raises `DualArmError` for an invalid request."""

    def do(self, asked: Json) -> Json:
        """Execute a command and return the new state.

        Raises:
            DualArmError: There is no such command.
        """


def whole_page(record: str = "") -> str:
    """The HTML page with its style and scripts embedded.

    Args:
        record: Data of a record in base64, for a page without a server; its content policy then
            forbids all connections. Otherwise only connections to its own server are allowed.
    """
    pages = share_dir("assets") / "pages"
    page = (pages / _PAGE).read_text(encoding="utf-8")
    for placeholder, name in _PARTS.items():
        page = page.replace(placeholder, (pages / name).read_text(encoding="utf-8"))
    embedded = f'<script type="text/plain" id="record">{record}</script>' if record else ""
    source = "'none'" if record else "'self'"
    return page.replace("SOURCE_OF_THE_DATA", source).replace("RECORD_OF_THE_RUN", embedded)


def number_in(query: Query, name: str, default: float | None = None) -> float:
    """A number in a query.

    Raises:
        ViewError: The number is missing, or cannot be a time or a count.
    """
    text = query.get(name)
    if text is None and default is not None:
        return default
    try:
        number = float(text or "")
    except ValueError:
        number = math.nan
    if not 0 <= number <= _MOST:
        raise ViewError(f"{name}: a number from 0 on is missing")
    return number


def text_in(query: Query, name: str) -> str:
    """A name in a query.

    Raises:
        ViewError: The name is missing, or too long.
    """
    text = query.get(name, "")
    if not text or len(text) > _LONGEST:
        raise ViewError(f"{name}: a name is missing")
    return text


# Access: only pages of this server that know its token get answers. One thread reads all requests
# concurrently, so that a slow or silent client does not block others; requests with the token are
# answered by a small pool of threads.


HOST: Final = "127.0.0.1"
TIMEOUT_S: Final = 10.0
"""Seconds for a request to arrive, and for a client to receive each part of an answer."""

MOST_CONNECTIONS: Final = 300
"""Most open connections; beyond it, the oldest one without a complete request is closed."""

_LARGEST_BODY: Final = 20_000
_DIGITS: Final = len(str(_LARGEST_BODY))
_LARGEST_HEAD: Final = 16_000
_MOST_FIELDS: Final = 4
_THREADS: Final = 8
"""Threads that answer; the number of waiting requests is limited by the connections."""

_PART: Final = 1 << 16
"""Bytes of an answer written at a time, which bounds the buffer of a connection."""

_LEFT_OVER: Final = 1 << 18
_LEFT_OVER_S: Final = 0.5
"""Bytes read and discarded after a refusal, and for how long, so that the client gets the answer
instead of a connection reset."""

_TEXT: Final = "text/plain; charset=utf-8"
_REFUSED: Final = PageAnswer(_TEXT, b"nothing is served here")
_ONCE: Final = ("Host", "Origin", "Content-Length", "Content-Type")

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Reply:
    status: HTTPStatus
    answer: PageAnswer

    @classmethod
    def refusal(cls, status: HTTPStatus = HTTPStatus.FORBIDDEN) -> _Reply:
        return cls(status, _REFUSED)

    @classmethod
    def bad_request(cls, error: DualArmError) -> _Reply:
        return cls(HTTPStatus.BAD_REQUEST, PageAnswer(_TEXT, str(error).encode(errors="replace")))

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
    """Server of one page at an address that contains a secret token.

    Args:
        answers: Handlers of requests.
        port: Port number; 0 selects any free port.
        host: Address of one interface of this machine, which requests must name as their host.

    Attributes:
        url: Address of the page, with its token.
        hosts: Accepted values of the Host header, against DNS rebinding.

    Raises:
        ViewError: The port is in use or not allowed; the address is not one of this machine.
    """

    def __init__(self, answers: Answers, port: int = 0, host: str = HOST) -> None:
        self._answers = answers
        self._token = secrets.token_urlsafe(16)
        try:
            self._socket = socket.create_server((_interface(host), port), backlog=MOST_CONNECTIONS)
            # Inherited by accepted sockets; the default may buffer megabytes for each slow client.
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _PART)
        except (OSError, OverflowError) as error:
            raise ViewError(f"cannot serve on {host}, port {port}: {error}") from error
        self._pool = ThreadPoolExecutor(_THREADS, thread_name_prefix="view")
        # Connections without a complete request, in the order of arrival.
        self._silent: dict[StreamWriter, None] = {}
        self._open = 0
        self._loop = asyncio.new_event_loop()
        self._end = asyncio.Event()
        actual_port = self._socket.getsockname()[1]
        names = (host, "localhost") if host == HOST else (host,)
        self.hosts = frozenset(f"{name}:{actual_port}" for name in names)
        self.url = f"http://{host}:{actual_port}/{self._token}/"

    def serve_forever(self) -> None:
        """Answer requests until `shutdown`, which aborts open connections."""
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        finally:
            tasks = asyncio.all_tasks(self._loop)
            for task in tasks:
                task.cancel()
            self._loop.run_until_complete(asyncio.gather(*tasks, return_exceptions=True))
            self._loop.run_until_complete(asyncio.sleep(0))  # lets connections close
            self._loop.close()

    def shutdown(self) -> None:
        """Stop answering; to be called from another thread."""
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
            writer.transport.set_write_buffer_limits(0)  # `drain` waits for all of it
            async with asyncio.timeout(TIMEOUT_S):
                work = await self._request(reader)
            self._silent.pop(writer, None)
            reply = work if isinstance(work, _Reply) else await self._answer(work)
            await _send(writer, reply)
            if not isinstance(work, _Reply):
                return
            writer.write_eof()
            async with asyncio.timeout(_LEFT_OVER_S):
                await _drop(reader)
        except (OSError, EOFError, TimeoutError):  # the browser has gone, which is not an error
            _log.debug("a request for the view was broken off", exc_info=True)
        except asyncio.CancelledError:  # the server ends; asyncio would log a traceback of it
            _log.debug("a request for the view came too late")
            writer.transport.abort()
        finally:
            self._silent.pop(writer, None)
            self._open -= 1
            writer.transport.abort() if writer.is_closing() else writer.close()

    async def _request(self, reader: StreamReader) -> _Reply | Callable[[], PageAnswer]:
        """Read a whole request and return its handler; refused requests are not read to the end."""
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
            return _Reply.bad_request(error)
        body = await reader.readexactly(length)
        return lambda: PageAnswer.of(self._answers.do(_command(body)))

    async def _answer(self, work: Callable[[], PageAnswer]) -> _Reply:
        """Run a handler in the thread pool."""
        try:
            return _Reply(HTTPStatus.OK, await self._loop.run_in_executor(self._pool, work))
        except DualArmError as error:
            return _Reply.bad_request(error)
        except Exception as error:
            if self._end.is_set():
                raise EOFError from error
            _log.exception("a request for the view failed")
            return _Reply.refusal(HTTPStatus.INTERNAL_SERVER_ERROR)

    def _allowed(self, target: str, headers: Message) -> tuple[str, str] | None:
        """Name and query of a permitted request; None if it is not permitted."""
        host = headers.get("Host", "")
        origin = headers.get("Origin")
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
    """Send an answer part by part; raises TimeoutError if the client is too slow."""
    content = memoryview(reply.answer.content)
    writer.write(reply.head)
    for start in range(0, max(1, len(content)), _PART):
        writer.write(content[start : start + _PART])
        async with asyncio.timeout(TIMEOUT_S):
            await writer.drain()


async def _drop(reader: StreamReader) -> None:
    """Read and discard the rest of a refused request, up to a limit."""
    dropped = 0
    while dropped < _LEFT_OVER:
        part = await reader.read(_PART)
        if not part:
            return
        dropped += len(part)


def _length(headers: Message) -> int:
    """Length of the body in bytes.

    Raises:
        ViewError: The length is missing or too large.
    """
    length = headers.get("Content-Length", "")
    if not length.isdecimal() or len(length) > _DIGITS or int(length) > _LARGEST_BODY:
        raise ViewError("a request needs a length within the limit")
    return int(length)


def _command(body: bytes) -> Json:
    """The content of a command.

    Raises:
        ViewError: The body is not a JSON object.
    """
    try:
        asked = json.loads(body)
    except (ValueError, RecursionError):
        raise ViewError("a request is JSON") from None
    if not isinstance(asked, dict):
        raise ViewError("a request is an object")
    return asked


def _interface(host: str) -> str:
    """The address of one interface, which can be compared with Host headers.

    Raises:
        ViewError: It is not an IPv4 address, or means all interfaces.
    """
    try:
        address = ipaddress.IPv4Address(host)
    except ValueError:
        raise ViewError(f"{host!r} is not the IPv4 address of an interface") from None
    if address.is_unspecified or address.is_multicast:
        raise ViewError(f"{host} is not the address of one interface: name that")
    return host


def _fields(query: str) -> dict[str, str]:
    """The fields of a query.

    Raises:
        ViewError: There are too many fields.
    """
    try:
        return dict(parse_qsl(query, max_num_fields=_MOST_FIELDS))
    except ValueError:
        raise ViewError("too many fields") from None


class Served:
    """A `ViewServer` running in a thread.

    Args:
        answers: Handlers of requests.
        port: Port number; 0 selects any free port.
        host: Address of the interface to listen on.

    Attributes:
        url: Address of the page, with its token.

    Raises:
        ViewError: The port is in use or not allowed; there is no such interface.
    """

    def __init__(self, answers: Answers, port: int = 0, host: str = HOST) -> None:
        self._server = ViewServer(answers, port, host)
        self._thread = Thread(target=self._server.serve_forever, name="view", daemon=True)
        self.url = self._server.url

    def begin(self) -> None:
        """Start answering."""
        self._thread.start()

    def end(self) -> None:
        """Stop answering."""
        self._server.shutdown()
        self._thread.join(1.0)


_SILENT_S: Final = 600.0
"""Wall-clock seconds without a request after which a page counts as closed: browsers throttle
hidden pages to a request per minute, and a machine may be suspended for a while."""

_NAMELESS_S: Final = 2.0
"""The same for requests without a page name, which do not come from our pages."""

_OPENING_S: Final = 10.0
"""Seconds that a page may take from being loaded to its first request."""

_RELOAD_S: Final = 3.0
"""Seconds within which a closed page may reappear because it is being reloaded."""

_MOST_VIEWERS: Final = 100
_LONGEST_NAME: Final = 64


class Viewers:
    """Open pages, which identify themselves in every request and report closing; thread-safe."""

    def __init__(self) -> None:
        self._until: dict[str, float] = {}
        self._lock = Lock()

    def fetched(self) -> None:
        """Count a page that was sent and has not made a request yet."""
        self._extend("fetched", _OPENING_S)

    def asked(self, page: str) -> None:
        """Count a request of the page with this name, empty for a client without a name."""
        if page:
            self._extend(f"page {page[:_LONGEST_NAME]}", _SILENT_S)
        else:
            self._extend("nameless", _NAMELESS_S)

    def left(self, page: str) -> None:
        """Remove a page that was closed or is being reloaded."""
        with self._lock:
            self._until.pop(f"page {page[:_LONGEST_NAME]}", None)
        self._extend("left", _RELOAD_S)

    @property
    def is_anyone_there(self) -> bool:
        """Whether a page is open or being loaded."""
        with self._lock:
            return any(until > time.monotonic() for until in self._until.values())

    def _extend(self, who: str, seconds: float) -> None:
        with self._lock:
            self._until[who] = time.monotonic() + seconds
            if len(self._until) > _MOST_VIEWERS:  # drop the one idle for longest
                del self._until[min(self._until, key=self._until.__getitem__)]
