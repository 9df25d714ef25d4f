"""Assembly of a run: a tree file becomes a world whose arms have cameras, controllers and trees."""

from __future__ import annotations

import logging
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import partial

import numpy as np

from bt_dualarm.arm.arm import Arm, SharedArm
from bt_dualarm.behaviors.build import build_tree
from bt_dualarm.behaviors.report import StatusChange
from bt_dualarm.control.controller import JointController
from bt_dualarm.planning.process import PlanningProcess
from bt_dualarm.robots.description_file import is_description_path
from bt_dualarm.robots.robot import Robot
from bt_dualarm.runtime.arm_runtime import ArmParts, Arms
from bt_dualarm.runtime.clock import exact
from bt_dualarm.runtime.observations import FrameLog, TraceEvents
from bt_dualarm.runtime.outcome import Leniency
from bt_dualarm.runtime.series import SeriesLog
from bt_dualarm.safety.failsafe import Reservations
from bt_dualarm.sim.camera import Camera
from bt_dualarm.sim.camera_optics import calibration_of
from bt_dualarm.sim.contact_monitor import Contacts
from bt_dualarm.sim.gl_renderer import choose_renderer
from bt_dualarm.sim.renderer import Renderer, RendererKind
from bt_dualarm.sim.world import World
from bt_dualarm.skill.cell import CellAccess, CellState
from bt_dualarm.skill.registry import Registry
from bt_dualarm.skill.skill import SkillContext
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.node_types import NodeSpec

CONTROL_PERIOD = Fraction(1, 250)
"""Longest time in seconds between two set-points of an arm, where the physics steps as often."""


@dataclass
class Assembly:
    """A world, its arms and their shared services.

    Attributes:
        world: The world.
        arms: The arms of the file.
        renderer: Renderer of all cameras, None if no arm of the file has one.
        message: Sentence on which renderer is used and why; empty without cameras.
        series: Quantities that skills measure over time.
        planning: Planning process of all arms.
        contacts: Actual contacts of the arms, evaluated after each step.
        seed: Random seed.
        frame_logs: Findings in the cameras' frames, by the arm's name.
        trees: Definition of the tree that an arm starts with when spawned, by the arm's name.
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

    def close(self) -> None:
        """Release the renderer and end the planning process."""
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
    seed: int
    trace: TraceEvents | None
    frame_logs: Mapping[str, FrameLog]
    trees: Mapping[str, NodeSpec]
    cell: CellState

    def clock(self) -> float:
        return self.world.time

    def equip(self, name: str) -> ArmParts:
        """Camera, controller and tree of an arm that is in the world."""
        spec = self.file.arms[name]
        camera = None
        if spec.camera is not None and self.renderer is not None:
            camera_name = f"{name}/camera"
            calibration = calibration_of(self.world, name, self.seed)
            rng = self._rng(camera_name)
            frame_log = self.frame_logs[name]
            camera = Camera(camera_name, spec.camera, self.renderer, rng, calibration, frame_log)
        period = control_period(self.world.timestep)
        controller = JointController(self.world, name, float(period), self.reservations)
        arm = SharedArm(
            self.world, name, controller, camera, self.seed, self.planning, self.contacts
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
        )
        robot = name_of_robot(spec.robot, self.world.robots[name])
        mounted = (
            None if camera is None else _MountedCamera(camera, self.world, self.frame_logs[name])
        )
        tick_period = 1 / exact(spec.tick_hz)
        return ArmParts(robot, tree, controller, mounted, tick_period, period, arm.slip.look)

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

    @property
    def has_seen(self) -> bool:
        return self.camera.has_seen

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
) -> Assembly:
    """Compose the world and equip its arms; nothing moves yet.

    Args:
        file: Tree file, checked with the skills of ``registry``.
        registry: Skills by name.
        on_event: Receives every status change.
        seed: Seed of all random numbers; None for the file's.
        renderer: Renderer of the cameras; None for the file's.
        trace: Collects events of trees and cameras; None if they are not recorded.

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
    frame_logs = {name: FrameLog(name, trace) for name in file.arms}
    cell = CellState(file.cell, lambda: world.time)
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
        seed,
        trace,
        frame_logs,
        trees,
        cell,
    )
    declared = {
        name: name_of_robot(arm.robot, world.robots[name]) for name, arm in file.arms.items()
    }
    leniency = {
        name: Leniency(arm.removable, arm.last_life_counts) for name, arm in file.arms.items()
    }
    arms = Arms(declared, factory.equip, world, leniency, cell)
    return Assembly(
        world, arms, opened, message, series, planning, contacts, seed, frame_logs, trees
    )


def name_of_robot(given: str, robot: Robot) -> str:
    """Display name of a robot: catalog name, else the title of its description, on one line."""
    return " ".join(robot.title.split()) if is_description_path(given) else given


def control_period(timestep: float) -> Fraction:
    """Seconds between set-points: the physics steps that fit into `CONTROL_PERIOD`, or one."""
    step = exact(timestep)
    return max(1, CONTROL_PERIOD // step) * step
