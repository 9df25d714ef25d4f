"""Observations of a run: its event feed, and images, state hash and frame logs for the record.

The event feed has status changes for observers, captured log lines, and journals on disk.
"""

from __future__ import annotations

import hashlib
import logging
import os
import threading
import zlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, Final

import mujoco
import numpy as np

from bt_dualarm.behaviors.report import KeyWritten, StatusChange, TraceEvent
from bt_dualarm.control.controller import JointController
from bt_dualarm.core.later import Later
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.core.share import encodable
from bt_dualarm.runtime.arm_runtime import FaultObserver, IdleObserver, Observer, RunView
from bt_dualarm.runtime.clock import Periodic, exact
from bt_dualarm.runtime.history_file import Block, HistoryWriter
from bt_dualarm.runtime.summary import json_ready
from bt_dualarm.sim.frame import Frame, FrameFinding, JsonList, Region
from bt_dualarm.sim.grippers import Attachment
from bt_dualarm.sim.world import World
from bt_dualarm.skill.cell import CellWait
from bt_dualarm.spec.faults import FaultEvent

if TYPE_CHECKING:
    import cv2
else:
    cv2 = Later("cv2")

_log = logging.getLogger(__name__)

MOST_BYTES: Final = 500 * 2**20
"""Largest size of the images of a run; later ones are dropped, with a note in the file."""

QUALITY: Final = 92
"""JPEG quality; a lossless image would consist mostly of sensor noise."""


class PictureFile:
    """File with the exposed region of every frame, one block each.

    Args:
        path: File to write, created with the first frame.
        most_bytes: Largest size of the images, bytes.
    """

    def __init__(self, path: Path, most_bytes: int = MOST_BYTES) -> None:
        self._writer = HistoryWriter(path)
        self._left: int | None = most_bytes

    def add(self, arm: str, time: float, frame: Frame) -> None:
        """Write a frame; a write error ends the file, not the run.

        Args:
            arm: Name of the camera's arm.
            time: Simulated time of the exposure in s; the stamp is that of the camera's clock.
            frame: The frame.
        """
        left, top, right, bottom = frame.region
        if self._left is None or right <= left or bottom <= top:
            return
        part = frame.image[top : bottom : frame.stride, left : right : frame.stride, ::-1]
        options = (cv2.IMWRITE_JPEG_QUALITY, QUALITY)
        content = cv2.imencode(".jpg", np.ascontiguousarray(part), options)[1]
        data = {
            "arm": arm,
            "time_s": time,
            "stamp": float(frame.stamp),
            "region": list(frame.region),
            "stride": frame.stride,
            "size": [frame.width, frame.height],
        }
        self._left -= len(content)
        if self._left < 0:
            self._end(time, "the size limit for images of a run is reached")
        else:
            self._write(time, Block("picture", data, {"jpeg": content.ravel()}))

    def _end(self, time: float, why: str) -> None:
        if self._left is not None:
            self._left = None
            _log.warning("images are stored up to %.2f s: %s", time, why)
            self._write(time, Block("end", {"time_s": time, "why": why}))

    def _write(self, time: float, block: Block) -> None:
        try:
            self._writer.add(block)
        except OSError as error:
            self._end(time, error.strerror or str(error))

    def close(self) -> None:
        """Close the file."""
        self._writer.close()


HASH_PERIOD = Fraction(1, 50)
"""Seconds between two states that the hash covers."""

LAST_STATES = 250
"""States written if the simulation diverges: half a second at 2 ms a step."""


