"""Reading a record: validated facts and states of a run, up to the last complete second."""

from __future__ import annotations

import os
from bisect import bisect_right
from collections import Counter, OrderedDict, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    StringConstraints,
    TypeAdapter,
    ValidationError,
    create_model,
)

from bt_dualarm.behaviors.report import StatusName
from bt_dualarm.core.errors import DualArmError, RunError
from bt_dualarm.core.pose import Vector
from bt_dualarm.core.share import kind_at
from bt_dualarm.replay.stored_model import stored_model
from bt_dualarm.robots.mjspec import joint_motors
from bt_dualarm.runtime.history_file import (
    MOST_MEMORY,
    Block,
    HistoryError,
    ModelReader,
    ReadBudget,
    parsed,
    read_history,
    read_regular,
)
from bt_dualarm.runtime.options import checked_reality
from bt_dualarm.runtime.recorder import EVENTS, HISTORY, SUMMARY
from bt_dualarm.sim.frame import RendererKind
from bt_dualarm.spec.document import LONGEST_NAME, ArmSpec, ObjectSpec
from bt_dualarm.spec.node_types import one_line
from bt_dualarm.spec.problems import BodyName, Name
from bt_dualarm.spec.yaml_reader import MAX_DEPTH, MAX_NODES, with_tuples

# Types of all facts of a record, validated before use: a record may come from an untrusted source.
# Names follow the rule of tree files, so that no path can be built from them; labels contain
# no control characters for a terminal. Paths, names of metrics, and facts without a type here
# (ports, values of the blackboard, texts) may have any, and must be escaped when shown.


Facts: TypeAlias = dict[str, Any]
"""A JSON object: an event, a note, the summary, or the start of a run."""

LONGEST_S: Final = 1e6
"""Longest record in simulated seconds: more than ten times the longest run of a tree file."""

_MOST_PORTS: Final = 1000
_ARM_FACTS: Final = ("robot", "gripper", "base", "force_limit", "collision", "camera")
"""Facts of an arm that readers of records require, besides its tree."""

_OPTIONAL_ARM_FACTS: Final = frozenset({"locked"})
"""Facts of an arm that older records lack."""


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("expected text without control characters")
    return text


Label: TypeAlias = Annotated[str, StringConstraints(max_length=300), AfterValidator(_printable)]
_Location: TypeAlias = Annotated[
    str, StringConstraints(min_length=1, max_length=8192), AfterValidator(_printable)
]
_Path: TypeAlias = Annotated[str, StringConstraints(min_length=1, max_length=8192)]
"""Path of a file, with any characters that a file system allows: no-break spaces, line breaks."""

_Code: TypeAlias = Annotated[str, StringConstraints(pattern=r"^([A-Z][A-Z0-9_]*)?$")]
_Text: TypeAlias = Annotated[str, StringConstraints(max_length=100_000)]
_Time: TypeAlias = Annotated[float, Field(ge=0.0, le=LONGEST_S)]
_Stamp: TypeAlias = Annotated[float, Field(ge=-LONGEST_S, le=LONGEST_S)]
_Coordinate: TypeAlias = Annotated[float, Field(ge=-1e10, le=1e10)]
_Pixel: TypeAlias = Annotated[int, Field(ge=0, le=100_000)]
Region: TypeAlias = Annotated[list[_Pixel], Field(min_length=4, max_length=4)]
_Ports: TypeAlias = Annotated[dict[Label, Any], Field(max_length=_MOST_PORTS)]
_NodeName: TypeAlias = Annotated[
    str, StringConstraints(min_length=1, max_length=100, pattern=r"^[^/#{}]*$"),
    AfterValidator(_printable),
]  # fmt: skip


