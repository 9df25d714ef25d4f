"""Assembly of a run: from a tree file to a runner that is ready for its first step.

`assemble` makes the world, whose arms have cameras, controllers and trees. Preparation adds
runner, observers and the open record.
"""

from __future__ import annotations

import importlib
import logging
import time
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from pathlib import Path
from weakref import ref

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.arm.shared_arm import SharedArm
from bt_dualarm.arm.traffic import Traffic
from bt_dualarm.behaviors.faults import FaultInjector
from bt_dualarm.behaviors.load import build_tree
from bt_dualarm.behaviors.report import StatusChange
from bt_dualarm.control.controller import JointController
from bt_dualarm.core.share import weakly
from bt_dualarm.planning.process import PlanningProcess
from bt_dualarm.robots.robot import Robot, is_description_path
from bt_dualarm.runtime.arm_runtime import ArmParts, ArmRuntime, Arms
from bt_dualarm.runtime.clock import RealTime, Unpaced, exact
from bt_dualarm.runtime.goals import Referee
from bt_dualarm.runtime.history import History, Start
from bt_dualarm.runtime.interruption import StopRequest, Watchdog, ctrl_c_ends
from bt_dualarm.runtime.observations import (
    FaultLog,
    FrameLog,
    LogCapture,
    PictureFile,
    StateLog,
    StatusFeed,
    TraceEvents,
)
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.outcome import Ending, Leniency, RunResult, SeriesLog
from bt_dualarm.runtime.recorder import FRAMES, HISTORY, Recorder, RecordFolder
from bt_dualarm.runtime.runner import Conditions, Limit, Runner
from bt_dualarm.safety.failsafe import Reservations
from bt_dualarm.sim.camera import Camera, calibration_of
from bt_dualarm.sim.contact_monitor import Contacts
from bt_dualarm.sim.faults import WorldFaults
from bt_dualarm.sim.frame import Renderer, RendererKind
from bt_dualarm.sim.object_body import body_of
from bt_dualarm.sim.renderers import choose_renderer
from bt_dualarm.sim.world import World
from bt_dualarm.skill.cell import CellAccess, CellState
from bt_dualarm.skill.registry import Registry
from bt_dualarm.skill.skill import SkillContext
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.faults import FaultEvent, LeafFault
from bt_dualarm.spec.node_types import NodeSpec
from bt_dualarm.spec.problems import Named

CONTROL_PERIOD = Fraction(1, 250)
"""Longest time in seconds between two set-points of an arm, where the physics steps as often."""


@dataclass
class Assembly:
    """A world, its arms and their shared services.

    Attributes:
        world: The world.
        arms: The arms of the file.
        renderer: Renderer of all cameras, None if no arm of the file has one.
        message: Which renderer is used and why, in one sentence; empty without cameras.
        series: Quantities that skills measure over time.
        planning: Planning process of all arms.
        contacts: Actual contacts of the arms, evaluated after each step.
        seed: Random seed.
        frame_logs: Findings in the cameras' frames, by the arm's name.
        trees: Definition of the tree that an arm starts with when spawned, by the arm's name.
        texts: Texts of the files that ports of the trees name, see `SkillContext`.
        faults: Injected faults of hardware and world.
    """

    world: World
    arms: Arms
    renderer: Renderer | None
    message: str
    series: SeriesLog
    planning: PlanningProcess
    contacts: Contacts
    seed: int
    frame_logs: Mapping[str, FrameLog]
    trees: dict[str, NodeSpec]
    texts: dict[str, str]
    faults: WorldFaults

    def close(self) -> None:
        """Release the renderer and the planning process."""
        self.planning.close()
        if self.renderer is not None:
            self.renderer.close()