class StateLog(IdleObserver):
    """SHA-256 of time, positions and velocities, and a ring buffer of the last states.

    Args:
        world: The world; the size of its state may change.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._due = Periodic(HASH_PERIOD, exact(world.timestep))
        self._steps = 0
        self._data: mujoco.MjData | None = None
        self._hash = hashlib.sha256()
        self._count = 0  # states of the current size so far; the last ones are in the ring
        self._times: Vector = np.zeros(LAST_STATES)
        self._ring: list[Matrix] = []

    @property
    def sha256(self) -> str:
        """Hash in hexadecimal; equal for runs with bitwise equal states."""
        return self._hash.hexdigest()

    def after_step(self, time: float) -> None:
        """Keep the state after the step, and hash it if that is due."""
        if self._world.data is not self._data:
            self._bind(self._world.data)
        row = self._count % LAST_STATES
        self._times[row] = time
        q, v, ctrl = self._views
        self._q[row] = q
        self._v[row] = v
        self._ctrl[row] = ctrl
        self._count += 1
        if self._due.due(self._steps):
            for part in (np.float64(time), q, v):
                self._hash.update(part.tobytes())
        self._steps += 1

    def _bind(self, data: mujoco.MjData) -> None:
        """Read another state from now on; if its size differs, clear the ring."""
        # Views, because looking a field up costs more than copying it.
        self._data = data
        self._views = (data.qpos, data.qvel, data.ctrl)
        if [part.shape[1] for part in self._ring] != [len(view) for view in self._views]:
            self._count = 0
            self._ring = [np.empty((LAST_STATES, len(view))) for view in self._views]
            self._q, self._v, self._ctrl = self._ring

    def write_last(self, file: BinaryIO) -> None:
        """Write those last states that have the size of the final one, as a NumPy archive.

        Arrays: ``time`` in s, and ``qpos``, ``qvel``, ``ctrl`` in MuJoCo's order, one row per step.
        """
        kept = min(self._count, LAST_STATES)
        rows = np.arange(self._count - kept, self._count) % LAST_STATES
        names = ("time", "qpos", "qvel", "ctrl")
        states = (self._times, *(self._ring or np.empty((3, 0))))
        columns = {name: state[rows] for name, state in zip(names, states, strict=True)}
        np.savez_compressed(file, allow_pickle=False, **columns)


MOST_FAULTS: Final = 1000
"""Starts and ends of faults that are kept for the result of a run."""


class FaultLog(IdleObserver):
    """Observer that keeps the injected faults of a run."""

    def __init__(self) -> None:
        self._events: list[FaultEvent] = []

    @property
    def events(self) -> tuple[FaultEvent, ...]:
        """Starts and ends of faults, in order."""
        return tuple(self._events)

    def on_fault(self, event: FaultEvent) -> None:
        """Keep an event."""
        if len(self._events) < MOST_FAULTS:
            self._events.append(event)


class TraceEvents:
    """Buffer of trace events between two frames of a history: ports, keys, frames, guards, ...

    Each event is a JSON-ready mapping whose first key is ``kind``.

    Args:
        clock: Returns simulated time in seconds; set once the world exists.

    Attributes:
        readers: Callbacks that receive each event at once.
        frame_readers: Callbacks that receive each frame with the arm's name.
    """

    def __init__(self, clock: Callable[[], float] = lambda: 0.0) -> None:
        self.clock = clock
        self._events: list[dict[str, object]] = []
        self._guards: dict[str, tuple[object, object]] = {}
        self._attached: tuple[Attachment, ...] = ()
        self._held: dict[str, tuple[tuple[str, bool], ...]] = {}
        self.readers: list[Callable[[dict[str, object]], object]] = []
        self.frame_readers: list[Callable[[str, Frame], object]] = []

    def take(self) -> list[dict[str, object]]:
        """Return and clear the buffered events."""
        taken = self._events
        self._events = []
        return taken

    def of_tree(self, note: TraceEvent) -> None:
        """Add an event of a leaf that has begun or has written a key."""
        if isinstance(note, KeyWritten):
            self._add_fields(
                "wrote", note.arm, note.time, leaf=note.path, key=note.key, value=note.value
            )
        else:
            self._add_fields("ports", note.arm, note.time, leaf=note.path, ports=note.ports)

    def of_wait(self, wait: CellWait) -> None:
        """Add an event of a node that waits for other arms."""
        self._add_fields(
            "waits",
            wait.arm,
            self.clock(),
            leaf=wait.path,
            target=wait.target,
            others=list(wait.others),
            since=wait.since,
            ended=wait.is_over,
        )

    def of_fault(self, event: FaultEvent) -> None:
        """Add the start or the end of an injected fault."""
        self._add_fields(
            "fault",
            event.arm,
            event.time,
            name=event.name,
            fault=event.kind,
            sentence=event.sentence,
            active=event.is_active,
            leaf=event.leaf,
            objects=list(event.objects),
        )

    def of_frame(self, arm: str, frame: Frame, crc: int | None = None) -> None:
        """Add a captured frame: its region, stride and a checksum of its pixels.

        Args:
            arm: Name of the arm.
            frame: The frame.
            crc: Checksum, if it is already known.
        """
        left, top, right, bottom = frame.region
        event = {"kind": "frame", "arm": arm, "time_s": self.clock(), "stamp": float(frame.stamp)}
        if crc is None:
            crc = zlib.crc32(frame.image[top:bottom, left:right].tobytes())
        part = {"region": (left, top, right, bottom), "stride": frame.stride}
        self._add({**event, **part, "crc": crc})
        for read in self.frame_readers:
            read(arm, frame)

    def of_answer(self, arm: str, stamp: float, question: str, answer: JsonList) -> None:
        """Add the answer to a question about a frame, with all bits of its numbers."""
        event = {"kind": "found", "arm": arm, "time_s": self.clock(), "stamp": float(stamp)}
        self._add({**event, "asked": question, "answer": answer})

    def of_look(self, arm: str, look: FrameFinding) -> None:
        """Add the result of a search for the target in a frame."""
        event = {"kind": "look", "arm": arm, "time_s": self.clock(), "stamp": float(look.stamp)}
        pixel = look.pixel and (round(float(look.pixel[0]), 2), round(float(look.pixel[1]), 2))
        point = look.point and tuple(round(float(x), 6) for x in look.point)
        area = round(float(look.area_px), 1)
        found = {"pixel": pixel, "area_px": area, "point": point, "locked": bool(look.locked)}
        self._add({**event, **found})

    def of_edit(self, arm: str, tree: Mapping[str, object]) -> None:
        """Add the replacement of an arm's tree."""
        self._add_fields("edited", arm, self.clock(), tree=tree)

    def of_guard(self, arm: str, controller: JointController) -> None:
        """Add an event if the guard has slowed or stopped the arm since the last call."""
        guard = controller.guard
        now = guard.get("slowed", 0), guard.get("stopped", 0)
        before = self._guards.get(arm, (0, 0))
        self._guards[arm] = now
        if now == before:
            return
        action = "stopped" if now[1] != before[1] else "slowed"
        self._add_fields(
            "guard", arm, self.clock(), does=action, reason=guard.get("last_reason", "")
        )

    def of_holding(self, held: Iterable[Attachment]) -> None:
        """Add an event for each arm whose held objects have changed since the last call."""
        attached = tuple(held)
        if attached == self._attached:
            return
        self._attached = attached
        now: dict[str, tuple[tuple[str, bool], ...]] = {}
        for one in attached:
            now[one.arm] = (*now.get(one.arm, ()), (one.object, one.by_gripper))
        for arm in sorted(now.keys() | self._held.keys()):
            holds = now.get(arm, ())
            if holds != self._held.get(arm, ()):
                gripped = [name for name, by_gripper in holds if by_gripper]
                welded = [name for name, by_gripper in holds if not by_gripper]
                self._add_fields("holds", arm, self.clock(), gripped=gripped, welded=welded)
        self._held = now

    def _add_fields(self, kind: str, arm: str, time: float, **fields: object) -> None:
        event = {"kind": kind, "arm": arm, "time_s": time, **fields}
        self._add({name: json_ready(value) for name, value in event.items()})

    def _add(self, event: dict[str, object]) -> None:
        self._events.append(event)
        for read in self.readers:
            read(event)


