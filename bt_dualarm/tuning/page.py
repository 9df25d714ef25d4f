"""The tuning page: image, mask and sliders, served to browsers on this machine only."""

from __future__ import annotations

import base64
import json
import logging
import sys
from collections.abc import Callable, Mapping
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from socket import socket
from socketserver import BaseServer
from threading import Lock
from typing import Final

from bt_dualarm.core.errors import DualArmError
from bt_dualarm.core.share import share_dir
from bt_dualarm.spec.values import Color
from bt_dualarm.spec.yaml_reader import Data
from bt_dualarm.tuning.color import ColorView, Save, Shot, color_of, png, range_of

HOST: Final = "127.0.0.1"
_LARGEST_BODY: Final = 64 * 1024
_DIGITS: Final = len(str(_LARGEST_BODY))
_PATIENCE_S: Final = 10.0
"""Longest wait for an incomplete request, s."""

_log = logging.getLogger(__name__)


class PageError(DualArmError):
    """The page cannot be served, or a request is invalid."""


class Tuning:
    """Actions of the page, independent of the network; the page itself keeps the ranges.

    Args:
        shot: Image to tune on.
        color: Initial color.
        save: Writer that the button calls; None if there is no destination.
    """

    def __init__(self, shot: Shot, color: Color, save: Save | None) -> None:
        self._shot = shot
        self._color = color
        self._save = save
        self._saving = Lock()
        self.image = png(shot.frame.image)

    def begin(self, _: Data) -> dict[str, Data]:
        """Initial content of the page."""
        return {
            "what": self._shot.what,
            "can_save": self._save is not None,
            **self._seen(Color(ranges=self._color.ranges)),
        }

    def look(self, asked: Data) -> dict[str, Data]:
        """Detections of ``color``."""
        return self._seen(_color(asked))

    def click(self, asked: Data) -> dict[str, Data]:
        """Replace or ``widen`` range number ``range`` of ``color`` around pixel ``at``."""
        color = _color(asked)
        try:
            (x, y) = asked["at"]
            number = asked["range"]
            widen = asked["widen"]
            ranges = list(color.ranges)
            begin = ranges[number] if widen else None
            ranges[number] = range_of(self._shot.frame.image, [(int(x), int(y))], begin)
        except (KeyError, IndexError, TypeError, ValueError, OverflowError) as error:
            raise PageError(f"a click needs a pixel and a range: {error!r}") from None
        return self._seen(Color(ranges=tuple(ranges)))

    def save(self, asked: Data) -> dict[str, Data]:
        """Write ``color`` to its destination."""
        if self._save is None:
            raise PageError("there is no file to write to; start with --write or --snippet FILE")
        color = _color(asked)
        with (
            self._saving
        ):  # browsers send concurrent requests, and a save reads and writes the tree file
            return {"said": self._save(color)}

    def _seen(self, color: Color) -> dict[str, Data]:
        look = ColorView(self._shot.frame, color)
        mask = base64.b64encode(png(look.mask)).decode()
        return {
            "color": color.data,
            "notation": color.notation,
            "mask": f"data:image/png;base64,{mask}",
            "found": look.table,
        }


def _color(asked: Data) -> Color:
    if not isinstance(asked, dict) or "color" not in asked:
        raise PageError("a request names a color")
    return color_of(asked["color"])


def page_server(tuning: Tuning, port: int = 0) -> ThreadingHTTPServer:
    """A server on the loopback address; ``serve_forever`` runs it, ``server_address`` names it.

    Args:
        tuning: Actions of the page.
        port: Number of the port; 0 for any free port.

    Raises:
        PageError: The port is taken, or not allowed.
    """
    try:
        return _Server((HOST, port), partial(_Handler, tuning))
    except (OSError, OverflowError) as error:
        raise PageError(f"cannot serve on port {port}: {error}") from error


class _Server(ThreadingHTTPServer):
    """Server that reports errors of requests to the log instead of the terminal."""

    def handle_error(self, request: object, client_address: object) -> None:  # noqa: ARG002 - its parent's
        """Log an error; a closed connection is normal, anything else is a bug."""
        level = logging.DEBUG if isinstance(sys.exception(), ConnectionError) else logging.ERROR
        _log.log(level, "a request for the page failed", exc_info=True)


class _Handler(BaseHTTPRequestHandler):
    """One request.

    A page of another site in the same browser can reach this address as well. Requests are
    therefore refused if they name another host (whose name may resolve to this address) or if
    they are not JSON (which a browser lets any site send).
    """

    timeout = _PATIENCE_S  # applied to the socket by the base class

    def __init__(
        self, tuning: Tuning, request: socket, client_address: tuple[str, int], server: BaseServer
    ) -> None:
        self._tuning = tuning
        super().__init__(request, client_address, server)

    def do_GET(self) -> None:
        """Serve the page and its image."""
        if not self._is_meant():
            self._refuse(HTTPStatus.FORBIDDEN, "this address is served to this machine only")
        elif self.path == "/":
            page = share_dir("assets") / "pages" / "tune_color.html"
            self._answer("text/html; charset=utf-8", page.read_bytes())
        elif self.path == "/image.png":
            self._answer("image/png", self._tuning.image)
        else:
            self._refuse(HTTPStatus.NOT_FOUND, f"nothing is at {self.path}")

    def do_POST(self) -> None:
        """Answer a request of the page; both are JSON."""
        act = self._actions.get(self.path)
        if not self._is_meant() or self.headers.get_content_type() != "application/json":
            self._refuse(HTTPStatus.FORBIDDEN, "only the page itself may send requests")
            return
        if act is None:
            self._refuse(HTTPStatus.NOT_FOUND, f"nothing is at {self.path}")
            return
        try:
            content = json.dumps(act(self._asked())).encode()
        except DualArmError as error:
            self._refuse(HTTPStatus.BAD_REQUEST, str(error))
            return
        self._answer("application/json", content)

    @property
    def _actions(self) -> Mapping[str, Callable[[Data], dict[str, Data]]]:
        tuning = self._tuning
        return {
            "/begin": tuning.begin,
            "/look": tuning.look,
            "/click": tuning.click,
            "/save": tuning.save,
        }

    def _is_meant(self) -> bool:
        name = self.headers.get("Host", "").rpartition(":")[0]
        return name in (HOST, "localhost")

    def _asked(self) -> Data:
        """Parsed content of the request.

        Raises:
            PageError: The content is missing, not JSON, or has invalid numbers or text.
        """
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal() or len(length) > _DIGITS or int(length) > _LARGEST_BODY:
            raise PageError("a request needs a length within the limit")
        try:
            asked = json.loads(self.rfile.read(int(length)))
            json.dumps(asked, ensure_ascii=False, allow_nan=False).encode()
        except (ValueError, RecursionError):
            raise PageError("a request must be JSON with finite numbers and valid text") from None
        return asked

    def _refuse(self, status: HTTPStatus, why: str) -> None:
        self._answer("application/json", json.dumps({"error": why}).encode(), status)

    def _answer(self, kind: str, content: bytes, status: HTTPStatus = HTTPStatus.OK) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *arguments: object) -> None:  # noqa: A002 - http.server's
        """Write to the log instead of the terminal."""
        _log.debug(format, *arguments)
