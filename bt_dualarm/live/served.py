"""A page that is served for as long as somebody wants: the server and its thread."""

from __future__ import annotations

from threading import Thread

from bt_dualarm.live.answers import Answers
from bt_dualarm.live.server import HOST, ViewServer


class Served:
    """A server that answers in a thread of its own.

    Args:
        answers: What is behind the page.
        port: Number of the port; 0 takes any that is free.
        host: Address of the interface that is listened on.

    Attributes:
        url: Address of the page, with its token.

    Raises:
        ViewError: The port is taken, or not allowed; there is no such interface.
    """

    def __init__(self, answers: Answers, port: int = 0, host: str = HOST) -> None:
        self._server = ViewServer(answers, port, host)
        self._thread = Thread(target=self._server.serve_forever, name="view", daemon=True)
        self.url = self._server.url

    def begin(self) -> None:
        """Answer from now on."""
        self._thread.start()

    def end(self) -> None:
        """Answer no more."""
        self._server.shutdown()
        self._thread.join(1.0)
