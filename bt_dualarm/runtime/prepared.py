"""A run made ready: world, arms, runner and those who look on; nothing has moved yet."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from weakref import ref

from bt_dualarm.runtime.arm_runtime import ArmRuntime
from bt_dualarm.runtime.assembly import Assembly, assemble
from bt_dualarm.runtime.events import Watch
from bt_dualarm.runtime.history import History
from bt_dualarm.runtime.history_start import Start
from bt_dualarm.runtime.log_capture import LogCapture
from bt_dualarm.runtime.named import Named
from bt_dualarm.runtime.notes import Notes
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.outcome import Ending
from bt_dualarm.runtime.pacing import RealTime, Unpaced
from bt_dualarm.runtime.picture_file import PictureFile
from bt_dualarm.runtime.record import Recorder
from bt_dualarm.runtime.record_folder import FRAMES, HISTORY, RecordFolder
from bt_dualarm.runtime.result import RunResult
from bt_dualarm.runtime.runner import Conditions, Limit, Runner
from bt_dualarm.runtime.signals import StopRequest, ctrl_c_ends
from bt_dualarm.runtime.state_log import StateLog
from bt_dualarm.runtime.watchdog import Watchdog
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.world.weak_callback import weakly


@dataclass(frozen=True)
class Kept:
    """What of a run is on the disk while it goes on.

    Attributes:
        folder: Folder of the record.
        notes: What is noted for it.
        history: Writer of states and notes.
        recorder: Writer of all else.
    """

    folder: RecordFolder
    notes: Notes
    history: History
    recorder: Recorder


@dataclass(frozen=True)
class Prepared:
    """All that a run consists of.

    Attributes:
        name: Name of the tree file.
        assembly: World and arms.
        runner: What advances them.
        watch: Those who look on.
        watchdog: What looks after the time that skills take.
        states: Hash of the states that the world goes through.
        log: What is logged while the run is advanced.
        recorder: Writer of the record, None where there is to be none.
        kept: What of it is on the disk while it goes on, likewise.
        resources: What the run holds; closing it gives that back.
    """

    name: str
    assembly: Assembly
    runner: Runner
    watch: Watch
    watchdog: Watchdog
    states: StateLog
    log: LogCapture
    recorder: Recorder | None
    kept: Kept | None
    resources: ExitStack

    def __post_init__(self) -> None:
        self.watchdog.keep = weakly(self.keep_what_is_known)

    @property
    def renderer(self) -> str | None:
        """``gl``, ``ray``, or None where no arm has a camera."""
        return None if self.assembly.renderer is None else self.assembly.renderer.name

    @contextmanager
    def at_work(self) -> Iterator[None]:
        """Log, watchdog and Ctrl-C as they are while the run is advanced.

        Raises:
            KeyboardInterrupt: Somebody has pressed Ctrl-C, and nobody else handles that.
        """
        with self.log.during(), ctrl_c_ends(), self.watchdog.awake():
            yield

    def keep_what_is_known(self) -> None:
        """Write the record of a run that code of a skill holds up for good; from another thread.

        Raises:
            RecordError: The disk is full, or the folder is gone.
        """
        if self.recorder is not None and self.kept is not None:
            urgent = StopRequest(count=2)
            self.recorder.write(self.completed(self.runner.so_far()), urgent)
            self.kept.folder.release()

    def completed(self, result: RunResult) -> RunResult:
        """What the runner says at its end, with what others know of the run."""
        arms = {
            name: replace(arm, series=self.assembly.series.of(name))
            for name, arm in result.arms.items()
        }
        return replace(
            result,
            arms=Named("arm", arms),
            name=self.name,
            seed=self.assembly.seed,
            renderer=self.renderer,
            reality={
                name: errors.model_dump(exclude_defaults=True)
                for name, errors in self.assembly.world.equipment.errors.items()
            },
            state_sha256=self.states.sha256,
        )


def prepare(file: TreeFile, registry: Registry, options: RunOptions, stop: StopRequest) -> Prepared:
    """Compose the world, equip its arms, and open the record.

    Args:
        file: The tree file, checked with the skills of ``registry``.
        registry: The skills.
        options: What overrides the file.
        stop: Request to end early.

    Raises:
        CatalogueError: A robot or scene is unknown or broken.
        RendererError: The renderer asked for cannot work here.
        WorldError: The parts do not compile to one world, or two of them are in one place.
        RecordError: The folder of the record cannot be used.
    """
    log, watch, notes = LogCapture(), Watch(), Notes()
    with log.during(), ExitStack() as resources:
        if options.reality is not None:
            file = file.in_reality(options.reality)
        assembly = _assembled(file, registry, options, watch, notes)
        resources.enter_context(closing(assembly))
        watch.observers.append(states := StateLog(assembly.world))
        recorder = kept = None
        if options.record is not None:
            folder = resources.enter_context(RecordFolder(options.record, file.arms))
            start = _start(file, registry, options, assembly)
            history = _history(folder.path, assembly, notes, start)
            _keep_pictures(folder.path, options, assembly, resources)
            recorder = Recorder(folder.path, assembly.world, states, log.take, history)
            watch.observers += recorder, history
            kept = Kept(folder, notes, history, recorder)
        conditions = _conditions(file.world.time_limit, options, stop)
        resources.enter_context(closing(conditions.watchdog))
        return Prepared(
            file.name,
            assembly,
            Runner(assembly.world, assembly.arms, watch, conditions),
            watch,
            conditions.watchdog,
            states,
            log,
            recorder,
            kept,
            resources.pop_all(),
        )


def _keep_pictures(
    folder: Path, options: RunOptions, assembly: Assembly, resources: ExitStack
) -> None:
    if options.frames:
        pictures = resources.enter_context(closing(PictureFile(folder / FRAMES)))
        for sights in assembly.sights.values():
            sights.pictures = pictures


def _assembled(
    file: TreeFile, registry: Registry, options: RunOptions, watch: Watch, notes: Notes
) -> Assembly:
    """World and arms; nobody notes what no record will keep."""
    seed, renderer = options.seed, options.renderer
    kept = None if options.record is None else notes
    return assemble(file, registry, watch.note, seed=seed, renderer=renderer, notes=kept)


def _start(file: TreeFile, registry: Registry, options: RunOptions, assembly: Assembly) -> Start:
    """What the run is made from, for its history."""
    renderer = None if assembly.renderer is None else assembly.renderer.name
    timestep = assembly.world.timestep
    return Start(file, registry.skills, options, assembly.seed, renderer, timestep)


def _history(folder: Path, assembly: Assembly, notes: Notes, start: Start) -> History:
    world, arms = assembly.world, ref(assembly.arms)
    notes.clock = lambda: world.time

    def present() -> Sequence[ArmRuntime]:
        """Arms of the run, which would stay in memory if what looks on referred to them."""
        alive = arms()
        return () if alive is None else alive.present

    return History(folder / HISTORY, world, present, notes, start.block)


def _conditions(time_limit: float, options: RunOptions, stop: StopRequest) -> Conditions:
    pacer = RealTime(time.perf_counter, time.sleep) if options.real_time else Unpaced()
    limit = _limit(time_limit, options.duration)
    watchdog = Watchdog(options.watchdog, stop)
    return Conditions(limit, time.perf_counter, stop, pacer, watchdog)


def _limit(time_limit: float, duration: float | None) -> Limit:
    """Whichever comes first."""
    if duration is not None and duration <= time_limit:
        return Limit(duration, Ending.DURATION)
    return Limit(time_limit, Ending.TIME_LIMIT)
