"""Preparation of a run: compiled kernels, world, arms, runner, observers, open record."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from weakref import ref

from bt_dualarm.collision.distance import warm_up_spheres
from bt_dualarm.control.collision_detection import warm_up_collision_detection
from bt_dualarm.control.computed_torque import warm_up_control
from bt_dualarm.control.planar_servo import warm_up_servo
from bt_dualarm.core.kernel import compile_once
from bt_dualarm.core.share import weakly
from bt_dualarm.grasping.ranking import warm_up_grasping
from bt_dualarm.perception.detection import warm_up_detection
from bt_dualarm.perception.localization import warm_up_localization
from bt_dualarm.perception.rest_detection import warm_up_rest_detection
from bt_dualarm.perception.shape_fit import warm_up_outlines
from bt_dualarm.perception.target_filter import warm_up_prediction
from bt_dualarm.planning.rrt_connect import warm_up_planning
from bt_dualarm.runtime.arm_runtime import ArmRuntime
from bt_dualarm.runtime.assembly import Assembly, assemble
from bt_dualarm.runtime.clock import RealTime, Unpaced
from bt_dualarm.runtime.events import LogCapture, StatusFeed
from bt_dualarm.runtime.history import History, Start
from bt_dualarm.runtime.observations import PictureFile, StateLog, TraceEvents
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.outcome import Ending, RunResult
from bt_dualarm.runtime.recorder import FRAMES, HISTORY, Recorder, RecordFolder
from bt_dualarm.runtime.runner import Conditions, Limit, Runner
from bt_dualarm.runtime.signals import StopRequest, ctrl_c_ends
from bt_dualarm.runtime.watchdog import Watchdog
from bt_dualarm.safety.failsafe import warm_up_reservations
from bt_dualarm.sim.camera_optics import warm_up_lens, warm_up_shutter
from bt_dualarm.sim.contact_monitor import warm_up_contacts
from bt_dualarm.sim.devices import warm_up_sensors
from bt_dualarm.sim.grippers import warm_up_fingers, warm_up_held_objects, warm_up_tactile_sensors
from bt_dualarm.sim.ray_renderer import warm_up_renderer
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.problems import Named
from bt_dualarm.trajectory.path_timing import warm_up_timing


def compile_kernels() -> None:
    """Compile all kernels of the package, and log a line if that takes time.

    Compiles on first use on a machine; later calls return at once.
    """
    cameras = warm_up_renderer, warm_up_lens, warm_up_shutter, warm_up_detection
    world = warm_up_sensors, warm_up_contacts, warm_up_spheres
    vision = warm_up_prediction, warm_up_rest_detection, warm_up_outlines, warm_up_localization
    motion = warm_up_control, warm_up_servo, warm_up_timing, warm_up_planning
    grips = warm_up_held_objects, warm_up_fingers, warm_up_tactile_sensors, warm_up_grasping
    compile_once(
        (
            *cameras,
            *world,
            *vision,
            *motion,
            *grips,
            warm_up_reservations,
            warm_up_collision_detection,
        )
    )


@dataclass(frozen=True)
class OpenRecord:
    """Writers of a record during the run.

    Attributes:
        folder: Folder of the record.
        trace: Trace events of the run.
        history: Writer of states and trace events.
        recorder: Writer of all other files.
    """

    folder: RecordFolder
    trace: TraceEvents
    history: History
    recorder: Recorder


@dataclass(frozen=True)
class Prepared:
    """A run whose parts are ready, before its first step.

    Attributes:
        name: Name of the tree file.
        assembly: World and arms.
        runner: Advances them.
        feed: Distributes events to the observers.
        watchdog: Limits the wall-clock time of skill code.
        states: Hash of all states of the world.
        log: Captures the log while the run is advanced.
        open_record: Writers of the record, None if none was requested.
        resources: Resources of the run, released when closed.
    """

    name: str
    assembly: Assembly
    runner: Runner
    feed: StatusFeed
    watchdog: Watchdog
    states: StateLog
    log: LogCapture
    open_record: OpenRecord | None
    resources: ExitStack

    def __post_init__(self) -> None:
        self.watchdog.keep = weakly(self.save_interim_record)

    @property
    def renderer(self) -> str | None:
        """``gl``, ``ray``, or None if no arm has a camera."""
        return None if self.assembly.renderer is None else self.assembly.renderer.name

    @contextmanager
    def at_work(self) -> Iterator[None]:
        """Log capture, watchdog and Ctrl-C handling while the run is advanced.

        Raises:
            KeyboardInterrupt: Ctrl-C was pressed, and no other handler is installed.
        """
        with self.log.during(), ctrl_c_ends(), self.watchdog.awake():
            yield

    def save_interim_record(self) -> None:
        """Write the record of a run that skill code blocks for good; called from another thread.

        Raises:
            RecordError: The disk is full, or the folder is gone.
        """
        if self.open_record is not None:
            urgent = StopRequest(count=2)
            self.open_record.recorder.write(self.completed(self.runner.so_far()), urgent)
            self.open_record.folder.release()

    def completed(self, result: RunResult) -> RunResult:
        """The runner's result with the series, names, seed and state hash added."""
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
                for name, errors in self.assembly.world.devices.errors.items()
            },
            state_sha256=self.states.sha256,
        )