class _Facts(BaseModel):
    """A JSON object; unknown fields are ignored."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False, extra="ignore")


class _Node(_Facts):
    """A node of a tree with its children."""

    kind: Annotated[
        str, StringConstraints(min_length=1, max_length=100), AfterValidator(_printable)
    ]
    name: _NodeName
    ports: _Ports
    place: _Path
    children: list[_Node]


class _Skill(_Facts):
    file: _Path | Literal[""]  # empty for a class that was defined interactively
    sha256: Label


class _Processor(_Facts):
    machine: Label
    blas: Label
    arithmetic: Label


class _Camera(_Facts):
    """Required fields; the types of the tree file validate their values, as for all below."""

    resolution: list[int]
    fov: float
    fps: float
    latency: float
    drop: float


class _Collision(_Facts):
    threshold: float


class _Base(_Facts):
    xyz: list[float]


class _Object(_Facts):
    shape: str
    size: list[float]
    mass: float
    friction: float
    color: str | list[float]
    fixed: bool
    marker: dict[str, Any] | None


class _ArmFacts(_Facts):
    base: _Base
    force_limit: float
    collision: _Collision
    camera: _Camera | None
    robot: Label
    gripper: Label | None
    tree: _Node


class _Start(_Facts):
    name: Annotated[
        str, StringConstraints(min_length=1, max_length=LONGEST_NAME), AfterValidator(_printable)
    ]
    path: _Path
    texts: Annotated[dict[_Path, str], Field(min_length=1, max_length=1000)]
    params: Annotated[dict[Label, Any], Field(max_length=1000)]
    seed: Annotated[int, Field(ge=0, lt=2**32)]
    renderer: RendererKind | None
    reality: Any
    duration: Annotated[float, Field(gt=0.0, le=LONGEST_S)] | None
    faults: Annotated[dict[Name, dict[str, Any]], Field(max_length=200)] = {}
    timestep: Annotated[float, Field(ge=1e-5, le=0.1)]
    time_limit: Annotated[float, Field(gt=0.0, le=LONGEST_S)]
    objects: Annotated[dict[BodyName, _Object], Field(max_length=1000)]
    arms: Annotated[dict[Name, _ArmFacts], Field(min_length=1, max_length=100)]
    pages: Annotated[dict[_Path, Label], Field(max_length=1000)]
    skills: Annotated[dict[Label, _Skill], Field(max_length=1000)]
    versions: Annotated[dict[Label, Label], Field(max_length=1000)]
    processor: _Processor


class _ModelFacts(_Facts):
    generation: Annotated[int, Field(ge=0, le=2**31)]
    cuts: list[list[Any]]


class _Second(_Facts):
    first_step: Annotated[int, Field(ge=0, le=2**40)]
    generation: Annotated[int, Field(ge=0, le=2**31)]
    notes: list[dict[str, Any]]


class _End(_Facts):
    state_sha256: Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{1,128}$")]


class _Note(_Facts):
    kind: Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]{0,47}$")]
    arm: Name
    time_s: _Time


class _Began(_Note):
    leaf: _Location
    ports: _Ports


class _Wrote(_Note):
    leaf: _Location
    key: Label
    value: Any


class _Waits(_Note):
    leaf: _Location
    target: _Text
    others: Annotated[list[Name], Field(max_length=16)]
    since: _Time
    ended: bool = False


class _Frame(_Note):
    stamp: _Stamp
    region: Region
    stride: Annotated[int, Field(ge=1, le=1000)] = 1
    crc: Annotated[int, Field(ge=0, lt=2**32)]


class _Found(_Note):
    stamp: _Stamp
    asked: _Text
    answer: list[Any]


class _Look(_Note):
    stamp: _Stamp
    pixel: Annotated[list[_Coordinate], Field(min_length=2, max_length=2)] | None
    area_px: Annotated[float, Field(ge=0.0, le=1e10)]
    point: Annotated[list[_Coordinate], Field(min_length=3, max_length=3)] | None
    locked: bool


class _Edited(_Note):
    tree: _Node


class _Holds(_Note):
    gripped: list[Label]
    welded: list[Label]


class _Guard(_Note):
    does: Literal["slowed", "stopped"]
    reason: _Text


class _Fault(_Note):
    arm: Name | Literal[""]  # a fault of an object belongs to no arm
    name: Name
    fault: Label
    sentence: _Text
    active: bool
    leaf: Annotated[str, StringConstraints(max_length=8192), AfterValidator(_printable)]
    objects: Annotated[list[BodyName], Field(max_length=16)]


class _Event(_Facts):
    time_s: _Time
    arm: Name
    path: _Location
    kind: Label
    old: StatusName
    new: StatusName
    code: _Code
    reason: _Text
    metrics: dict[str, float | int | bool | str | None]


class _ArmSummary(_Facts):
    guard: dict[Label, float | int | bool | str | None] = {}


class _Summary(_Facts):
    ending: Label
    arms: dict[Name, _ArmSummary]


class _Picture(_Facts):
    arm: Name
    time_s: _Time
    stamp: _Stamp
    region: Region
    stride: Annotated[int, Field(ge=1, le=1000)]
    size: Annotated[list[Annotated[int, Field(ge=1, le=4096)]], Field(min_length=2, max_length=2)]


_NOTES: Final[Mapping[str, TypeAdapter[Any]]] = {
    kind: TypeAdapter(list[fields])  # type: ignore[valid-type]  # a class from a table
    for kind, fields in (
        ("ports", _Began),
        ("wrote", _Wrote),
        ("waits", _Waits),
        ("frame", _Frame),
        ("found", _Found),
        ("look", _Look),
        ("edited", _Edited),
        ("guard", _Guard),
        ("fault", _Fault),
        ("holds", _Holds),
    )
}
_ARM_WITHOUT_TREE: Final = create_model("_RecordedArm", __base__=ArmSpec, tree=(Any, None))
_ANY_NOTE: Final = TypeAdapter(list[_Note])
_EVENTS: Final = TypeAdapter(list[_Event])
_START = TypeAdapter(_Start)
_SECOND = TypeAdapter(_Second)
_END = TypeAdapter(_End)
_MODEL = TypeAdapter(_ModelFacts)
_SUMMARY = TypeAdapter(_Summary)
_PICTURE = TypeAdapter(_Picture)


def check_start(facts: Facts) -> None:
    """Check the start of a run.

    Raises:
        ValueError: A fact is missing, of a wrong type or out of range; the message states where,
            and what is expected.
    """
    # Nodes are counted before anything else, because validating a million of them takes long.
    arms = facts.get("arms")
    for name, facts_of_arm in arms.items() if isinstance(arms, dict) else ():
        check_tree(facts_of_arm, f"start.arms.{str(name)[:48]!r}")
    _check(_START, facts, "start")
    if facts["reality"] is not None:
        try:
            checked_reality(facts["reality"])
        except RunError as error:
            raise ValueError(f"start.{one_line(str(error))}") from error
    for name, spec in facts["objects"].items():
        _check_spec(ObjectSpec, spec, f"start.objects.{name}")
    for name, arm in facts["arms"].items():
        known = {key: arm[key] for key in (*_ARM_FACTS, *(_OPTIONAL_ARM_FACTS & arm.keys()))}
        _check_spec(_ARM_WITHOUT_TREE, known, f"start.arms.{name}")


def check_tree(facts: object, where: str) -> None:
    """Check that the tree below ``tree`` is no larger than one from a tree file can be.

    The facts have not been validated yet.

    Raises:
        ValueError: The tree is too large.
    """
    level = [facts.get("tree")] if isinstance(facts, dict) else []
    depth = count = 0
    while level:
        depth = depth + 1
        count = count + len(level)
        if depth > MAX_DEPTH or count > MAX_NODES:
            raise ValueError(
                f"{where}: its tree has more than {MAX_DEPTH} levels or {MAX_NODES} nodes; "
                "no tree file has"
            )
        below = [node.get("children") for node in level if isinstance(node, dict)]
        level = [child for children in below if isinstance(children, list) for child in children]


def check_model(facts: Facts) -> None:
    """Check the facts of a compiled model; raises the same errors as `check_start`."""
    _check(_MODEL, facts, "model")


def check_second(facts: Facts, arms: Mapping[str, Facts]) -> None:
    """Check the facts of a second of the run, including its notes.

    Args:
        facts: Facts of the second.
        arms: Arms of the run by name.

    Raises:
        ValueError: As for `check_start`.
    """
    _check(_SECOND, facts, "second")
    of_kind: dict[str, list[Facts]] = defaultdict(list)
    for note in facts["notes"]:
        of_kind[str(note.get("kind"))].append(note)
        check_tree(note, "an edited tree")
    for kind, notes in of_kind.items():
        _check(_NOTES.get(kind, _ANY_NOTE), notes, f"notes[{kind[:48]}]")
        for note in notes:
            if note["arm"] or kind != "fault":
                _check_arm(note["arm"], arms, f"a note of kind {kind}")
            if kind in ("frame", "found", "look") and not arms[note["arm"]]["camera"]:
                raise ValueError(f"a note of kind {kind} is of {note['arm']}, which has no camera")


def check_end(facts: Facts) -> None:
    """Check the end of a history; raises the same errors as `check_start`."""
    _check(_END, facts, "end")


def check_events(events: Sequence[Facts], arms: Mapping[str, Facts]) -> None:
    """Check status changes.

    Args:
        events: Changes, in the order of the file.
        arms: Arms of the run by name.

    Raises:
        ValueError: As for `check_start`, or if times decrease.
    """
    _check(_EVENTS, events, "line")
    before = 0.0
    for number, event in enumerate(events, 1):
        _check_arm(event["arm"], arms, f"line {number}")
        if event["time_s"] < before:
            raise ValueError(
                f"line {number}: time_s is {event['time_s']:g}, less than that of the line before"
            )
        before = event["time_s"]


def check_summary(facts: object) -> None:
    """Check the required facts of a summary; raises the same errors as `check_start`."""
    _check(_SUMMARY, facts, "")


def check_picture(facts: Facts) -> None:
    """Check the facts of a recorded image; raises the same errors as `check_start`."""
    _check(_PICTURE, facts, "picture")
    left, top, right, bottom = facts["region"]
    width, height = facts["size"]
    if not (left < right <= width and top < bottom <= height):
        raise ValueError(
            f"picture.region is {facts['region']}; expected a part of {width} by {height} pixels"
        )


def _check_arm(name: str, arms: Mapping[str, Facts], where: str) -> None:
    if name not in arms:
        raise ValueError(f"{where}: there is no arm {name!r}; expected {', '.join(arms)}"[:500])


def _check(
    adapter: TypeAdapter[Any],  # Any: of any model
    facts: object,
    where: str,
) -> None:
    try:
        adapter.validate_python(facts, strict=True)
    except ValidationError as error:
        raise ValueError(_error_text(error, where)) from None


def _check_spec(model: Any, facts: object, where: str) -> None:  # Any: a model or an adapter
    """Check facts with a type of the tree file."""
    if not isinstance(facts, dict):
        raise ValueError(f"{where}: expected a JSON object")
    try:
        model.model_validate(with_tuples(facts))
    except ValidationError as error:
        raise ValueError(_error_text(error, where)) from None


def _error_text(error: ValidationError, where: str) -> str:
    """The first error: its location, message and input."""
    first = error.errors(include_url=False, include_context=False)[0]
    location = ".".join([*filter(None, [where]), *map(str, first["loc"])])
    message = first["msg"].removeprefix("Value error, ")
    given = "" if first["type"] == "missing" else f"; it is {str(first['input'])[:60]!r}"
    return f"{one_line(location)[:300]}: {one_line(message)[:500]}{given}"


__all__ = ["Facts", "HistoryError", "Moment", "Record", "ReplayError"]

_MOST_COMPILED: Final = 4
"""Compiled models kept in memory; one of a large world takes several megabytes."""

_TRIED_AHEAD: Final = 15
"""Models that are tried together with one for which a process has to be started."""

_MOST_JOINTS: Final = 4 * 64
_CLOCK_TOLERANCE: Final = 1e-6
"""Relative rounding error of MuJoCo's clock, which is a sum of steps."""

