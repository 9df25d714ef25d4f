"""From a tree file to a world whose arms are ready to be run."""

from __future__ import annotations

import logging
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import partial

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.arm.shared import SharedArm
from bt_dualarm.motion.control.controller import JointController
from bt_dualarm.motion.planning.process import PlanningProcess
from bt_dualarm.motion.safety.reservation import Reservations
from bt_dualarm.runtime.arm_runtime import ArmParts
from bt_dualarm.runtime.arms import Arms
from bt_dualarm.runtime.notes import Notes
from bt_dualarm.runtime.outcome import Leniency
from bt_dualarm.runtime.schedule import exact
from bt_dualarm.runtime.series import SeriesLog
from bt_dualarm.runtime.sights import Sights
from bt_dualarm.skill.registry import Registry
from bt_dualarm.skill.skill import SkillContext
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.node import NodeSpec
from bt_dualarm.tree.arm_tree import ArmTree
from bt_dualarm.tree.build import build_tree
from bt_dualarm.tree.report import StatusChange
from bt_dualarm.world.cameras.calibration import calibration_of
from bt_dualarm.world.cameras.camera import Camera
from bt_dualarm.world.rendering.choose import choose_renderer
from bt_dualarm.world.rendering.renderer import Renderer, RendererKind
from bt_dualarm.world.robots.page_path import is_page
from bt_dualarm.world.robots.robot import Robot
from bt_dualarm.world.touches import Touches
from bt_dualarm.world.world import World

CONTROL_PERIOD = Fraction(1, 250)
"""Longest time in seconds between two set-points of an arm, where the physics steps as often."""


@dataclass
class Assembly:
    """A world and all that acts in it.

    Attributes:
        renderer: Renderer of all cameras, None where no arm of the file has one; to be closed.
        message: One sentence on which renderer is used and why; empty without cameras.
        series: What the skills measure over time.
        planning: Planning process of all arms; to be closed.
        touches: What the arms really touch, to be looked at after each step.
        seed: Seed of everything random.
        sights: What the cameras' pictures show, by the arm's name.
        trees: Definition of each arm's tree, by the arm's name: what it begins with.
    """

    world: World
    arms: Arms
    renderer: Renderer | None
    message: str
    series: SeriesLog
    planning: PlanningProcess
    touches: Touches
    seed: int
    sights: Mapping[str, Sights]
    trees: dict[str, NodeSpec]

    def close(self) -> None:
        """Give the renderer back, end the process that plans."""
        self.planning.close()
        if self.renderer is not None:
            self.renderer.close()


@dataclass(frozen=True)
class _Parts:
    """What every arm is equipped from."""

    file: TreeFile
    world: World
    registry: Registry
    renderer: Renderer | None
    on_event: Callable[[StatusChange], None]
    series: SeriesLog
    planning: PlanningProcess
    touches: Touches
    reservations: Reservations
    seed: int
    notes: Notes | None
    sights: Mapping[str, Sights]
    trees: Mapping[str, NodeSpec]

    def clock(self) -> float:
        return self.world.time

    def equip(self, name: str) -> ArmParts:
        """Camera, controller and tree of an arm that is in the world."""
        spec = self.file.arms[name]
        camera = None
        if spec.camera is not None and self.renderer is not None:
            eye_name, known = f"{name}/camera", calibration_of(self.world, name, self.seed)
            rng, sights = self._rng(eye_name), self.sights[name]
            camera = Camera(eye_name, spec.camera, self.renderer, rng, known, sights)
        period = control_period(self.world.timestep)
        controller = JointController(self.world, name, float(period), self.reservations)
        arm = SharedArm(
            self.world, name, controller, camera, self.seed, self.planning, self.touches
        )
        tree = self._grown(name, arm)
        called = name_of_robot(spec.robot, self.world.robots[name])
        eye = None if camera is None else _Eye(camera, self.world, self.sights[name])
        return ArmParts(
            called, tree, controller, eye, 1 / exact(spec.tick_hz), period, arm.slip.look
        )

    def _grown(self, name: str, arm: SharedArm) -> ArmTree:
        return build_tree(
            name,
            self.trees[name],
            self.registry.skills,
            lambda path: self._context(arm, path),
            self.clock,
            self.on_event,
            None if self.notes is None else self.notes.of_tree,
        )

    def _rng(self, owner: str) -> np.random.Generator:
        """Randomness hangs on the seed and on who uses it, not on who runs first."""
        return np.random.default_rng([self.seed, zlib.crc32(owner.encode())])

    def _context(self, arm: SharedArm, path: str) -> SkillContext:
        return SkillContext(
            name=path,
            arm=Arm(arm, path),
            clock=self.clock,
            rng=self._rng(f"{arm.name}:{path}"),
            log=logging.getLogger(f"bt_dualarm.skills.{arm.name}"),
            record=partial(self.series.add, arm.name, path),
        )


