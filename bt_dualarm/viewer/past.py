"""The view of a record at any of its times: states, images, diagnoses, and the offline page."""

from __future__ import annotations

import base64
import json
import time as wall
import zlib
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from threading import Lock, RLock
from typing import Final, TypeAlias

import cv2
import mujoco
import numpy as np

from bt_dualarm.core.errors import DualArmError
from bt_dualarm.diagnosis.story import state_of, stories
from bt_dualarm.replay.record import Record, ReplayError
from bt_dualarm.replay.timeline import RecordedFrame, Timeline, TimelineNode, recorded_frames
from bt_dualarm.runtime.history_file import HistoryError
from bt_dualarm.runtime.recorder import EVENTS, FRAMES, HISTORY
from bt_dualarm.runtime.summary import json_ready
from bt_dualarm.sim.composition import CAMERA
from bt_dualarm.sim.frame import Exposure, Frame, Image, RenderableWorld, Scenery
from bt_dualarm.sim.renderers import RayRenderer
from bt_dualarm.spec.yaml_reader import Data, Json
from bt_dualarm.viewer import signals
from bt_dualarm.viewer.events import (
    Annotations,
    gripper_force,
    log_of,
    rows_at,
    sent_to,
    series_of,
    why_of,
)
from bt_dualarm.viewer.server import (
    Asked,
    PageAnswer,
    Query,
    ViewError,
    number_in,
    text_in,
    whole_page,
)
from bt_dualarm.viewer.signals import (
    ModelIndices,
    Mounted,
    VisualMeshes,
    arm_of,
    model_indices,
    row_of,
    series_text,
    visual_meshes,
)

_REREAD_S: Final = 0.5
_REREAD_FACTOR: Final = 10.0
"""A growing record is read again after half a second, or ten times the last reading time."""

_AHEAD_S: Final = 3.0
_AHEAD_POINTS: Final = 40


Posed: TypeAlias = tuple[mujoco.MjModel, mujoco.MjData, dict[str, ModelIndices]]
"""A model, its data, and the indices of the arms in it."""


