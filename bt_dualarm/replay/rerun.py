"""Running a record again: comparison with the past, check of reproducibility, resuming."""

from __future__ import annotations

import hashlib
import logging
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from bt_dualarm.behaviors.report import StatusChange
from bt_dualarm.replay.record import Facts, Record, ReplayError
from bt_dualarm.replay.timeline import Timeline, TimelineNode, known_frames, node_of
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.runtime.file_check import check, checked_faults
from bt_dualarm.runtime.history import tree_facts
from bt_dualarm.runtime.history_file import HistoryError, read_regular
from bt_dualarm.runtime.interruption import StopRequest
from bt_dualarm.runtime.observations import KnownFrame
from bt_dualarm.runtime.options import RunOptions, checked_reality
from bt_dualarm.runtime.outcome import Ending
from bt_dualarm.runtime.run import Run, changes_besides_trees
from bt_dualarm.runtime.summary import processor, versions
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.node_types import NodeSpec
from bt_dualarm.spec.texture import as_text, is_image_text
from bt_dualarm.spec.yaml_reader import Source, read_text


@dataclass(frozen=True)
class Number:
    """A number of the state that differs.

    Attributes:
        name: Name of the joint, and which of its coordinates.
        recorded: Value in the record.
        now: Value in the repeated run.
    """

    name: str
    recorded: float
    now: float


@dataclass(frozen=True)
class Difference:
    """First difference of a repeated run from its record.

    Attributes:
        step: Number of physics steps up to and including the first that differs.
        time_s: Simulated time in s.
        numbers: Numbers that differ in the next recorded state, largest difference first.
        event: Sentence on the first status change that differs, empty if none does so far.
        doing: Leaves that were running: arm and path.
    """

    step: int
    time_s: float
    numbers: tuple[Number, ...]
    event: str
    doing: tuple[str, ...]


class PastComparison(IdleObserver):
    """Observer that compares the checksum of every step and every status change with a record.

    Args:
        record: The record.
        world: World of the repeated run.
        until: Number of steps to compare.
    """

    def __init__(self, record: Record, world: World, until: int) -> None:
        self._record = record
        self._world = world
        self._checksums = record.checksums()[:until].tolist()
        self._rows = {row: index for index, row in enumerate(_rows(record))}
        self._steps = 0
        self._events = 0
        self._running: dict[str, None] = {}
        self._event = ""
        self._event_step = 0
        self._step: int | None = None
        self._found: Difference | None = None

    @property
    def steps(self) -> int:
        """Number of steps found to be equal."""
        if self._step is not None:
            return self._step - 1
        return self._event_step if self._event else min(self._steps, len(self._checksums))

    @property
    def differs(self) -> bool:
        """Whether a step or a status change differs."""
        return self._step is not None or bool(self._event)

    @property
    def difference(self) -> Difference | None:
        """First difference, as far as it is known; None if there is none."""
        if self._found is not None or not self.differs:
            return self._found
        step = self._event_step if self._step is None else self._step
        return self._difference(step, ())

    def on_event(self, change: StatusChange) -> None:
        """Compare a status change with that of the record."""
        node = f"{change.arm}:{change.path}"
        if not self.differs:
            if change.new == "RUNNING":
                self._running[node] = None
            else:
                self._running.pop(node, None)
        self._compare(change)
        self._events += 1

    def after_step(self, time: float) -> None:  # noqa: ARG002 - the world knows it, too
        """Compare a step with that of the record."""
        number = self._steps
        self._steps += 1
        data = self._world.data
        if self._step is None and number < len(self._checksums):
            same = zlib.crc32(data.qvel, zlib.crc32(data.qpos)) == self._checksums[number]
            self._step = None if same else self._steps
        if self._step is not None and self._found is None and number in self._rows:
            self._found = self._difference(self._step, self._numbers(self._rows[number]))

    def _compare(self, change: StatusChange) -> None:
        events = self._record.events
        if self._event or self._events >= len(events) or self._steps >= len(self._checksums):
            return
        was = events[self._events]
        now = {"arm": change.arm, "path": change.path, "new": change.new, "code": change.code}
        if any(was[name] != value for name, value in now.items()):
            self._event_step = self._steps
            self._event = (
                f"{_event_text(was)} at {was['time_s']:.3f} s in the record; "
                f"now {_event_text(now)} at {change.time:.3f} s"
            )

    def _difference(self, step: int, numbers: tuple[Number, ...]) -> Difference:
        time = step * self._world.timestep
        return Difference(step, time, numbers, self._event, tuple(self._running))

    def _numbers(self, index: int) -> tuple[Number, ...]:
        """Numbers of the state that differ from the record, largest difference first."""
        moment = self._record.moment(index)
        data = self._world.data
        if moment.qpos.shape != data.qpos.shape:
            count = Number("count of positions", len(moment.qpos), len(data.qpos))
            return (count,)
        was = np.concatenate((moment.qpos, moment.qvel))
        now = np.concatenate((data.qpos, data.qvel))
        deviation = np.abs(now - was)
        order = np.argsort(-deviation, kind="stable")
        return tuple(
            Number(self._name(int(index)), float(was[index]), float(now[index]))
            for index in order
            if now[index] != was[index]
        )

    def _name(self, index: int) -> str:
        """Name of an element of the state, positions first, then velocities."""
        model = self._world.model
        what = "position"
        starts = model.jnt_qposadr
        if index >= model.nq:
            what = "velocity"
            starts = model.jnt_dofadr
            index = index - model.nq
        joint = int(np.searchsorted(starts, index, "right")) - 1
        name = model.joint(joint).name or model.body(int(model.jnt_bodyid[joint])).name
        return f"{what} of {name}[{index - int(starts[joint])}]"


