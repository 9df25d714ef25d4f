"""What a record may say: the type of every fact, checked before anybody relies on it.

A record may come from a stranger. Names keep to the rule of tree files, so that no path can be
built from them; labels have no character that a terminal would act on. What has no type of its own
here (ports, values of the blackboard, texts) is any JSON: whoever shows it escapes it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Final, Literal, TypeAlias

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

from bt_dualarm.errors import RunError
from bt_dualarm.runtime.options import checked_reality
from bt_dualarm.spec.document import LONGEST_NAME, ArmSpec, ObjectSpec
from bt_dualarm.spec.name import Name
from bt_dualarm.spec.reader import MAX_DEPTH, MAX_NODES
from bt_dualarm.spec.source import with_tuples
from bt_dualarm.spec.wording import one_line
from bt_dualarm.tree.report import StatusName
from bt_dualarm.world.rendering.renderer import RendererKind

Facts: TypeAlias = dict[str, Any]
"""An object of JSON: an event, a note, the summary, what the run began with."""

LONGEST_S: Final = 1e6
"""Simulated seconds of a record: more than ten times what a tree file may ask for."""

_MOST_PORTS: Final = 1000
_READ_OF_ARMS: Final = ("robot", "gripper", "base", "force_limit", "collision", "camera")
"""Facts of an arm that readers of records rely on, besides its tree."""


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("expected text without control characters")
    return text


Label: TypeAlias = Annotated[str, StringConstraints(max_length=300), AfterValidator(_printable)]
_Place: TypeAlias = Annotated[
    str, StringConstraints(min_length=1, max_length=8192), AfterValidator(_printable)
]
_Code: TypeAlias = Annotated[str, StringConstraints(pattern=r"^([A-Z][A-Z0-9_]{0,99})?$")]
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
    """An object of JSON; what it says beyond its fields is nobody's concern."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False, extra="ignore")


class _Node(_Facts):
    """A node of a tree with those below it."""

    kind: Annotated[
        str, StringConstraints(min_length=1, max_length=100), AfterValidator(_printable)
    ]
    name: _NodeName
    ports: _Ports
    place: _Place
    children: list[_Node]


class _Skill(_Facts):
    file: Annotated[str, StringConstraints(max_length=8192), AfterValidator(_printable)]
    sha256: Label


class _Processor(_Facts):
    machine: Label
    blas: Label
    arithmetic: Label


class _Camera(_Facts):
    """Fields that must be there; what they may be is the tree file's to say, as for all below."""

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


class _Arm(_Facts):
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
    path: _Place
    texts: Annotated[dict[_Place, str], Field(min_length=1, max_length=1000)]
    params: Annotated[dict[Label, Any], Field(max_length=1000)]
    seed: Annotated[int, Field(ge=0, lt=2**32)]
    renderer: RendererKind | None
    reality: Any
    duration: Annotated[float, Field(gt=0.0, le=LONGEST_S)] | None
    timestep: Annotated[float, Field(ge=1e-5, le=0.1)]
    time_limit: Annotated[float, Field(gt=0.0, le=LONGEST_S)]
    objects: Annotated[dict[Name, _Object], Field(max_length=1000)]
    arms: Annotated[dict[Name, _Arm], Field(min_length=1, max_length=100)]
    pages: Annotated[dict[_Place, Label], Field(max_length=1000)]
    skills: Annotated[dict[Label, _Skill], Field(max_length=1000)]
    versions: Annotated[dict[Label, Label], Field(max_length=1000)]
    processor: _Processor


class _Model(_Facts):
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
    leaf: _Place
    ports: _Ports


class _Wrote(_Note):
    leaf: _Place
    key: Label
    value: Any


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


class _Event(_Facts):
    time_s: _Time
    arm: Name
    path: _Place
    kind: Label
    old: StatusName
    new: StatusName
    code: _Code
    reason: _Text
    metrics: Annotated[dict[Label, float | int | bool | str | None], Field(max_length=_MOST_PORTS)]


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
        ("frame", _Frame),
        ("found", _Found),
        ("look", _Look),
        ("edited", _Edited),
        ("guard", _Guard),
        ("holds", _Holds),
    )
}
_ARM_WITHOUT_TREE: Final = create_model("_RecordedArm", __base__=ArmSpec, tree=(Any, None))
_ANY_NOTE: Final = TypeAdapter(list[_Note])
_EVENTS: Final = TypeAdapter(list[_Event])
_START, _SECOND, _END = TypeAdapter(_Start), TypeAdapter(_Second), TypeAdapter(_End)
_MODEL, _SUMMARY, _PICTURE = TypeAdapter(_Model), TypeAdapter(_Summary), TypeAdapter(_Picture)


