"""A run and a page that shows it: observers that copy and hold, and a server in a thread."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Final

from bt_dualarm.live.answers import Answer, Asked, Query, ViewError, number_in, text_in
from bt_dualarm.live.gate import Gate
from bt_dualarm.live.happenings import Happenings
from bt_dualarm.live.past_answers import PastAnswers
from bt_dualarm.live.pictures import Pictures
from bt_dualarm.live.served import Served
from bt_dualarm.live.server import HOST
from bt_dualarm.live.signals import Signals
from bt_dualarm.live.snapshot import Snapshot
from bt_dualarm.live.viewers import Viewers
from bt_dualarm.runtime.run import Run
from bt_dualarm.runtime.signals import StopRequest
from bt_dualarm.spec.source import Data, Json

_LOOK_S: Final = 0.2
"""Seconds on the wall between two looks at whether somebody still looks."""


class LiveView:
    """Shows a run from the begin of a ``with`` block to its end.

    The run is held until a page lets it go. What pages ask for is seen between two steps; they
    get copies, and can do nothing to the run but hold it, and let it go on. Its past, blackboards,
    pictures and reasons are there where the run is recorded.

    Args:
        run: The run.
        stop: Request to end, which a held run heeds.
        port: Number of the port; 0 takes any that is free.
        host: Address of the interface that is listened on.
        paused: Whether the run begins held.

    Raises:
        ViewError: The port is taken, or not allowed.
    """

    def __init__(
        self,
        run: Run,
        stop: StopRequest,
        port: int = 0,
        host: str = HOST,
        *,
        paused: bool = True,
    ) -> None:
        self._run, self._stop = run, stop
        self._snapshot = Snapshot(run.world, run.assembly.arms, run.views)
        self._happenings = Happenings(lambda: run.time)
        self._signals = Signals(run.world, run.assembly.arms)
        self._viewers = Viewers()
        self._pictures = Pictures(run.world, lambda: self._snapshot.is_watched)
        self.gate = Gate(lambda: bool(stop.asked), self._about_to_hold, paused=paused)
        self._past = None if run.kept is None else PastAnswers(run.kept.folder.path)
        self._served = Served(self, port, host)

    @property
    def url(self) -> str:
        """Address of the page."""
        return self._served.url

    def __enter__(self) -> LiveView:
        for observer in (self._happenings, self._signals, self._snapshot, self.gate):
            self._run.watch(observer)
        if self._run.kept is not None:
            notes = self._run.kept.notes
            notes.readers += self._snapshot.notes.add, self._happenings.noted
            notes.lookers.append(self._pictures.take)
        self._happenings.listen()
        self._served.begin()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Serve no more."""
        self._served.end()
        self._happenings.close()

    def linger(self) -> None:
        """Once the run is over, wait for as long as a page is open and it is not to end."""
        self._snapshot.take()
        while self.is_watched and not self._stop.asked:
            time.sleep(_LOOK_S)

    @property
    def is_watched(self) -> bool:
        """Whether a page is open, however long it has not asked, or about to be."""
        return self._viewers.is_anyone_there

    def _about_to_hold(self) -> None:
        """Copy, and have written, all that there is until now."""
        self._snapshot.take()
        if self._run.kept is not None:
            self._run.kept.history.flush()

    @property
    def questions(self) -> Mapping[str, Asked]:
        """What may be asked, by name."""
        past = {} if self._past is None else self._past.questions
        return {
            **past,
            "": lambda _: self._page(),
            "now": self._now,
            "series": lambda query: Answer.of(self._signals.since(number_in(query, "after", 0.0))),
            "log": lambda query: Answer.of(
                self._happenings.since(int(number_in(query, "after", 0.0)))
            ),
            "scene": self._scene,
            "mesh": self._mesh,
            "eye": self._eye,
        }

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

    def _page(self) -> Answer:
        self._viewers.fetched()
        return Answer.page()

    def _now(self, query: Query) -> Answer:
        """The run as it stands, and whether it is held."""
        self._viewers.asked(query.get("page", ""))
        told = {"kind": "live", "name": self._run.name, "recorded": self._past is not None}
        over = self._run.done
        if over:
            self._snapshot.take_last()
        facts = {"over": over, "timestep": self._run.world.timestep}
        return Answer.of({**told, **facts, **self._snapshot.now, **self.gate.state})

    def _scene(self, query: Query) -> Answer:
        generation = int(number_in(query, "generation", -1.0)) if "generation" in query else -1
        now = self._snapshot.now["generation"]
        if generation in (-1, now) or self._past is None:
            looks = self._snapshot.looks
            said = {"generation": now, "shapes": [*looks.shapes], "meshes": [*looks.meshes]}
            return Answer.of(said)
        return Answer.of(self._past.scene(generation))

    def _mesh(self, query: Query) -> Answer:
        name = text_in(query, "name")
        found = self._snapshot.looks.meshes.get(name)
        if found is None and self._past is not None:
            found = self._past.past.mesh(name)
        return Answer.numbers(found)

    def _eye(self, query: Query) -> Answer:
        """The last picture of a camera, or, where a time is given, that of then."""
        if "t" in query and self._past is not None:
            return self._past.questions["eye"](query)
        return Answer.jpeg(self._pictures.jpeg(text_in(query, "arm")))

    @property
    def _buttons(self) -> Mapping[str, Callable[[Data], None]]:
        gate = self.gate
        return {
            "pause": lambda _: gate.pause(),
            "go": lambda _: gate.go(),
            "step": lambda _: gate.step(),
            "tick": lambda _: gate.tick(),
            "speed": gate.set_speed,
            "leave": lambda value: self._viewers.left(str(value)),
            "break": lambda value: gate.set_breakpoints(str(value).split("\n")),
        }