_SLACK_S: Final = 1e-9


class ReplayError(DualArmError):
    """A record cannot be used as requested; the message states what it has instead."""


@dataclass(frozen=True, eq=False)
class Moment:
    """State of the run at one of the recorded times.

    Attributes:
        time: Simulated time in s.
        generation: Number of the model that the state belongs to.
        qpos: Positions in MuJoCo's order, of shape (nq,).
        qvel: Velocities in MuJoCo's order, of shape (nv,).
    """

    time: float
    generation: int
    qpos: Vector
    qvel: Vector


@dataclass(frozen=True)
class GripperState:
    """State and command of a gripper at one of the recorded times.

    Attributes:
        width: Opening from the encoder, m; 0 for a cup.
        speed: Speed of the opening, positive when opening, m/s; 0 for a cup.
        force: Force of a pad from the motor's current, positive when closing, or of a cup, N.
        vacuum: Fraction of the full vacuum that a cup measures, from 0 to 1; 0 for fingers.
        commanded_width: Commanded opening, m; for a cup 0 turns suction on, any other value off.
        commanded_speed: Commanded speed of the opening, m/s.
        commanded_force: Commanded largest force of a pad, or of a cup, N.
    """

    width: float
    speed: float
    force: float
    vacuum: float
    commanded_width: float
    commanded_speed: float
    commanded_force: float