def _event_text(event: Facts) -> str:
    code = f" {event['code']}" if event["code"] else ""
    return f"{event['arm']}:{event['path']} → {event['new']}{code}"


def _rows(record: Record) -> list[int]:
    """Indices of the steps whose state is recorded."""
    kept = [block.arrays["rows"] for block in record.seconds if "states" in block.arrays]
    return [int(row) for rows in kept for row in rows]


_MOST_SOURCE: Final = 1 << 24
"""Largest source or description file that is compared with a record, bytes."""


@dataclass(frozen=True)
class Changed:
    """Changes to the run of a record.

    Attributes:
        tree: Path of another tree file; None takes the record's own text.
        options: Options that replace those of the record, by name.
        params: Values of parameters in addition to those of the record.
        includes: Whether files included by the tree are read from disk again.
    """

    tree: Path | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    params: Mapping[str, object] = field(default_factory=dict)
    includes: bool = False


@dataclass(frozen=True, eq=False)
class Rerun:
    """A prepared repetition of a run.

    Attributes:
        run: The run; nothing has moved yet.
        file: Tree file, as it was read.
    """

    run: Run
    file: TreeFile

    @property
    def trees(self) -> Mapping[str, NodeSpec]:
        """Root of each arm's tree."""
        return {name: arm.tree for name, arm in self.file.arms.items()}


def rerun(
    record: Record, registry: Registry, changed: Changed, stop: StopRequest | None = None
) -> Rerun:
    """Prepare the run of a record again; nothing has moved yet.

    Args:
        record: The record.
        registry: Skills by name.
        changed: Changes to the run.
        stop: Request to end early.

    Raises:
        DualArmError: The run cannot be prepared, as for `bt_dualarm.runtime.api.open`.
    """
    start = record.start
    tree = changed.tree or _own_text(record, from_disk=changed.includes)
    params = {**start["params"], **dict(changed.params)}
    checked = check(tree, registry.kinds, params, build=False)
    reality = start["reality"]
    options = {
        "seed": start["seed"],
        "renderer": start["renderer"],
        "reality": None if reality is None else checked_reality(reality),
        "duration": start["duration"],
    } | dict(changed.options)
    file = checked.runnable()
    given = start.get("faults")
    if given and "faults" not in options:
        options["faults"] = checked_faults(file, {"faults": given})
    run = Run(file, registry, RunOptions(**options), stop=stop, warnings=checked.problems)
    return Rerun(run, file)


