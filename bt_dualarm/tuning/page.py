"""The live page: picture, mask and sliders in a browser on this machine, and nowhere else."""

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
"""Longest wait for a browser that has begun to ask and does not go on."""

_log = logging.getLogger(__name__)


class PageError(DualArmError):
    """The page cannot be served, or was asked for something that it does not understand."""


class Tuning:
    """What the page does, apart from the network; the ranges themselves are kept by the page.

    Args:
        shot: Picture to tune on.
        color: Color to begin with.
        save: Writer that the button calls; None where there is no place to write to.
    """

    def __init__(self, shot: Shot, color: Color, save: Save | None) -> None:
        self._shot = shot
        self._color = color
        self._save = save
        self._saving = Lock()
        self.image = png(shot.frame.image)

    def begin(self, _: Data) -> dict[str, Data]:
        """Everything to show first."""
        return {
            "what": self._shot.what,
            "can_save": self._save is not None,
            **self._seen(Color(ranges=self._color.ranges)),
        }

    def look(self, asked: Data) -> dict[str, Data]:
        """What ``color`` finds."""
        return self._seen(_color(asked))

    def click(self, asked: Data) -> dict[str, Data]:
        """Range number ``range`` of ``color`` around pixel ``at``: anew, or ``widen``-ed."""
        color = _color(asked)
        try:
            (x, y) = asked["at"]
            number = asked["range"]
            widen = asked["widen"]
            ranges = list(color.ranges)
            begin = ranges[number] if widen else None
            ranges[number] = range_of(self._shot.frame.image, [(int(x), int(y))], begin)
        except (KeyError, IndexError, TypeError, ValueError, OverflowError) as error:
            raise PageError(f"a click has a pixel and a range: {error!r}") from None
        return self._seen(Color(ranges=tuple(ranges)))

    def save(self, asked: Data) -> dict[str, Data]:
        """Write ``color`` where it belongs."""
        if self._save is None:
            raise PageError("there is no file to write to; start with --write or --snippet FILE")
        color = _color(asked)
        with self._saving:  # a browser asks side by side, and a tree file is read and written
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
        tuning: Answers to the page.
        port: Number of the port; 0 takes any that is free.

    Raises:
        PageError: The port is taken, or not allowed.
    """
    try:
        return _Server((HOST, port), partial(_Handler, tuning))
    except (OSError, OverflowError) as error:
        raise PageError(f"cannot serve on port {port}: {error}") from error


class _Server(ThreadingHTTPServer):
    """Says in the log, and not on the terminal, what went wrong with a request."""

    def handle_error(self, request: object, client_address: object) -> None:  # noqa: ARG002 - its parent's
        """A browser that has gone is nothing to tell; the rest is a bug."""
        level = logging.DEBUG if isinstance(sys.exception(), ConnectionError) else logging.ERROR
        _log.log(level, "a request for the page failed", exc_info=True)


class _Handler(BaseHTTPRequestHandler):
    """One request.

    Another site's page in the same browser can reach this address, too: requests that name
    another host (its name may resolve to this address) or send no JSON (which a browser lets
    any site do unasked) are refused.
    """

    timeout = _PATIENCE_S  # of the socket, which the parent sets

    def __init__(
        self, tuning: Tuning, request: socket, client_address: tuple[str, int], server: BaseServer
    ) -> None:
        self._tuning = tuning
        super().__init__(request, client_address, server)

    def do_GET(self) -> None:
        """The page and its picture."""
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
        """What the page asks for, in JSON both ways."""
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
        """The request's content.

        Raises:
            PageError: It is none, or has numbers or text that nothing can be done with.
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
        """To the log and not to the terminal."""
        _log.debug(format, *arguments)