@dataclass(frozen=True, eq=False)
class Record:
    """Validated content of the record of a run.

    Attributes:
        folder: Folder of the record.
        start: Facts at the start of the run: the tree, seeds, versions, the processor.
        seconds: Blocks of the history with states and checksums, in order.
        models: Each compiled model in MuJoCo's binary format, by its generation.
        events: Status changes, in order.
        notes: Trace events of trees, cameras and guards, in order.
        summary: Content of the summary; None if the run was killed.
        end: Facts at the end of the history; None if the run was killed.
        torn: Sentence on what the end of the history lacks; empty if it is complete.
    """

    folder: Path
    start: Facts
    seconds: tuple[Block, ...]
    models: Mapping[int, bytes]
    events: tuple[Facts, ...]
    notes: tuple[Facts, ...]
    summary: Facts | None
    end: Facts | None
    torn: str

    @classmethod
    def read(cls, folder: Path, most_memory: int = MOST_MEMORY) -> Record:
        """Read a record, which may come from an untrusted source.

        All of it is validated first: files, sizes, types, names, shapes, and the consistency of its
        parts. Models are validated on first use.

        Args:
            folder: Folder given by ``--record``.
            most_memory: Largest size of the record in memory, bytes.

        Raises:
            ReplayError: There is no such folder, or no record in it.
            HistoryError: A file cannot be read, is invalid, or takes too much memory; the message
                names the file, the error, and what is expected.
        """
        if kind_at(folder) != "folder":
            if kind_at(folder):
                raise ReplayError(f"{folder} is a file; a record is the folder of bt-run --record")
            raise ReplayError(f"there is no folder {folder}")
        if not os.path.lexists(folder / HISTORY):
            raise ReplayError(f"{folder} contains no record: there is no {HISTORY} in it")
        budget = ReadBudget(most_memory)
        file = read_history(folder / HISTORY, budget)
        if not file.blocks or file.blocks[0].kind != "start":
            raise HistoryError(f"{folder / HISTORY} has no whole block: the run had barely begun")
        start: Facts = dict(file.blocks[0].data)
        with _errors_name(folder / HISTORY):
            check_start(start)
            models, seconds, ends = _blocks_of_run(start, file.blocks[1:])
        arms: Mapping[str, Facts] = start["arms"]
        with _errors_name(folder / EVENTS):
            events = _lines(folder / EVENTS, budget)
            check_events(events, arms)
        with _errors_name(folder / SUMMARY):
            summary = _summary(folder / SUMMARY, budget)
        if summary is not None and not os.path.lexists(folder / EVENTS):
            raise HistoryError(f"{folder} is not complete: there is no {EVENTS} in it")
        return cls(
            folder=folder,
            start=start,
            seconds=seconds,
            models=models,
            events=tuple(events),
            notes=tuple(note for block in seconds for note in _notes(block)),
            summary=summary,
            end=ends[0] if ends else None,
            torn=file.torn,
        )

    @property
    def name(self) -> str:
        """Name of the tree file."""
        return str(self.start["name"])

    @property
    def arms(self) -> Mapping[str, Facts]:
        """Facts of each arm in the file, including its tree, by name."""
        arms: Mapping[str, Facts] = self.start["arms"]
        return arms

    @cached_property
    def times(self) -> npt.NDArray[np.float64]:
        """Simulated seconds of all recorded states, of shape (n,)."""
        found = [block.arrays["states"][:, 0] for block in self._framed]
        return np.concatenate(found) if found else np.empty(0)

    @cached_property
    def _framed(self) -> list[Block]:
        return [block for block in self.seconds if "states" in block.arrays]

    @cached_property
    def _firsts(self) -> list[int]:
        """Index of the first state of each block, and the number of all states."""
        counts = [len(block.arrays["states"]) for block in self._framed]
        return [0, *np.cumsum(counts).tolist()]

    @property
    def until(self) -> float:
        """Simulated time of the last state in s; 0 if there is none."""
        return float(self.times[-1]) if len(self.times) else 0.0

    @property
    def steps(self) -> int:
        """Number of recorded physics steps."""
        return sum(len(block.arrays["checksums"]) for block in self.seconds)

    def checksums(self) -> npt.NDArray[np.uint32]:
        """Checksum of the state after each physics step, of shape (steps,)."""
        found = [block.arrays["checksums"] for block in self.seconds]
        return np.concatenate(found).astype(np.uint32) if found else np.empty(0, np.uint32)

    def index_at(self, time: float) -> int:
        """Index of the last state at or before a time; 0 for times before the first state.

        Raises:
            ReplayError: The time is outside the record, or there is no state.
        """
        if not len(self.times):
            raise ReplayError(
                f"{self.folder} contains no state: the first second of the run was not written"
            )
        if not -_SLACK_S <= time <= self.until + 1.0:
            raise ReplayError(
                f"{time:g} s is outside the record, which goes from 0 to {self.until:.2f} s"
            )
        return max(0, int(np.searchsorted(self.times, time + _SLACK_S, "right")) - 1)

    def moment(self, index: int) -> Moment:
        """A state by its index."""
        number = bisect_right(self._firsts, index) - 1
        block = self._framed[number]
        row = block.arrays["states"][index - self._firsts[number]]
        generation = _generation(block)
        nq = self.model(generation).nq
        return Moment(float(row[0]), generation, row[1 : 1 + nq].copy(), row[1 + nq :].copy())

    def arm_row(self, arm: str, index: int) -> tuple[Vector, Vector, Vector, Vector] | None:
        """Position, velocity, acceleration of an arm's set-point, and torque, each of shape (dof,).

        None if the arm was not in the world. Units are rad, rad/s, rad/s² and N m.
        """
        number = bisect_right(self._firsts, index) - 1
        rows = self._framed[number].arrays.get(f"arm:{arm}")
        at = index - self._firsts[number]
        if rows is None or at >= len(rows):
            return None
        q, v, a, torque = rows[at].astype(float).reshape(4, -1)
        return q, v, a, torque

    def gripper(self, arm: str, index: int) -> GripperState | None:
        """State and command of an arm's gripper.

        None if the arm has none or was not in the world, and in records of older versions.
        """
        number = bisect_right(self._firsts, index) - 1
        rows = self._framed[number].arrays.get(f"gripper:{arm}")
        at = index - self._firsts[number]
        if rows is None or at >= len(rows):
            return None
        return GripperState(*rows[at].astype(float).tolist())

    def lives(self, arm: str, generation: int) -> int:
        """Number of stays in the world that an arm has begun by a generation of the world.

        Raises:
            ReplayError: As `model`, which is read for generations that lasted for no state.
        """
        return self._lives[generation].get(arm, 0)

    @cached_property
    def _lives(self) -> Mapping[int, Mapping[str, int]]:
        """Number of stays that each arm has begun, by generation and name."""
        present = dict[int, set[str]]()
        for block in self._framed:
            names = present.setdefault(_generation(block), set())
            names.update(arm for _, arm, _ in _rows_of_arms(block))
        lives = Counter[str]()
        before = set[str]()
        found = dict[int, Mapping[str, int]]()
        for number in sorted(self.models):
            if number not in present:
                model = self.model(number)
                present[number] = {arm for arm in self.arms if len(joint_motors(model, arm))}
            lives.update(present[number] - before)
            before = present[number]
            found[number] = dict(lives)
        return found

    @cached_property
    def _compiled(self) -> OrderedDict[int, mujoco.MjModel]:
        return OrderedDict()

    def model(self, generation: int) -> mujoco.MjModel:
        """A compiled model of the run; the most recently used ones are cached.

        Raises:
            ReplayError: The model is missing, this MuJoCo cannot read it (it was written by another
                version, or is damaged), or it does not match the states of the record.
        """
        if generation not in self.models:
            raise ReplayError(f"{self.folder} lacks the model of generation {generation}")
        if generation not in self._compiled:
            first: dict[int, list[Vector]] = {}
            for block in self._framed:
                first.setdefault(_generation(block), [block.arrays["states"][0]])
            known = sorted(self.models)
            following = known[known.index(generation) + 1 :][:_TRIED_AHEAD]
            others = [(self.models[one], first.get(one, [])) for one in following]
            where = f"{self.folder / HISTORY}: the model of generation {generation}"
            try:
                model = stored_model(self.models[generation], first.get(generation, []), others)
                self._compare_with(model, generation)
            except ValueError as error:
                wrote = self.start["versions"].get("mujoco", "?")
                other = (
                    ""
                    if wrote == mujoco.__version__
                    else (f"; MuJoCo {mujoco.__version__} reads it, {wrote} wrote it")
                )
                raise ReplayError(f"{where}: {error}{other}") from error
            self._compiled[generation] = model
        self._compiled.move_to_end(generation)
        while len(self._compiled) > _MOST_COMPILED:
            self._compiled.popitem(last=False)
        return self._compiled[generation]

    def _compare_with(self, model: mujoco.MjModel, generation: int) -> None:
        """Check that states and arms' rows match a model.

        Raises:
            ValueError: They do not match it.
        """
        for block in self._framed:
            if _generation(block) != generation:
                continue
            columns = block.arrays["states"].shape[1]
            if columns != 1 + model.nq + model.nv:
                raise ValueError(
                    f"states have {columns} columns; it has {model.nq} positions and {model.nv} "
                    "velocities"
                )
            for kind, arm, rows in _rows_of_arms(block):
                dof = rows.shape[1] // 4
                if kind == "arm" and len(joint_motors(model, arm)) != dof:
                    raise ValueError(
                        f"{arm} has {len(joint_motors(model, arm))} joints with motors; the record "
                        f"has set-points of {dof}"
                    )
        for name in self.start["objects"]:
            body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
            if body >= 0 and not model.body_geomnum[body]:
                raise ValueError(f"object {name} has no shape")
        for name, arm_facts in self.arms.items():
            camera = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, f"{name}/camera")
            if camera >= 0 and not arm_facts["camera"]:
                raise ValueError(f"{name} has a camera, which the file did not give it")