def differences(record: Record, registry: Registry) -> Iterator[str]:
    """Yields sentences on changes of processor, versions and files since the record was made."""
    now = processor()
    then = record.start["processor"]
    if now["arithmetic"] != then["arithmetic"]:
        yield (
            f"this is another kind of processor ({now['machine']}, {now['blas']}; the record's: "
            f"{then['machine']}, {then['blas']}): its numbers are rounded differently"
        )
    was = record.start["versions"]
    for name, version in versions().items():
        if was.get(name) != version:
            yield f"{name} is {version}, was {was.get(name, 'not installed')} then"
    for name, facts in record.start["skills"].items():
        if name not in registry.skills:
            yield f"there is no skill {name!r} now (load your own skills with --skills DIR)"
        elif facts["file"] and _digest(Path(facts["file"])) != facts["sha256"]:
            yield f"the code of {name} ({facts['file']}) has changed"
    for path, text in _included(record).items():
        if not _is_content_of(text, Path(path)):
            yield f"{path}, which the tree includes, has changed"
    root = Path(record.start["path"]).parent
    for page, digest in record.start["pages"].items():
        if _digest(root / page) != digest:
            yield f"the robot's description {page} has changed"


def _own_text(record: Record, *, from_disk: bool) -> Source:
    """The record's text of the tree, with included files.

    Args:
        record: The record.
        from_disk: Whether included files that still exist are read from disk.
    """
    source = read_text(next(iter(record.start["texts"].values())), record.start["path"])
    source.texts = {
        path: text
        for path, text in _included(record).items()
        if not (from_disk and Path(path).is_file())
    }
    return source


def _included(record: Record) -> dict[str, str]:
    """Texts of the included files, by absolute path."""
    (name, _), *included = record.start["texts"].items()
    tree = Path(record.start["path"])
    given = Path(name)
    # Paths may be relative to the working directory of the run: drop the parts of `given`.
    above = [*tree.parents, Path()]
    root = Path() if given.is_absolute() else above[min(len(given.parts), len(above)) - 1]
    return {str(root / path): text for path, text in included}


def _is_content_of(text: str, path: Path) -> bool:
    """Whether a file, which may be an image, still has the content that a text stands for."""
    try:
        content = read_regular(path, _MOST_SOURCE, links=True)
        if is_image_text(text):
            return as_text(content) == text
        return content.decode("utf-8-sig").splitlines() == text.splitlines()
    except (HistoryError, ValueError):
        return False


def _digest(path: Path) -> str:
    """SHA-256 of a regular file named by a record, up to a size limit; empty if there is none."""
    try:
        return hashlib.sha256(read_regular(path, _MOST_SOURCE, links=True)).hexdigest()
    except HistoryError:
        return ""


_REPEATABLE = {str(ending) for ending in (Ending.FINISHED, Ending.DURATION, Ending.TIME_LIMIT)}
"""Endings that a repeated run reaches without intervention."""

_COMPARISON_STEP_S = 0.1
"""Simulated seconds between two checks of the comparison."""


@dataclass(frozen=True)
class Agreement:
    """Result of comparing a repeated run with its record.

    Attributes:
        steps: Number of equal physics steps from the start.
        time_s: Simulated time of the last equal step in s.
        until_s: Simulated time in s up to which steps were to be compared.
        difference: First difference; None if there is none.
        hash_agrees: Whether the hash of all states equals that of the record; None if the record
            has none, or was not compared completely.
        changed: Sentences on changes since the record was made.
    """

    steps: int
    time_s: float
    until_s: float
    difference: Difference | None
    hash_agrees: bool | None
    changed: tuple[str, ...]

    @property
    def agrees(self) -> bool:
        """Whether no difference was found."""
        return self.difference is None and self.hash_agrees is not False


def check_record(record: Record, registry: Registry) -> Agreement:
    """Run a record's tree again, including rendering, and compare every step.

    A run that was stopped, killed, or edited is compared up to the first intervention.

    Args:
        record: The record.
        registry: Skills by name.

    Raises:
        ReplayError: The record has no step to compare.
        DualArmError: The run cannot be prepared.
    """
    changed = tuple(differences(record, registry))
    whole = record.summary is not None and record.summary["ending"] in _REPEATABLE
    whole = whole and not any(note["kind"] == "edited" for note in record.notes)
    steps = record.steps if whole else _undisturbed(record)
    if not steps:
        raise ReplayError(f"{record.folder} contains no step to compare")
    timestep = float(record.start["timestep"])
    with rerun(record, registry, Changed()).run as run:
        past = PastComparison(record, run.world, steps)
        run.watch(past)
        while not run.done and not past.differs and past.steps < steps:
            left = (steps - past.steps) * timestep
            run.step(min(_COMPARISON_STEP_S, left))
        if past.differs and not run.done and past.difference is not None:
            run.step(_COMPARISON_STEP_S)  # to the next recorded state, to find its numbers
        if whole and not past.differs and not run.done:
            run.finish()
        same_hash = None
        if whole and run.done and record.end is not None:
            same_hash = run.result.state_sha256 == record.end["state_sha256"]
        same = past.steps
        difference = past.difference
    return Agreement(same, same * timestep, steps * timestep, difference, same_hash, changed)