@dataclass(frozen=True)
class KnownFrame:
    """A frame of a record, with the findings in it.

    Attributes:
        region: Exposed region of the image.
        stride: Edge of the blocks of pixels that share one sample.
        crc: Checksum of its pixels.
        answers: Findings in the frame, by question.
    """

    region: Region
    stride: int
    crc: int
    answers: Mapping[str, JsonList]


@dataclass
class FrameLog:
    """Findings in the frames of one camera: recorded, or recalled from a record (a `Memory`).

    Attributes:
        arm: Name of the camera's arm.
        trace: Trace events to add to, None if nothing is recorded.
        images: File that stores the images, None if they are not stored.
        known: Frames of an earlier run by their stamp; they are rendered again only for a question
            without a recorded answer.
        taken: Number of frames recalled instead of rendered.
        drawn: Number of recalled frames that had to be rendered after all.
    """

    arm: str
    trace: TraceEvents | None = None
    pictures: PictureFile | None = None
    known: Mapping[float, KnownFrame] = field(default_factory=dict)
    taken: int = 0
    drawn: int = 0

    @property
    def keeps(self) -> bool:
        """Whether findings are recorded or recalled."""
        return self.trace is not None or bool(self.known)

    def knows(self, stamp: float, region: Region, stride: int) -> bool:
        """Whether such a frame, with its findings, is known from an earlier run."""
        picture = self.known.get(stamp)
        if picture is None or (picture.region, picture.stride) != (region, stride):
            return False
        self.taken += 1
        return True

    def recall(self, stamp: float, question: str, look: Callable[[], JsonList]) -> JsonList:
        """Recorded answer to a question about a frame, or else the answer of ``look``."""
        picture = self.known.get(stamp)
        if picture is not None and question in picture.answers:
            answer = picture.answers[question]
        else:
            self.drawn += picture is not None
            answer = look()
        if self.trace is not None:
            self.trace.of_answer(self.arm, stamp, question, answer)
        return answer

    def add(self, frame: Frame) -> None:
        """Record a captured frame."""
        if self.trace is not None:
            picture = self.known.get(frame.stamp)
            self.trace.of_frame(self.arm, frame, None if picture is None else picture.crc)
            if self.pictures is not None:
                self.pictures.add(self.arm, self.trace.clock(), frame)