class PastView:
    """States of a record for pages; the record may still be growing.

    Args:
        folder: Folder of the record.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._lock = RLock()
        self._record: Record | None = None
        self._sizes: tuple[int, ...] = ()
        self._again_at = -np.inf
        self._scratch: dict[int, tuple[mujoco.MjData, dict[str, ModelIndices]]] = {}
        self._looks: dict[int, VisualMeshes] = {}
        self._ahead: dict[int, mujoco.MjData] = {}
        self._noted: tuple[Record | None, float, int, Annotations] = (None, 0.0, 0, Annotations())
        self._trees: tuple[Record, int, Mapping[str, TimelineNode]] | None = None

    @property
    def record(self) -> Record:
        """The record as far as it has been written.

        Raises:
            ReplayError: There is no record in the folder.
            HistoryError: The record cannot be read, or has hardly begun.
        """
        with self._lock:
            now = wall.monotonic()
            if self._record is None or now >= self._again_at:
                sizes = _sizes(self._folder)
                if self._record is None or sizes != self._sizes:
                    self._record = Record.read(self._folder)
                    self._sizes = sizes
                took = wall.monotonic() - now
                self._again_at = now + took + max(_REREAD_S, _REREAD_FACTOR * took)
            return self._record

    @property
    def has_states(self) -> bool:
        """Whether at least the first state has been written."""
        try:
            return len(self.record.times) > 0
        except (ReplayError, HistoryError):
            return False

    def _up_to(self, time: float) -> Record:
        """The record up to at least this time, if possible; avoids reading it again if it can."""
        if self._record is not None and time <= self._record.until:
            return self._record
        return self.record

    def moment(self, time: float) -> Json:
        """Run at a time in s: trees, trace events, and the last state kept until then.

        Raises:
            ReplayError: There is no state, or this MuJoCo cannot read the model.
        """
        with self._lock:
            record = self._up_to(time)
            time = min(max(time, 0.0), record.until)
            index = record.index_at(time)
            moment = record.moment(index)
            model = record.model(moment.generation)
            data, indices = self._posed(record, index)
            notes = self._notes_until(record, time)
            roots = self._trees_at(record, time)
            # A run that broke within a step ended after the last state that is kept.
            is_end = round(time, 4) >= round(record.until, 4)  # the page rounds times
            until = np.inf if record.end is not None and is_end else time
            arms = [self._arm(record, roots[name], index, until, notes) for name in record.arms]
            return {
                "time": round(time, 4),
                "generation": moment.generation,
                "poses": signals.bodies(data),
                "contacts": signals.contacts(model, data),
                "cameras": [
                    {**camera, "look": notes.look(str(camera["arm"]))}
                    for camera in signals.cameras(model, data, indices)
                ],
                "arms": arms,
            }

    def _notes_until(self, record: Record, time: float) -> Annotations:
        """Trace events up to a time in s; for increasing times only the new events are added."""
        owner, until, count, seen = self._noted
        if owner is not record or time < until:
            count = 0
            seen = Annotations()
        while count < len(record.notes) and record.notes[count]["time_s"] <= time + 1e-9:
            seen.add(record.notes[count])
            count += 1
        self._noted = record, time, count, seen
        return seen

    def _trees_at(self, record: Record, time: float) -> Mapping[str, TimelineNode]:
        """Roots of the trees that were valid at a time in s; each edit reindices them."""
        edits = [note for note in record.notes if note["kind"] == "edited"]
        count = sum(note["time_s"] <= time + 1e-9 for note in edits)
        if self._trees is None or self._trees[0] is not record or self._trees[1] != count:
            self._trees = record, count, Timeline(record, time).roots
        return self._trees[2]

    @contextmanager
    def at(self, time: float) -> Iterator[Posed]:
        """Model, data and arms at a time in s, valid only within the block.

        Raises:
            ReplayError: There is no state, or this MuJoCo cannot read the model.
        """
        with self._lock:
            record = self._up_to(time)
            index = record.index_at(min(max(time, 0.0), record.until))
            data, indices = self._posed(record, index)
            yield record.model(record.moment(index).generation), data, indices

    def _posed(self, record: Record, index: int) -> tuple[mujoco.MjData, dict[str, ModelIndices]]:
        """The world at a state, by its index, with forces recomputed from the recorded torques."""
        moment = record.moment(index)
        model = record.model(moment.generation)
        if moment.generation not in self._scratch:
            indices = model_indices(model, record.arms)
            self._scratch[moment.generation] = mujoco.MjData(model), indices
        data, indices = self._scratch[moment.generation]
        mujoco.mj_resetData(model, data)
        data.qpos[:] = moment.qpos
        data.qvel[:] = moment.qvel
        data.time = moment.time
        for arm in indices.values():
            row = sent_to(record, arm, index)
            if row is not None:
                data.ctrl[arm.motors] = row[3]
        mujoco.mj_forward(model, data)
        return data, indices

    def looks(self, generation: int) -> VisualMeshes:
        """Shapes and meshes of a model; raises the same errors as `Record.model`."""
        with self._lock:
            if generation not in self._looks:
                model = self.record.model(generation)
                self._looks[generation] = visual_meshes(model, self._mounted())
            return self._looks[generation]

    def mesh(self, name: str) -> bytes | None:
        """A mesh of any model requested so far; None if there is none of this name."""
        found = [looks.meshes[name] for looks in self._looks.values() if name in looks.meshes]
        return found[0] if found else None

    def _mounted(self) -> Mapping[str, Mounted]:
        record = self.record
        root = Path(str(record.start["path"])).parent
        found = {name: arm_of(arm, root) for name, arm in record.arms.items()}
        return {name: arm for name, arm in found.items() if arm is not None}

    def _arm(
        self, record: Record, root: TimelineNode, index: int, time: float, notes: Annotations
    ) -> Json:
        name = root.arm
        generation = record.moment(index).generation
        data, indices = self._scratch[generation]
        rows = rows_at(root, time, record.notes)
        facts: Json = {
            "arm": name,
            "robot": record.arms[name]["robot"],
            "outcome": _outcome(rows),
            "nodes": rows,
            "board": notes.blackboard(name),
            "guard": notes.guard(name),
        }
        arm = indices.get(name)
        row = None if arm is None else sent_to(record, arm, index)
        if arm is None or row is None:
            return facts
        model = record.model(generation)
        facts |= signals.arm_numbers(row_of(model, data, arm, row[0], row[3]))
        if record.arms[name].get("gripper") is not None:
            gripper = str(record.arms[name]["gripper"])
            force = gripper_force(record, name, index)
            facts["gripper"] = signals.gripper(model, data, arm, gripper, force)
        life = record.lives(name, generation)
        return {**facts, "life": life, "ahead": self._path_ahead(record, arm, index)}

    def _path_ahead(self, record: Record, arm: ModelIndices, index: int) -> str:
        """Tool path of the set-points of the next seconds: points in m, as base64."""
        moment = record.moment(index)
        model = record.model(moment.generation)
        if moment.generation not in self._ahead:
            self._ahead[moment.generation] = mujoco.MjData(model)
        data = self._ahead[moment.generation]
        data.qpos[:] = moment.qpos
        last = record.index_at(min(moment.time + _AHEAD_S, record.until))
        points = []
        for number in np.unique(np.linspace(index, last, _AHEAD_POINTS).round().astype(int)):
            row = sent_to(record, arm, int(number))
            if row is None:
                break
            data.qpos[arm.qpos] = row[0]
            mujoco.mj_kinematics(model, data)
            points.append(data.site_xpos[arm.tool].copy())
        return signals.as_text(np.array(points).reshape(-1, 3))


def _outcome(rows: list[Json]) -> str | None:
    status = str(rows[0]["status"])
    return status if status in ("SUCCESS", "FAILURE") else None


def _sizes(folder: Path) -> tuple[int, ...]:
    """Sizes in bytes of the growing files; 0 for missing ones."""
    paths = [folder / name for name in (HISTORY, EVENTS, "summary.json")]
    return tuple(path.stat().st_size if path.exists() else 0 for path in paths)


_QUALITY: Final = 85
_MOST_BYTES: Final = 64 * 2**20
"""Largest file of recorded images that is read; beyond it, images are rendered again."""

_SLACK_S: Final = 1e-3


class Pictures:
    """Last full image of each camera of a run.

    A tracker exposes only a part of the image. The rest is rendered on request from a copy of the
    world at the exposure, which does not affect the run.

    Args:
        world: The world that the cameras are in.
        is_watched: Returns whether a page is watching; otherwise no copies are made.
    """

    def __init__(self, world: RenderableWorld, is_watched: Callable[[], bool]) -> None:
        self._world = world
        self._is_watched = is_watched
        self._latest: dict[str, tuple[Frame, Scenery | None]] = {}
        self._renderer = RayRenderer()
        self._lock = Lock()

    def take(self, arm: str, frame: Frame) -> None:
        """Keep a frame exposed now; its pixels must not change any more."""
        is_part = frame.region != (0, 0, frame.width, frame.height)
        world = self._world if is_part and self._is_watched() else None
        scenery = None if world is None else Scenery.of(world.model, world.data)
        self._latest[arm] = frame, scenery

    def jpeg(self, arm: str) -> bytes | None:
        """Last image of an arm's camera, None before the first."""
        if arm not in self._latest:
            return None
        frame, scenery = self._latest[arm]
        if scenery is None:
            return as_jpeg(frame.image)
        with self._lock:
            whole = rendered(self._renderer, scenery.model, scenery.data(), f"{arm}/{CAMERA}")
        left, top, right, bottom = frame.region
        whole[top:bottom, left:right] = frame.image[top:bottom, left:right]
        return as_jpeg(whole)