def check_start(facts: Facts) -> None:
    """Check what a run began with.

    Raises:
        ValueError: Something of it is missing, of another type or out of range; the message says
            what, where, and what is expected.
    """
    # Counted before anything else: checking a million nodes takes long.
    arms = facts.get("arms")
    for name, said in arms.items() if isinstance(arms, dict) else ():
        check_tree(said, f"start.arms.{str(name)[:48]!r}")
    _check(_START, facts, "start")
    if facts["reality"] is not None:
        try:
            checked_reality(facts["reality"])
        except RunError as error:
            raise ValueError(f"start.{one_line(str(error))}") from error
    for name, said in facts["objects"].items():
        _check_spec(ObjectSpec, said, f"start.objects.{name}")
    for name, said in facts["arms"].items():
        known = {key: said[key] for key in _READ_OF_ARMS}
        _check_spec(_ARM_WITHOUT_TREE, known, f"start.arms.{name}")


def check_tree(said: object, where: str) -> None:
    """Check that a tree, below ``tree``, is no larger than a tree file can make it.

    Its types are not known yet.

    Raises:
        ValueError: It is.
    """
    level = [said.get("tree")] if isinstance(said, dict) else []
    depth = count = 0
    while level:
        depth, count = depth + 1, count + len(level)
        if depth > MAX_DEPTH or count > MAX_NODES:
            raise ValueError(
                f"{where}: its tree has more than {MAX_DEPTH} levels or {MAX_NODES} nodes; "
                "no tree file has"
            )
        below = [node.get("children") for node in level if isinstance(node, dict)]
        level = [child for children in below if isinstance(children, list) for child in children]


def check_model(facts: Facts) -> None:
    """Check what is said of a compiled model; raises as `check_start`."""
    _check(_MODEL, facts, "model")


def check_second(facts: Facts, arms: Mapping[str, Facts]) -> None:
    """Check what is said of a second of the run, notes included.

    Args:
        facts: Facts of the second.
        arms: Arms of the run by name.

    Raises:
        ValueError: As of `check_start`.
    """
    _check(_SECOND, facts, "second")
    of_kind: dict[str, list[Facts]] = defaultdict(list)
    for note in facts["notes"]:
        of_kind[str(note.get("kind"))].append(note)
        check_tree(note, "an edited tree")
    for kind, notes in of_kind.items():
        _check(_NOTES.get(kind, _ANY_NOTE), notes, f"notes[{kind[:48]}]")
        for note in notes:
            _check_arm(note["arm"], arms, f"a note of kind {kind}")
            if kind in ("frame", "found", "look") and not arms[note["arm"]]["camera"]:
                raise ValueError(f"a note of kind {kind} is of {note['arm']}, which has no camera")


def check_end(facts: Facts) -> None:
    """Check the last facts of a history; raises as `check_start`."""
    _check(_END, facts, "end")


def check_events(events: Sequence[Facts], arms: Mapping[str, Facts]) -> None:
    """Check changes of status.

    Args:
        events: Changes, in the order of the file.
        arms: Arms of the run by name.

    Raises:
        ValueError: As of `check_start`; or their times go backwards.
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
    """Check a summary, as far as readers of records rely on it; raises as `check_start`."""
    _check(_SUMMARY, facts, "")


def check_picture(facts: Facts) -> None:
    """Check what is said of a kept picture; raises as `check_start`."""
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
        raise ValueError(_in_words(error, where)) from None


def _check_spec(model: Any, facts: object, where: str) -> None:  # Any: a model or an adapter
    """Check facts that a model of the tree file has written."""
    if not isinstance(facts, dict):
        raise ValueError(f"{where}: expected an object of JSON")
    try:
        model.model_validate(with_tuples(facts))
    except ValidationError as error:
        raise ValueError(_in_words(error, where)) from None


def _in_words(error: ValidationError, where: str) -> str:
    """The first complaint: where, what is wrong, and what stands there."""
    first = error.errors(include_url=False, include_context=False)[0]
    place = ".".join([*filter(None, [where]), *map(str, first["loc"])])
    message = first["msg"].removeprefix("Value error, ")
    stands = "" if first["type"] == "missing" else f"; it is {str(first['input'])[:60]!r}"
    return f"{one_line(place)[:300]}: {one_line(message)[:500]}{stands}"