_log = logging.getLogger(__name__)


class StatusFeed:
    """Collects the status changes of a tick and reports them to observers after all trees ticked.

    An observer that raises (a display whose terminal is gone) is dropped: observers cannot affect
    the arms.

    Args:
        observers: Observers, notified in this order.
    """

    def __init__(self, observers: Sequence[Observer] = ()) -> None:
        self._observers: tuple[Observer, ...] = ()
        self._of_steps: tuple[Observer, ...] = ()
        self._changes: list[StatusChange] = []
        self.watch(*observers)

    def watch(self, *observers: Observer) -> None:
        """Notify more observers from now on, after those before them."""
        self._observers += observers
        # Most observers need no single steps, of which there are 500 in a simulated second.
        self._of_steps = tuple(
            one for one in self._observers if type(one).after_step is not IdleObserver.after_step
        )

    def add(self, change: StatusChange) -> None:
        """Collect a change; called by trees during their ticks."""
        self._changes.append(change)

    def after_ticks(self, run: RunView) -> None:
        """Report the changes, then that trees were ticked."""
        changes = self._changes
        self._changes = []
        for observer in self._observers:
            try:
                for change in changes:
                    observer.on_event(change)
                observer.after_ticks(run)
            except Exception as error:  # noqa: BLE001 - see `_drop`
                self._drop(observer, error)

    def after_step(self, time: float) -> None:
        """Report a physics step that ended at ``time``, s."""
        for observer in self._of_steps:
            try:
                observer.after_step(time)
            except Exception as error:  # noqa: BLE001 - see `_drop`
                self._drop(observer, error)

    def on_fault(self, event: FaultEvent) -> None:
        """Report the start or the end of an injected fault to those who want to know."""
        for observer in self._observers:
            if not isinstance(observer, FaultObserver):
                continue
            try:
                observer.on_fault(event)
            except Exception as error:  # noqa: BLE001 - see `_drop`
                self._drop(observer, error)

    def _drop(self, observer: Observer, error: Exception) -> None:
        """Remove an observer, so that its error does not end the run."""
        left = tuple(other for other in self._observers if other is not observer)
        self._observers = ()
        self.watch(*left)
        name = type(observer).__name__
        _log.warning("observer %s was dropped: %r", name, error, exc_info=error)