def _generation(block: Block) -> int:
    number: Any = block.data["generation"]
    return int(number)


def _notes(block: Block) -> list[Facts]:
    notes: Any = block.data.get("notes", [])
    return list(notes)


def _blocks_of_run(
    start: Facts, blocks: Sequence[Block]
) -> tuple[ModelReader, tuple[Block, ...], list[Facts]]:
    """Models, seconds, and facts of the end; blocks of other kinds are ignored.

    Raises:
        ValueError: A block is invalid.
    """
    models = ModelReader()
    seconds = list[Block]()
    ends = list[Facts]()
    steps = 0
    time = 0.0
    for number, block in enumerate(blocks, 1):
        try:
            if block.kind == "model":
                check_model(dict(block.data))
                models.add(block)
            elif block.kind == "second":
                check_second(dict(block.data), start["arms"])
                steps, time = _checked_numbers(block, start, models, steps, time)
                seconds.append(block)
            elif block.kind == "end":
                check_end(dict(block.data))
                ends.append(dict(block.data))
        except ValueError as error:
            raise ValueError(f"block {number}: {error}") from error
    return models, tuple(seconds), ends


def _checked_numbers(
    block: Block, start: Facts, models: Mapping[int, bytes], steps: int, time: float
) -> tuple[int, float]:
    """Check the arrays of a second.

    Args:
        block: The second.
        start: Facts at the start of the run.
        models: Models so far.
        steps: Number of steps before this second.
        time: Time of the last state before this second, s.

    Returns:
        Number of steps and time of the last state in s, including this second.

    Raises:
        ValueError: The arrays do not match each other, the model or the seconds before.
    """
    if _generation(block) not in models:
        raise ValueError(f"there is no model of generation {_generation(block)} before it")
    if block.data["first_step"] != steps:
        raise ValueError(f"first_step is {block.data['first_step']}; expected {steps}")
    checksums = _array(block, "checksums", np.uint32, 1)
    rows = _array(block, "rows", np.uint32, 1).astype(np.int64)
    if len(rows) and not (
        (np.diff(rows) > 0).all() and steps <= rows[0] and rows[-1] < steps + len(checksums)
    ):
        raise ValueError(
            f"rows are not ascending numbers of steps from {steps} to {steps + len(checksums) - 1}"
        )
    if "states" not in block.arrays:
        if len(rows):
            raise ValueError(f"array 'states' is missing; rows has {len(rows)}")
        return steps + len(checksums), time
    states = _array(block, "states", np.float64, 2)
    if not len(rows) or states.shape[0] != len(rows) or states.shape[1] < 1:
        raise ValueError(f"states is of shape {states.shape}; rows has {len(rows)}")
    expected = (rows + 1) * float(start["timestep"])
    if (np.abs(states[:, 0] - expected) > _CLOCK_TOLERANCE * (1.0 + expected)).any():
        raise ValueError("times of states are not those of their steps")
    if expected[-1] > LONGEST_S:
        raise ValueError(f"the run is longer than {LONGEST_S:g} s")
    for kind, arm, values in _rows_of_arms(block):
        name = f"{kind}:{arm[:80]}"
        if arm not in start["arms"]:
            raise ValueError(f"array {name!r} is of no arm of the run")
        if values.ndim != 2 or values.dtype != np.float32 or len(values) > len(rows):
            raise ValueError(
                f"array {name!r} is {values.dtype} of shape {values.shape}; "
                f"expected float32 of up to {len(rows)} rows"
            )
        columns = values.shape[1]
        if kind == "arm" and (not 4 <= columns <= _MOST_JOINTS or columns % 4):
            raise ValueError(f"array {name!r} has {columns} columns; expected 4 for each joint")
        if kind == "gripper" and columns != len(fields(GripperState)):
            raise ValueError(
                f"array {name!r} has {columns} columns; expected {len(fields(GripperState))}"
            )
        _refuse_infinite(values, name)
    _refuse_infinite(states, "states")
    return steps + len(checksums), float(states[-1, 0])