def _undisturbed(record: Record) -> int:
    """Number of steps until the first intervention from outside the simulation."""
    timestep = float(record.start["timestep"])
    until = min((time for time, _ in _interventions(record)), default=record.steps * timestep)
    return min(record.steps, round(until / timestep))


def _interventions(record: Record) -> Iterator[tuple[float, str]]:
    """Yields time in s and description of each intervention from outside the simulation.

    A signal, a page or a limit of the run halts all trees; the watchdog, which uses the wall clock,
    ends a leaf. In a repetition, that leaf would continue or block.
    """
    roots = {name: str(arm["tree"]["name"]) for name, arm in record.arms.items()}
    of_roots = [event for event in record.events if event["path"] == roots.get(event["arm"])]
    latest = {event["arm"]: event for event in of_roots}.values()
    ended = [event for event in of_roots if event["new"] != "RUNNING"]
    # Earlier halts, and those while other trees run on, are removals of arms by a tree.
    if ended and all(event["new"] != "RUNNING" for event in latest):
        for event in ended:
            is_last = event["time_s"] == ended[-1]["time_s"]
            if is_last and event["new"] == "INVALID" and event["code"] in ("", "HALTED"):
                why = "" if record.summary is None else f": {record.summary['ending']}"
                yield float(event["time_s"]), f"the tree of {event['arm']} was halted{why}"
    for event in record.events:
        if event["code"] == "OVERRUN":
            yield float(event["time_s"]), f"the watchdog ended {event['arm']}:{event['path']}"
    for note in record.notes:
        if note["kind"] == "edited":
            yield float(note["time_s"]), f"the tree of {note['arm']} was edited"


_RESUME_STEP_S = 0.1

_log = logging.getLogger(__name__)


class PastChangedError(ReplayError):
    """The repeated past of a run differs from the record; the message states where."""


def resumed(
    record: Record,
    time: float,
    registry: Registry,
    changed: Changed,
    stop: StopRequest | None = None,
) -> Run:
    """Repeat a recorded run up to a time, checking every step, and return it to be continued.

    Findings in camera frames are taken from the record; if that leads to a difference, the past is
    repeated once more with rendered frames.

    Args:
        record: The record.
        time: Simulated time in s at which to continue.
        registry: Skills by name.
        changed: Another tree, whose past must be equal, and options.
        stop: Request to end early.

    Returns:
        The run at that time; its state hash equals that of an uninterrupted run.

    Raises:
        PastChangedError: A step or status differs; the message states which, and why. An earlier
            record in the folder of a requested one stays, as for any error.
        ReplayError: The time is outside the record.
        DualArmError: The run cannot be prepared.
    """
    timestep = float(record.start["timestep"])
    steps = round(time / timestep)
    last = record.steps * timestep
    if not 0 < steps <= record.steps:
        raise ReplayError(f"cannot resume at {time:g} s: the record goes from 0 to {last:.2f} s")
    stop = stop or StopRequest()
    changed = replace(changed, includes=True)
    known = known_frames(record, (steps - 0.5) * timestep)
    for frames in (known, {}):
        remade = rerun(record, registry, changed, stop)
        try:
            past = _repeat_past(record, remade.run, steps, stop, frames)
            if past.steps == steps or stop.asked:
                return remade.run
            _raise_unless_frames_explain(record, remade, past, registry, changed.options)
        except BaseException:
            remade.run.discard()
            raise
        remade.run.discard()
    raise AssertionError("without known frames, _raise_unless_frames_explain always raises")


def _raise_unless_frames_explain(
    record: Record,
    remade: Rerun,
    past: PastComparison,
    registry: Registry,
    options: Mapping[str, object],
) -> None:
    """Log a warning if recalled frames may be the reason of a difference.

    Raises:
        PastChangedError: They cannot be the reason.
    """
    time = past.steps * float(record.start["timestep"])
    recalled = any(log.taken for log in remade.run.assembly.frame_logs.values())
    if any(edited(record, remade.trees, time)) or not recalled:
        raise PastChangedError(_explained(record, remade, past, registry, options))
    _log.warning(
        "recorded image results diverge from the run from %.3f s on: images are rendered again",
        time,
    )