def rendered(renderer: RayRenderer, model: mujoco.MjModel, data: mujoco.MjData, name: str) -> Image:
    """Ideal image of a camera, of shape (height, width, 3), RGB, without noise and distortion."""
    camera = model.camera(name).id
    width, height = model.cam_resolution[camera].tolist()
    return renderer.render(model, data, Exposure(camera, width, height))


class PastPictures:
    """Camera images of a record: as stored, or else rendered again without noise and distortion.

    Args:
        past: The record.
    """

    def __init__(self, past: PastView) -> None:
        self._past = past
        self._renderer = RayRenderer()
        self._lock = Lock()
        self._kept: dict[str, list[RecordedFrame]] = {}
        self._size = 0

    def jpeg(self, arm: str, time: float) -> bytes | None:
        """Last image of an arm's camera at a time in s; None for an arm without a camera.

        Raises:
            ReplayError: There is no state at that time.
        """
        with self._lock:
            self._read()
            kept = self._kept.get(arm, [])
            number = bisect_right(kept, time + _SLACK_S, key=lambda picture: picture.stamp)
            if not number:
                whole = self._rendered(arm, time)
                return None if whole is None else as_jpeg(whole)
            picture = kept[number - 1]
            if picture.region == (0, 0, *picture.size):
                return picture.whole
            whole = self._rendered(arm, picture.time)
            left, top, right, bottom = picture.region
            if whole is None or whole.shape[1::-1] != picture.size:
                return picture.whole
            whole[top:bottom, left:right] = picture.image[top:bottom, left:right]
            return as_jpeg(whole)

    def _read(self) -> None:
        """Read the stored images if there are new ones, unless the file is too large."""
        path = self._past.record.folder / FRAMES
        size = path.stat().st_size if path.exists() else 0
        if size == self._size or size > _MOST_BYTES:
            return
        self._size = size
        self._kept = {}
        for picture in recorded_frames(self._past.record):
            self._kept.setdefault(picture.arm, []).append(picture)

    def _rendered(self, arm: str, time: float) -> Image | None:
        with self._past.at(time) as (model, data, indices):
            if arm not in indices or indices[arm].camera < 0:
                return None
            return rendered(self._renderer, model, data, f"{arm}/{CAMERA}")