@dataclass(frozen=True)
class _Eye:
    """A camera, and the world that it looks at."""

    camera: Camera
    world: World
    sights: Sights

    def due(self, time: float) -> bool:
        return self.camera.due(time)

    def capture(self) -> None:
        self.sights.note(self.camera.capture(self.world))

    @property
    def has_seen(self) -> bool:
        return self.camera.has_seen

    def deliver(self, time: float) -> None:
        self.camera.deliver(time)
        notes = self.sights.notes
        while notes is not None and self.camera.looks:
            notes.of_look(self.sights.arm, self.camera.looks.popleft())


def assemble(
    file: TreeFile,
    registry: Registry,
    on_event: Callable[[StatusChange], None],
    *,
    seed: int | None = None,
    renderer: RendererKind | None = None,
    notes: Notes | None = None,
) -> Assembly:
    """Compose the world and equip its arms; nothing moves yet.

    Args:
        file: Tree file, checked with the skills of ``registry``.
        registry: The skills.
        on_event: Receiver of every change of a status.
        seed: Seed of everything random; None takes the file's.
        renderer: Renderer of the cameras; None takes the file's.
        notes: Collector of what trees and cameras note; None where nobody reads it.

    Raises:
        CatalogueError: A robot or scene is unknown or broken.
        RendererError: The renderer asked for cannot work here.
        WorldError: The parts do not compile to one world, or two of them are in one place.
    """
    seed = file.world.seed if seed is None else seed
    drawing, message = None, ""
    if any(arm.camera is not None for arm in file.arms.values()):
        choice = choose_renderer(renderer or file.world.renderer)
        drawing, message = choice.create(), choice.message
    world = World(file, seed)
    world.refuse_overlaps()
    series, planning, touches = SeriesLog(), PlanningProcess(), Touches(world)
    shared = series, planning, touches, Reservations()
    trees = {name: arm.tree for name, arm in file.arms.items()}
    sights = {name: Sights(name, notes) for name in file.arms}
    parts = _Parts(file, world, registry, drawing, on_event, *shared, seed, notes, sights, trees)
    declared = {
        name: name_of_robot(arm.robot, world.robots[name]) for name, arm in file.arms.items()
    }
    leniency = {
        name: Leniency(arm.removable, arm.last_life_counts) for name, arm in file.arms.items()
    }
    arms = Arms(declared, parts.equip, world, leniency)
    return Assembly(world, arms, drawing, message, series, planning, touches, seed, sights, trees)


def name_of_robot(given: str, robot: Robot) -> str:
    """What people are shown: the name in the catalogue, else the title of the page, on one line."""
    return " ".join(robot.title.split()) if is_page(given) else given


def control_period(timestep: float) -> Fraction:
    """Seconds between set-points: so many physics steps as fit into `CONTROL_PERIOD`, or one."""
    step = exact(timestep)
    return max(1, CONTROL_PERIOD // step) * step