def _repeat_past(
    record: Record,
    run: Run,
    steps: int,
    stop: StopRequest,
    frames: Mapping[str, Mapping[float, KnownFrame]],
) -> PastComparison:
    timestep = float(record.start["timestep"])
    for arm, known in frames.items():
        if arm in run.assembly.frame_logs:  # another tree may have other cameras
            run.assembly.frame_logs[arm].known = known
    past = PastComparison(record, run.world, steps)
    run.watch(past)
    while past.steps < steps and not past.differs and not run.done and not stop.asked:
        run.step(min(_RESUME_STEP_S, (steps - past.steps) * timestep))
    return past


def _explained(
    record: Record,
    remade: Rerun,
    past: PastComparison,
    registry: Registry,
    options: Mapping[str, object],
) -> str:
    found = past.difference
    time = past.steps * float(record.start["timestep"])
    lines = [f"the past is not that of the record: it differs from {time:.3f} s on"]
    if found is not None and found.event:
        lines.append(found.event)
    elif found is not None and found.doing:
        lines.append(f"running then: {', '.join(found.doing)}")
    for name in ("seed", "duration", "renderer", "reality"):
        given = options.get(name)
        if given is not None and given != record.start[name]:
            was = record.start[name]
            lines.append(f"{name} is {given}, was {'not given' if was is None else was} then")
    lines += edited(record, remade.trees, time)
    parts = _changed_parts(record, remade.file, registry)
    if parts:
        lines.append(f"changed in the file besides trees: {', '.join(parts)}")
    lines += [
        f"at {at:.3f} s of the record, {what}" for at, what in _interventions(record) if at <= time
    ]
    lines += differences(record, registry)
    return "\n  = ".join(lines)


def _changed_parts(record: Record, now: TreeFile, registry: Registry) -> list[str]:
    """Parts of the tree file, besides trees, that are not as in the record."""
    own = _own_text(record, from_disk=False)
    was = check(own, registry.kinds, record.start["params"], build=False).file
    if was is None:
        return []
    for obj in was.objects.values():  # a copy of the file elsewhere is no change
        obj.look_in(now.root)
    return [part for part in changes_besides_trees(was, now) if part != "goal"]


def edited(record: Record, trees: Mapping[str, NodeSpec], time: float) -> Iterator[str]:
    """Yields sentences on nodes that have been edited and had started by a time in s."""
    timeline = Timeline(record)
    for arm, root in timeline.roots.items():
        if arm not in trees:
            yield f"the tree no longer has an arm {arm!r}"
            continue
        facts = tree_facts(trees[arm])
        now = {node.path: node for node in node_of(arm, facts, str(facts["name"])).walk()}
        for node in root.walk():
            if node.changes and node.changes[0].time <= time:
                why = _edit(node, now.get(node.path))
                if why:
                    yield f"{arm}:{node.path} began at {node.changes[0].time:.2f} s and {why}"


def _edit(was: TimelineNode, now: TimelineNode | None) -> str:
    if now is None:
        return "is no longer in the tree"
    if now.kind != was.kind:
        return f"is a {now.kind} now, not a {was.kind}"
    if dict(now.ports) != dict(was.ports):
        names = sorted(
            name
            for name in now.ports.keys() | was.ports.keys()
            if now.ports.get(name) != was.ports.get(name)
        )
        return f"has another {', '.join(names)} now"
    return ""


def parse_place(text: str) -> tuple[Path, float]:
    """Folder and time of ``DIR@SECONDS``.

    Raises:
        ReplayError: The text does not have this form.
    """
    folder, at, seconds = text.rpartition("@")
    try:
        time = float(seconds.strip().removesuffix("s"))
    except ValueError:
        time = -1.0
    if at and folder and time == 0.0:
        raise ReplayError("--resume takes a time after 0; a run from the start needs no record")
    if not at or not folder or not 0.0 < time < float("inf"):
        raise ReplayError(f"--resume takes DIR@SECONDS, for example out@12.4, not {text!r}")
    return Path(folder), time
