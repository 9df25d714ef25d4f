"""A record as one file: the page of `bt-replay`, with all that it would ask for in it."""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Iterator
from typing import Final

import numpy as np

from bt_dualarm.errors import DualArmError
from bt_dualarm.live.answers import whole_page
from bt_dualarm.live.past_answers import RecordView
from bt_dualarm.live.past_series import why_of
from bt_dualarm.replay.record import Record
from bt_dualarm.replay.timeline import Timeline
from bt_dualarm.runtime.summary import json_ready
from bt_dualarm.spec.source import Data, Json

_EVERY: Final = 2
"""States from one that is shown to the next: 25 a second."""

_MOST_POSES: Final = 60_000
"""Poses of bodies in a page: a minute at 25 Hz of 40 bodies; of more, fewer states a second."""

_MOST_EVENTS: Final = 400
"""Changes of a status at whose very time the page shows the run, too."""

_PICTURES: Final = 10.0
_MOST_PICTURES: Final = 300
"""Pictures a second of each camera, and how many of it there are at most."""

_MOST_NODES: Final = 300
_MOST_TIMES: Final = 40
"""Nodes, and times, of which the page knows what `bt-why` says."""


def html_of(record: Record) -> str:
    """The page of a record; it opens from disk, and asks nobody for anything.

    Raises:
        ReplayError: The record has no state, or this MuJoCo cannot read its models.
    """
    text = json.dumps(json_ready(page_data(record)), separators=(",", ":"))
    return whole_page(base64.b64encode(zlib.compress(text.encode(), 9)).decode("ascii"))


def page_data(record: Record) -> Json:
    """All that the page asks for, ready for JSON: as the server of `bt-replay` answers it.

    Meshes and pictures are base64; ``moments`` are answers to ``at``, in the order of their times,
    and ``why`` has those about nodes, and about times.
    """
    view = RecordView(record.folder)
    past = view.past

    def asked(what: str, **query: object) -> Data:
        given = {name: str(value) for name, value in query.items()}
        return json.loads(view.questions[what](given).content)

    moments = [past.moment(time) for time in _times(record)]
    generations = sorted({moment["generation"] for moment in moments})
    return {
        "now": asked("now"),
        "log": asked("log"),
        "series": asked("series"),
        "scenes": {number: asked("scene", generation=number) for number in generations},
        "meshes": {
            name: _text(content)
            for number in generations
            for name, content in past.looks(number).meshes.items()
        },
        "moments": moments,
        "pictures": {arm: [*_pictures(record, view, arm)] for arm in record.arms},
        "why": {"of": _why_of_nodes(record), "at": [*_why_at_times(record)]},
    }


def _times(record: Record) -> list[float]:
    """Simulated times in s that the page can show, in order."""
    count = len(record.times)
    bodies = max(record.model(number).nbody for number in record.models)
    every = max(_EVERY, -(-count * bodies // _MOST_POSES))
    states = record.times[[*range(0, count, every), count - 1]]
    events = [float(event["time_s"]) for event in record.events[:_MOST_EVENTS]]
    within = [min(max(time, 0.0), record.until) for time in events]
    return sorted({round(time, 4) for time in (*states.tolist(), *within)})


def _pictures(record: Record, view: RecordView, arm: str) -> Iterator[tuple[float, str]]:
    """Time in s and JPEG of the pictures of a camera; none of one that took none."""
    taken = [
        note["time_s"] for note in record.notes if (note["kind"], note["arm"]) == ("frame", arm)
    ]
    if not taken:
        return
    first, last = min(taken), max(taken)
    count = int(min(_MOST_PICTURES, max(1.0, _PICTURES * (last - first))))
    for time in np.linspace(first, last, count).round(4).tolist():
        try:
            picture = view.questions["eye"]({"arm": arm, "t": str(time)})
        except DualArmError:  # the arm was not in the world then
            continue
        yield time, _text(picture.content)


def _why_of_nodes(record: Record) -> Json:
    """What is said of the run, by the empty text, and of each node that ran, by arm and path."""
    ran = [node for node in Timeline(record).nodes() if node.changes]
    asked = [None, *(f"{node.arm}:{node.path}" for node in ran[:_MOST_NODES])]
    return {of or "": _why(record, of) for of in asked}


def _why_at_times(record: Record) -> Iterator[tuple[float, Json]]:
    """What went on at the times at which something changed, and each second between them."""
    events = {min(float(event["time_s"]), record.until) for event in record.events}
    times = sorted({*events, *np.arange(0.0, record.until)})
    chosen = np.linspace(0, len(times) - 1, min(len(times), _MOST_TIMES)).astype(int)
    for number in np.unique(chosen).tolist():
        time = float(times[number])
        yield round(time, 4), _why(record, f"{time:.4f}")


def _why(record: Record, of: str | None) -> Json:
    try:
        return why_of(record, of)
    except DualArmError as error:
        return {"error": str(error)}


def _text(content: bytes) -> str:
    return base64.b64encode(content).decode("ascii")