LOGGER: Final = logging.getLogger("bt_dualarm")
"""Parent of all loggers of the package and of its skills."""

LOGGER.addHandler(logging.NullHandler())  # a library does not print by itself

MOST_LINES: Final = 10_000
"""Lines buffered until taken; without a record nothing takes them, so the buffer is bounded."""

_active_capture: ContextVar[LogCapture | None] = ContextVar("capture", default=None)


class LogCapture(logging.Handler):
    """Captures log lines, tracebacks included, while its run is advanced.

    Several runs may be open at once, even in several threads: each captures its own lines only.
    The logger's level is restored when none of them is being advanced.
    """

    def __init__(self) -> None:
        super().__init__()
        self._lines: deque[str] = deque(maxlen=MOST_LINES)

    def take(self) -> list[str]:
        """Lines logged since the last call, in order."""
        lines = list(self._lines)
        self._lines.clear()
        return lines

    @contextmanager
    def during(self) -> Iterator[None]:
        """Capture what this thread logs in the block."""
        token = _active_capture.set(self)
        _log_level.enter()
        LOGGER.addHandler(self)
        try:
            yield
        finally:
            LOGGER.removeHandler(self)
            _log_level.leave()
            _active_capture.reset(token)

    def emit(self, record: logging.LogRecord) -> None:
        """Format and keep a line that belongs to this run."""
        if _active_capture.get() is self:
            self._lines.append(self.format(record))


class _LogLevel:
    """Level of the logger: at least INFO while there are captures, otherwise unchanged."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._captures = 0
        self._level = logging.NOTSET

    def enter(self) -> None:
        with self._lock:
            if not self._captures:
                self._level = LOGGER.level
                LOGGER.setLevel(min(LOGGER.getEffectiveLevel(), logging.INFO))
            self._captures += 1

    def leave(self) -> None:
        with self._lock:
            self._captures -= 1
            if not self._captures:
                LOGGER.setLevel(self._level)


_log_level = _LogLevel()


class Journal:
    """Text file that grows line by line; each addition is one system call.

    Its lines survive a run that is killed. A write error does not end the run; `finish` raises it.
    What is added after `close` is left out: a run whose record is withdrawn still ends.

    Args:
        path: The file, created with the first lines.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: int | None = None
        self._failure: OSError | None = None
        self._is_closed = False

    def add(self, text: str) -> None:
        """Append whole lines."""
        if self._failure is not None or self._is_closed or not text:
            return
        try:
            self._write(encodable(text).encode())
        except OSError as error:
            self._failure = error
            _log.warning("%s is no longer written during the run: %s", self._path.name, error)

    def finish(self) -> None:
        """Flush everything to the disk; creates an empty file if there were no lines.

        Raises:
            OSError: A line could not be written, or the file is gone.
        """
        if self._failure is not None:
            raise self._failure
        self._write(b"")
        if self._file is not None:
            self._path.stat()  # raises if the folder was deleted meanwhile
            os.fsync(self._file)

    def close(self) -> None:
        """Close the file."""
        self._is_closed = True
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def _write(self, text: bytes) -> None:
        if self._file is None:
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND
            self._file = os.open(self._path, flags, 0o644)
        while text:
            text = text[os.write(self._file, text) :]