def as_jpeg(image: Image) -> bytes:
    """JPEG of an image of shape (height, width, 3), RGB."""
    in_order = np.ascontiguousarray(image[:, :, ::-1])
    return bytes(cv2.imencode(".jpg", in_order, (cv2.IMWRITE_JPEG_QUALITY, _QUALITY))[1])


class PastAnswers:
    """Answers to requests on the past of a run.

    Args:
        folder: Folder of the record.
    """

    def __init__(self, folder: Path) -> None:
        self.past = PastView(folder)
        self._pictures = PastPictures(self.past)

    @property
    def questions(self) -> Mapping[str, Asked]:
        """Handlers of requests, by name; each raises `ReplayError` if there is no past yet."""
        return {
            "at": lambda query: PageAnswer.of(self.past.moment(number_in(query, "t"))),
            "series": lambda _: PageAnswer.of(self._series()),
            "why": self._why,
            "eye": self._eye,
        }

    def scene(self, generation: int) -> Json:
        """Shapes of a model of the record, and the names of its meshes."""
        return self.past.looks(generation).scene(generation)

    def _series(self) -> Json:
        """Signals of the record; empty for a run that has hardly begun."""
        try:
            return series_of(self.past.record)
        except (ReplayError, HistoryError):
            return series_text({})

    def _why(self, query: Query) -> PageAnswer:
        asked = query.get("of")
        time = number_in(query, "t") if "t" in query else None
        of = None if asked is None else text_in(query, "of")
        return PageAnswer.of(why_of(self.past.record, of, time))

    def _eye(self, query: Query) -> PageAnswer:
        return PageAnswer.jpeg(self._pictures.jpeg(text_in(query, "arm"), number_in(query, "t")))


class RecordView:
    """Answers to requests on a finished record, which accepts no commands.

    Args:
        folder: Folder of the record.

    Raises:
        ReplayError: There is no record.
    """

    def __init__(self, folder: Path) -> None:
        self._answers = PastAnswers(folder)
        self.past = self._answers.past
        self.past.moment(0.0)

    @property
    def questions(self) -> Mapping[str, Asked]:
        """Handlers of requests, by name."""
        return {
            **self._answers.questions,
            "": lambda _: PageAnswer.page(),
            "now": lambda _: PageAnswer.of(self._now()),
            "log": lambda _: PageAnswer.of(log_of(self.past.record)),
            "scene": self._scene,
            "mesh": lambda query: PageAnswer.numbers(self.past.mesh(text_in(query, "name"))),
        }

    def do(self, asked: Json) -> Json:
        """Refuse every command.

        Raises:
            ViewError: Always.
        """
        raise ViewError(
            f"a record is only looked at: {str(asked.get('action'))[:40]!r} does nothing"
        )

    def _now(self) -> Json:
        record = self.past.record
        until = round(record.until, 4)
        ends = [story.ended_s for story in stories(record) if story.ended_s is not None]
        begin = round(min(ends, default=0.0), 4)
        identity = {"kind": "record", "name": record.name, "until": until, "begin": begin}
        return {**identity, "facts": state_of(record), "recorded": True}

    def _scene(self, query: Query) -> PageAnswer:
        return PageAnswer.of(self._answers.scene(int(number_in(query, "generation"))))


