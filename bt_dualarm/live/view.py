"""A run and a page that shows it: observers that copy and hold, and a server in a thread."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from threading import Thread
from types import TracebackType
from typing import Final

from bt_dualarm.live.gate import Gate
from bt_dualarm.live.server import ViewError, ViewServer
from bt_dualarm.live.snapshot import Snapshot
from bt_dualarm.replay.html_page import page_with_scene
from bt_dualarm.runtime.run import Run
from bt_dualarm.runtime.signals import StopRequest
from bt_dualarm.spec.source import Data, Json

_PAGE: Final = "live.html"


class LiveView:
    """Shows a run from the begin of a ``with`` block to its end.

    The run is held until a page lets it go. What pages ask for is seen between two steps; they
    get copies, and can do nothing to the run but hold it, and let it go on.

    Args:
        run: The run.
        stop: Request to end, which a held run heeds.
        port: Number of the port on the loopback address; 0 takes any that is free.
        paused: Whether the run begins held.

    Raises:
        ViewError: The port is taken, or not allowed.
    """

    def __init__(self, run: Run, stop: StopRequest, port: int = 0, *, paused: bool = True) -> None:
        self._snapshot = Snapshot(run.name, run.world, run.views)
        self.gate = Gate(lambda: bool(stop.asked), self._snapshot.take, paused=paused)
        self._server = ViewServer(self, port)
        self._thread = Thread(target=self._server.serve_forever, name="view", daemon=True)
        self._run = run

    @property
    def url(self) -> str:
        """Address of the page."""
        return self._server.url

    def __enter__(self) -> LiveView:
        self._run.watch(self._snapshot)
        self._run.watch(self.gate)
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Serve no more."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join(1.0)

    def page(self) -> str:
        """The page."""
        return page_with_scene(_PAGE)

    def scene(self) -> Json:
        """Shapes and meshes of the world."""
        return self._snapshot.scene

    def now(self) -> Json:
        """The run as it stands, and whether it is held."""
        return {**self._snapshot.now, **self.gate.state}

    def do(self, asked: Json) -> Json:
        """Press a button.

        Raises:
            ViewError: There is no such button, or its value makes no sense.
            GateError: A value is outside of what is allowed.
        """
        button = self._buttons.get(str(asked.get("deed", "")))
        if button is None:
            raise ViewError(f"there is no button {str(asked.get('deed'))[:40]!r}")
        try:
            button(asked.get("value"))
        except (TypeError, ValueError, AttributeError) as error:
            raise ViewError(f"that value makes no sense: {error}") from error
        return self.gate.state

    @property
    def _buttons(self) -> Mapping[str, Callable[[Data], None]]:
        gate = self.gate
        return {
            "pause": lambda _: gate.pause(),
            "go": lambda _: gate.go(),
            "step": lambda _: gate.step(),
            "tick": lambda _: gate.tick(),
            "speed": lambda value: gate.set_speed(None if value is None else float(value)),
            "break": lambda value: gate.set_breakpoints(str(value).split("\n")),
        }