def _rows_of_arms(block: Block) -> Iterator[tuple[str, str, npt.NDArray[np.generic]]]:
    """Yields the rows of arms and grippers: ``arm`` or ``gripper``, name of the arm, rows."""
    for name, rows in block.arrays.items():
        kind, colon, arm = name.partition(":")
        if colon and kind in ("arm", "gripper"):
            yield kind, arm, rows


def _array(
    block: Block, name: str, kind: type[np.generic], dimensions: int
) -> npt.NDArray[Any]:  # Any: of the kind that is asked for
    if name not in block.arrays:
        raise ValueError(f"array {name!r} is missing")
    array = block.arrays[name]
    if array.dtype != np.dtype(kind) or array.ndim != dimensions:
        raise ValueError(
            f"array {name!r} is {array.dtype} of shape {array.shape}; "
            f"expected {np.dtype(kind)} of {dimensions} dimensions"
        )
    return array


def _refuse_infinite(array: npt.NDArray[Any], name: str) -> None:  # Any: of any numbers
    # Beyond MuJoCo's mjMAXVAL a simulation has diverged, and no state is recorded.
    if not (np.abs(array) <= mujoco.mjMAXVAL).all():
        raise ValueError(f"array {name!r} has numbers that are not finite, or beyond 1e10")


def _lines(path: Path, budget: ReadBudget) -> list[Facts]:
    """JSON objects of a file, one per line; an incomplete last line is ignored.

    Raises:
        ValueError: A line is not a JSON object.
    """
    if not os.path.lexists(path):
        return []
    events = []
    for number, line in enumerate(read_regular(path).split(b"\n")[:-1], 1):
        try:
            event = parsed(line, budget)
        except ValueError as error:
            raise ValueError(f"line {number}: {error}") from error
        events.append(event)
    return events


def _summary(path: Path, budget: ReadBudget) -> Facts | None:
    """The summary; None if the run was killed.

    Raises:
        ValueError: The summary is invalid.
    """
    if not os.path.lexists(path):
        return None
    content: Facts = parsed(read_regular(path), budget)
    check_summary(content)
    return content


@contextmanager
def _errors_name(path: Path) -> Iterator[None]:
    """Turn a ValueError of the block into a HistoryError that names the file."""
    try:
        yield
    except ValueError as error:
        raise HistoryError(f"{path}: {error}") from error