_EVERY: Final = 2
"""Recorded states per state shown: 25 per second."""

_MOST_POSES: Final = 60_000
"""Body poses in a page: a minute at 25 Hz of 40 bodies; a larger record shows fewer states."""

_MOST_EVENTS: Final = 400
"""Status changes whose exact times the page shows in addition."""

_PICTURES: Final = 10.0
_MOST_PICTURES: Final = 300
"""Images per second of each camera, and the largest number per camera."""

_MOST_NODES: Final = 300
_MOST_TIMES: Final = 40
"""Nodes and times for which the page contains the diagnosis of `bt-why`."""


def html_of(record: Record) -> str:
    """The page of a record as one self-contained HTML file, with all data embedded.

    Raises:
        ReplayError: The record has no state, or this MuJoCo cannot read its models.
    """
    text = json.dumps(json_ready(page_data(record)), separators=(",", ":"))
    return whole_page(base64.b64encode(zlib.compress(text.encode(), 9)).decode("ascii"))


def page_data(record: Record) -> Json:
    """All answers that the page needs, JSON-ready, as the server of `bt-replay` gives them.

    Meshes and images are base64; ``moments`` are answers to ``at`` in chronological order, and
    ``why`` has the diagnoses of nodes and of times.
    """
    view = RecordView(record.folder)
    past = view.past

    def answer(what: str, **query: object) -> Data:
        texts = {name: str(value) for name, value in query.items()}
        return json.loads(view.questions[what](texts).content)

    moments = [past.moment(time) for time in _times(record)]
    generations = sorted({moment["generation"] for moment in moments})
    return {
        "now": answer("now"),
        "log": answer("log"),
        "series": answer("series"),
        "scenes": {number: answer("scene", generation=number) for number in generations},
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
    """Simulated times in s that the page can show, sorted."""
    count = len(record.times)
    bodies = max(record.model(number).nbody for number in record.models)
    every = max(_EVERY, -(-count * bodies // _MOST_POSES))
    states = record.times[[*range(0, count, every), count - 1]]
    events = [float(event["time_s"]) for event in record.events[:_MOST_EVENTS]]
    within = [min(max(time, 0.0), record.until) for time in events]
    return sorted({round(time, 4) for time in (*states.tolist(), *within)})


def _pictures(record: Record, view: RecordView, arm: str) -> Iterator[tuple[float, str]]:
    """Yields the time in s and the JPEG, as base64, of images of an arm's camera."""
    taken = [
        note["time_s"] for note in record.notes if (note["kind"], note["arm"]) == ("frame", arm)
    ]
    if not taken:
        return
    taken.sort()
    wanted = max(1, int(_PICTURES * (taken[-1] - taken[0])))
    count = min(len(taken), wanted, _MOST_PICTURES)
    chosen = np.linspace(0, len(taken) - 1, count).astype(int).tolist()
    for time in (round(taken[number], 4) for number in chosen):
        try:
            picture = view.questions["eye"]({"arm": arm, "t": str(time)})
        except DualArmError:  # the arm was not in the world then
            continue
        yield time, _text(picture.content)


def _why_of_nodes(record: Record) -> Json:
    """Diagnoses: of the run, by the empty text, and of each node that ran, by arm and path."""
    ran = [node for node in Timeline(record).nodes() if node.changes]
    asked = [None, *(f"{node.arm}:{node.path}" for node in ran[:_MOST_NODES])]
    return {of or "": _why(record, of) for of in asked}


def _why_at_times(record: Record) -> Iterator[tuple[float, Json]]:
    """Yields diagnoses at the times of status changes and at every second."""
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