def prepare(file: TreeFile, registry: Registry, options: RunOptions, stop: StopRequest) -> Prepared:
    """Compose the world, equip its arms, and open the record.

    Args:
        file: Tree file, checked with the skills of ``registry``.
        registry: Skills by name.
        options: Overrides of the file's settings.
        stop: Request to end early.

    Raises:
        CatalogError: A robot or scene is unknown or broken.
        RendererError: The requested renderer does not work here.
        WorldError: The parts do not compile to one world, or two of them overlap.
        RecordError: The folder of the record cannot be used.
    """
    log = LogCapture()
    feed = StatusFeed()
    trace = TraceEvents()
    with log.during(), ExitStack() as resources:
        if options.reality is not None:
            file = file.in_reality(options.reality)
        assembly = assemble(
            file,
            registry,
            feed.add,
            seed=options.seed,
            renderer=options.renderer,
            # Without a record nothing reads trace events, so none are collected.
            trace=None if options.record is None else trace,
        )
        resources.enter_context(closing(assembly))
        states = StateLog(assembly.world)
        feed.observers.append(states)
        open_record = None
        if options.record is not None:
            folder = resources.enter_context(RecordFolder(options.record, file.arms))
            start = _start(file, registry, options, assembly)
            history = _history(folder.path, assembly, trace, start)
            if options.frames:
                pictures = resources.enter_context(closing(PictureFile(folder.path / FRAMES)))
                for frame_log in assembly.frame_logs.values():
                    frame_log.pictures = pictures
            recorder = Recorder(folder.path, assembly.world, states, log.take, history)
            feed.observers += recorder, history
            open_record = OpenRecord(folder, trace, history, recorder)
        conditions = _conditions(file.world.time_limit, options, stop)
        resources.enter_context(closing(conditions.watchdog))
        return Prepared(
            file.name,
            assembly,
            Runner(assembly.world, assembly.arms, feed, conditions),
            feed,
            conditions.watchdog,
            states,
            log,
            open_record,
            resources.pop_all(),
        )


def _start(file: TreeFile, registry: Registry, options: RunOptions, assembly: Assembly) -> Start:
    """Facts that the run starts from, for its history."""
    renderer = None if assembly.renderer is None else assembly.renderer.name
    timestep = assembly.world.timestep
    return Start(file, registry.skills, options, assembly.seed, renderer, timestep)


def _history(folder: Path, assembly: Assembly, trace: TraceEvents, start: Start) -> History:
    world = assembly.world
    arms = ref(assembly.arms)
    trace.clock = lambda: world.time

    def present() -> Sequence[ArmRuntime]:
        """Arms that are present; a weak reference, so that the history does not keep them alive."""
        alive = arms()
        return () if alive is None else alive.present

    return History(folder / HISTORY, world, present, trace, start.block)


def _conditions(time_limit: float, options: RunOptions, stop: StopRequest) -> Conditions:
    pacer = RealTime(time.perf_counter, time.sleep) if options.real_time else Unpaced()
    if options.duration is not None and options.duration <= time_limit:
        limit = Limit(options.duration, Ending.DURATION)
    else:
        limit = Limit(time_limit, Ending.TIME_LIMIT)
    watchdog = Watchdog(options.watchdog, stop)
    return Conditions(limit, time.perf_counter, stop, pacer, watchdog)