@dataclass(frozen=True)
class _ArmFactory:
    """Equips arms with camera, controller and tree when they are spawned."""

    file: TreeFile
    world: World
    registry: Registry
    renderer: Renderer | None
    on_event: Callable[[StatusChange], None]
    series: SeriesLog
    planning: PlanningProcess
    contacts: Contacts
    reservations: Reservations
    traffic: Traffic
    seed: int
    trace: TraceEvents | None
    frame_logs: Mapping[str, FrameLog]
    trees: Mapping[str, NodeSpec]
    texts: Mapping[str, str]
    cell: CellState
    controllers: dict[str, JointController]
    faults: WorldFaults
    on_fault: Callable[[FaultEvent], None]

    def clock(self) -> float:
        return self.world.time

    def _faults(self, name: str) -> FaultInjector | None:
        """Faults of the file in an arm's leaves, None if it has none."""
        faults = {
            key: one
            for key, one in self.file.faults.items()
            if isinstance(one, LeafFault) and one.arm == name
        }
        return FaultInjector(faults, self.clock, self.seed, self.on_fault) if faults else None

    def equip(self, name: str) -> ArmParts:
        """Camera, controller and tree of an arm that is in the world."""
        spec = self.file.arms[name]
        camera = None
        if spec.camera is not None and self.renderer is not None:
            camera_name = f"{name}/camera"
            calibration = calibration_of(self.world, name, self.seed)
            rng = self._rng(camera_name)
            frame_log = self.frame_logs[name]
            camera = Camera(
                camera_name,
                spec.camera,
                self.renderer,
                rng,
                calibration,
                frame_log,
                self.faults.camera(name),
            )
        period = control_period(self.world.timestep)
        controller = JointController(self.world, name, float(period), self.reservations)
        self.controllers[name] = controller
        arm = SharedArm(
            self.world,
            name,
            controller,
            camera,
            self.seed,
            self.planning,
            self.contacts,
            self.traffic,
            self.controllers,
            partial(self.faults.no_plan, name),
        )
        access = CellAccess(self.cell, name)
        tree = build_tree(
            name,
            self.trees[name],
            self.registry.skills,
            lambda path: self._context(arm, path, access),
            self.clock,
            self.on_event,
            None if self.trace is None else self.trace.of_tree,
            access,
            self._faults(name),
        )
        robot = name_of_robot(spec.robot, self.world.robots[name])
        mounted = (
            None if camera is None else _MountedCamera(camera, self.world, self.frame_logs[name])
        )
        tick_period = 1 / exact(spec.tick_hz)
        return ArmParts(
            robot,
            tree,
            controller,
            mounted,
            tick_period,
            period,
            arm.slip.look,
            partial(self.faults.is_absent, name),
        )

    def _rng(self, owner: str) -> np.random.Generator:
        """Random generator that depends on the seed and its owner, not on the order of use."""
        return np.random.default_rng([self.seed, zlib.crc32(owner.encode())])

    def _context(self, arm: SharedArm, path: str, cell: CellAccess) -> SkillContext:
        return SkillContext(
            name=path,
            arm=Arm(arm, path),
            clock=self.clock,
            rng=self._rng(f"{arm.name}:{path}"),
            log=logging.getLogger(f"bt_dualarm.skills.{arm.name}"),
            record=partial(self.series.add, arm.name, path),
            cell=cell,
            texts=self.texts,
        )


@dataclass(frozen=True)
class _MountedCamera:
    """A camera with the world that it captures."""

    camera: Camera
    world: World
    frame_log: FrameLog

    def due(self, time: float) -> bool:
        return self.camera.due(time)

    def capture(self) -> None:
        self.frame_log.add(self.camera.capture(self.world))

    def has_arrived(self, time: float) -> bool:
        return self.camera.has_arrived(time)

    def deliver(self, time: float) -> None:
        self.camera.deliver(time)
        trace = self.frame_log.trace
        while trace is not None and self.camera.findings:
            trace.of_look(self.frame_log.arm, self.camera.findings.popleft())


def assemble(
    file: TreeFile,
    registry: Registry,
    on_event: Callable[[StatusChange], None],
    *,
    seed: int | None = None,
    renderer: RendererKind | None = None,
    trace: TraceEvents | None = None,
    on_fault: Callable[[FaultEvent], None] = lambda _: None,
) -> Assembly:
    """Compose the world and equip its arms; nothing moves yet.

    Args:
        file: Tree file, checked with the skills of ``registry``.
        registry: Skills by name.
        on_event: Receives every status change.
        seed: Seed of all random numbers; None for the file's.
        renderer: Renderer of the cameras; None for the file's.
        trace: Collects events of trees and cameras; None if they are not recorded.
        on_fault: Receives the start and the end of every injected fault.

    Raises:
        CatalogError: A robot or scene is unknown or broken.
        RendererError: The requested renderer does not work here.
        WorldError: The parts do not compile to one world, or two of them overlap.
    """
    seed = file.world.seed if seed is None else seed
    opened = None
    message = ""
    if any(arm.camera is not None for arm in file.arms.values()):
        choice = choose_renderer(renderer or file.world.renderer)
        opened = choice.create()
        message = choice.message
    world = World(file, seed)
    world.refuse_overlaps()
    series = SeriesLog()
    planning = PlanningProcess()
    contacts = Contacts(world)
    trees = {name: arm.tree for name, arm in file.arms.items()}
    texts = file.texts_by_name
    frame_logs = {name: FrameLog(name, trace) for name in file.arms}
    traffic = Traffic(lambda: world.time)
    faults = WorldFaults(world, file.faults, seed, on_fault)
    cell = CellState(file.cell, lambda: world.time, traffic)
    if trace is not None:
        cell.on_wait = trace.of_wait

    def noted(change: StatusChange) -> None:
        cell.note_change()
        on_event(change)

    factory = _ArmFactory(
        file,
        world,
        registry,
        opened,
        noted,
        series,
        planning,
        contacts,
        Reservations(),
        traffic,
        seed,
        trace,
        frame_logs,
        trees,
        texts,
        cell,
        {},
        faults,
        on_fault,
    )
    declared = {
        name: name_of_robot(arm.robot, world.robots[name]) for name, arm in file.arms.items()
    }
    leniency = {
        name: Leniency(arm.removable, arm.last_life_counts) for name, arm in file.arms.items()
    }
    arms = Arms(declared, factory.equip, world, leniency, cell)
    return Assembly(
        world,
        arms,
        opened,
        message,
        series,
        planning,
        contacts,
        seed,
        frame_logs,
        trees,
        texts,
        faults,
    )


def name_of_robot(given: str, robot: Robot) -> str:
    """Display name of a robot: catalog name, or title of its description on one line."""
    return " ".join(robot.title.split()) if is_description_path(given) else given


def control_period(timestep: float) -> Fraction:
    """Seconds between set-points: the physics steps that fit into `CONTROL_PERIOD`, or one."""
    step = exact(timestep)
    return max(1, CONTROL_PERIOD // step) * step


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
        referee: Checks the goals and invariants of the file.
        fault_log: Injected faults that have started or ended.
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
    referee: Referee
    fault_log: FaultLog
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
            goals=self.referee.results(),
            faults=self.fault_log.events,
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
    fault_log = FaultLog()

    def on_fault(event: FaultEvent) -> None:
        if options.record is not None:
            trace.of_fault(event)
        feed.on_fault(event)

    with log.during(), ExitStack() as resources:
        if options.reality is not None:
            file = file.in_reality(options.reality)
        file = file.with_faults(options.faults)
        assembly = assemble(
            file,
            registry,
            feed.add,
            seed=options.seed,
            renderer=options.renderer,
            # Without a record nothing reads trace events, so none are collected.
            trace=None if options.record is None else trace,
            on_fault=on_fault,
        )
        resources.enter_context(closing(assembly))
        if not all(body_of(obj).is_simple for obj in assembly.world.objects.values()):
            # Skills need hulls of composed objects, and no tick should wait for this import.
            importlib.import_module("scipy.spatial")
        states = StateLog(assembly.world)
        feed.watch(states, fault_log)
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
            feed.watch(recorder, history)
            open_record = OpenRecord(folder, trace, history, recorder)
        referee = Referee(assembly.world, file, assembly.faults.takes_away)
        if referee.watches:
            feed.watch(referee)
        conditions = _conditions(file.world.time_limit, options, stop, referee)
        if not assembly.faults.is_idle:
            conditions.inject = weakly(assembly.faults.update)
        resources.enter_context(closing(conditions.watchdog))
        return Prepared(
            file.name,
            assembly,
            Runner(assembly.world, assembly.arms, feed, conditions),
            feed,
            conditions.watchdog,
            states,
            referee,
            fault_log,
            log,
            open_record,
            resources.pop_all(),
        )


def _start(file: TreeFile, registry: Registry, options: RunOptions, assembly: Assembly) -> Start:
    """Facts that the run starts from, for its history."""
    renderer = None if assembly.renderer is None else assembly.renderer.name
    timestep = assembly.world.timestep
    file = file.model_copy(update={"objects": dict(assembly.world.declared_objects)})
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


def _conditions(
    time_limit: float, options: RunOptions, stop: StopRequest, referee: Referee
) -> Conditions:
    pacer = RealTime(time.perf_counter, time.sleep) if options.real_time else Unpaced()
    if options.duration is not None and options.duration <= time_limit:
        limit = Limit(options.duration, Ending.DURATION)
    else:
        limit = Limit(time_limit, Ending.TIME_LIMIT)
    watchdog = Watchdog(options.watchdog, stop)
    conditions = Conditions(limit, time.perf_counter, stop, pacer, watchdog)
    if referee.watches:
        # A weak reference: the conditions must not keep the world alive after its run.
        watching = ref(referee)

        def violation() -> str:
            alive = watching()
            return "" if alive is None else alive.violation

        conditions.violation = violation
    return conditions
